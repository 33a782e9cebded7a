"""The guard's side of an alert: nothing waits for it, and whatever goes wrong is told as that."""

import asyncio
import json
from collections.abc import Awaitable, Callable, Coroutine
from pathlib import Path
from typing import Any

import pytest

from hardcore import outbox
from hardcore.model.actions import Alert, AlertStage
from hardcore.model.verdicts import Diagnosis
from hardcore.outbox import Outbox
from tests.contract.alert_targets import HANGS, Outgoing, outgoing, web
from tests.waiting import until

WAIT_S = 20.0


class Hands:
    """The executor, as far as an outbox needs one."""

    def __init__(self) -> None:
        self.notes: list[dict[str, object]] = []
        self.tasks: set[asyncio.Task[object]] = set()

    async def in_hand(self, work: Callable[..., Any], *args: Any) -> Any:
        return await asyncio.to_thread(work, *args)

    def note(self, kind: str, **particulars: object) -> None:
        self.notes.append({"kind": kind, **particulars})

    def begin(self, work: Coroutine[Any, Any, object]) -> None:
        task = asyncio.get_running_loop().create_task(work)
        self.tasks.add(task)
        task.add_done_callback(self.tasks.discard)


class World:
    """A data folder, an outbox over it, and what the gateway is told."""

    def __init__(self, place: Path) -> None:
        self.out: Outgoing = outgoing(place)
        self.hands = Hands()
        self.lines: list[dict[str, object]] = []
        self.box: Outbox

    def run(self, story: Callable[["World"], Awaitable[None]]) -> None:
        async def told() -> None:
            self.box = Outbox(self.out.folders, self.hands, lambda line: self.lines.append(dict(line)))
            try:
                await asyncio.wait_for(story(self), WAIT_S)
            finally:
                await self.box.stop()
                await asyncio.wait_for(asyncio.gather(*self.hands.tasks), WAIT_S)

        asyncio.run(told())

    def channel(self, url: str) -> None:
        self.out.channels({"kind": "webhook", "url": f"{url}/x"})

    async def told(self, count: int) -> None:
        await asyncio.to_thread(until, lambda: len(self.lines) >= count, "a line for the gateway")


@pytest.fixture
def world(tmp_path: Path) -> World:
    return World(tmp_path)


def alert(incident: str = "i1", stage: AlertStage = AlertStage.OPENED) -> Alert:
    return Alert(Diagnosis.CRASHED, "password=CANARY the core ended", incident, stage)


def test_whoever_has_no_channel_is_told_that_nobody_was(world: World) -> None:
    async def story(world: World) -> None:
        await world.box.put(alert())

    world.run(story)
    assert world.lines == [{"type": "alerted", "incident": "i1", "at": None, "failed": True}]
    assert world.out.waiting == []


def test_a_message_that_arrived_is_told_with_its_time_also_to_a_gateway_that_comes_later(
    world: World,
) -> None:
    async def story(world: World) -> None:
        await world.box.put(alert())
        await world.told(1)

    with web() as target:
        world.channel(target.url)
        world.run(story)
        assert "CANARY" not in target.texts[0]
    (line,) = world.lines
    assert (line["incident"], line["failed"]) == ("i1", False)
    assert line["at"]
    assert world.box.lines == (line,)


def test_what_nobody_takes_is_told_as_that(world: World) -> None:
    async def story(world: World) -> None:
        await world.box.put(alert())
        await world.told(1)

    with web() as gone:
        world.channel(gone.url)
    world.run(story)
    assert world.lines == [{"type": "alerted", "incident": "i1", "at": None, "failed": True}]
    assert len(world.out.waiting) == 1  # for the next guard: there are tries left


def test_what_an_earlier_guard_left_is_sent(world: World) -> None:
    async def story(world: World) -> None:
        await world.box.resume("http://127.0.0.1:3000")
        await asyncio.to_thread(until, lambda: not world.out.waiting, "it to be sent")

    world.out.put(incident="i0")
    with web() as target:
        world.channel(target.url)
        world.run(story)
        assert [one.json["incident"] for one in target.came] == ["i0"]


def test_where_the_disk_refuses_the_alert_goes_by_way_of_memory(world: World) -> None:
    world.out.folders.outbox.rmdir()
    world.out.folders.outbox.write_text("no folder", "utf-8")

    async def story(world: World) -> None:
        await world.box.put(alert())
        (kept,) = (world.out.folders.run / "alerts").iterdir()
        assert json.loads(kept.read_text("utf-8"))["incident"] == "i1"

    with web() as target:
        world.channel(target.url)
        world.run(story)


def test_where_nothing_can_be_written_the_log_and_the_page_say_so(world: World) -> None:
    for place in (world.out.folders.outbox, world.out.folders.run / "alerts"):
        if place.is_dir():
            place.rmdir()
        place.write_text("no folder", "utf-8")

    async def story(world: World) -> None:
        await world.box.put(alert())

    with web() as target:
        world.channel(target.url)
        world.run(story)
        assert target.came == []
    assert [note["kind"] for note in world.hands.notes] == ["alert"]
    assert world.lines[0]["failed"] is True


def test_the_outbox_is_bounded_and_the_oldest_of_its_kind_goes_first(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(outbox, "WAITING_MAX", 4)
    other = world.out.put(fingerprint="FROZEN", diagnosis="FROZEN")
    names = [world.out.put() for _ in range(3)]
    box = Outbox(world.out.folders, world.hands, lambda _: None)
    box._write("ffffffff-ffff-7fff-bfff-ffffffffffff", {"fingerprint": "CRASHED"})
    kept = {path.stem for path in world.out.waiting}
    assert kept == {other, *names[1:], "ffffffff-ffff-7fff-bfff-ffffffffffff"}


def test_a_sender_that_hangs_is_ended_and_costs_nothing_but_itself(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(outbox, "SENDER_S", 1.0)
    monkeypatch.setattr(outbox, "RUNS_MAX", 1)

    async def story(world: World) -> None:
        await world.box.put(alert())
        given_up = lambda: world.hands.notes and world.box._sender is None  # noqa: E731
        await asyncio.to_thread(until, given_up, "the sender to be given up")

    with web(HANGS) as target:
        world.channel(target.url)
        world.run(story)
    assert world.hands.notes == [{"kind": "alert", "failed": "the sender did not end by itself"}]


def test_a_try_comes_back_with_what_came_of_each_channel(world: World) -> None:
    answers: list[dict[str, object]] = []

    async def story(world: World) -> None:
        answers.append(await world.box.test())
        answers.append(await world.box.test(7))

    with web() as target:
        world.channel(target.url)
        world.run(story)
    first, none = answers
    assert first["ok"] is True
    results = first["results"]
    assert isinstance(results, list)
    assert [(one["channel"], one["ok"]) for one in results] == [(1, True)]
    assert none == {"ok": True, "results": []}


def test_what_is_put_off_keeps_no_sender_and_holds_nothing_else_back(world: World) -> None:
    async def story(world: World) -> None:
        box, folders = world.box, world.out.folders
        await box.put(alert("i1"))
        await world.told(1)
        await box.put(alert("i2"))
        put_off = lambda: any(one["again_at"] for one in world.out.book["last"])  # noqa: E731
        await asyncio.to_thread(until, put_off, "it to be put off")
        await asyncio.to_thread(until, lambda: box._sender is None, "its sender to end")
        assert [path.parent for path in world.out.waiting] == [folders.outbox]
        await box.put(alert("i2", AlertStage.WAITS))
        await asyncio.to_thread(until, lambda: not world.out.waiting, "it to be sent")

    with web() as target:
        world.channel(target.url)
        world.run(story)
        stages = [(one.json["stage"], one.json["incident"]) for one in target.came]
        assert stages == [("opened", "i1"), ("waits", "i2")]


def test_a_policy_that_can_not_be_read_is_none_that_names_nobody(world: World) -> None:
    world.out.folders.good_policy.write_text('{"alerts": [', "utf-8")

    async def story(world: World) -> None:
        await world.box.put(alert())

    world.run(story)
    assert world.lines == []
    assert len(world.out.waiting) == 1
