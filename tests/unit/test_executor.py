"""The hands alone: what becomes a fact, what is only a hint, what is waited for and what is not."""

import asyncio
import errno
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import pytest
from msgspec import structs

from hardcore import endings, handover
from hardcore import executor as hands
from hardcore.executor import Executor
from hardcore.host import clock, lives, logs, processes, steps
from hardcore.host.folders import Folders
from hardcore.host.lives import Life, Terms
from hardcore.model import actions as orders
from hardcore.model import observations as seen
from hardcore.model.recorder import Witness
from hardcore.model.verdicts import Diagnosis
from hardcore.reporting import have_report
from tests.waiting import until

WAIT_S = 30


@pytest.fixture
def house(tmp_path: Path) -> Folders:
    made = Folders(tmp_path, tmp_path / "run")
    for folder in (made.run, made.logs, made.incidents, made.state):
        folder.mkdir()
    return made


def at_work(house: Folders, work: Callable[[Executor], None]) -> list[seen.Observation]:
    """Give the hands some work, have them finish, and return what they told."""
    facts: list[seen.Observation] = []

    async def run() -> None:
        executor = Executor(house, 1, facts.append, lambda _line: None, lambda: None)
        work(executor)
        await executor.finish()

    asyncio.run(run())
    return facts


async def condition(holds: Callable[[], bool]) -> None:
    """Wait for something without standing in the loop's way."""
    await asyncio.get_running_loop().run_in_executor(None, until, holds, "the hands")


@pytest.mark.parametrize(
    "error", [OSError(28, "No space left on device"), ValueError("a bug"), MemoryError()]
)
def test_a_core_that_could_not_be_made_is_a_fact_whatever_the_reason(
    house: Folders, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    def fail(*_: object) -> None:
        raise error

    monkeypatch.setattr(lives, "start", fail)
    (told,) = at_work(house, lambda e: e.carry_out(orders.Spawn(1, None, ())))
    assert isinstance(told, seen.SpawnFailed)
    assert told.life == 1
    assert not list(house.run.glob("recorder-*")), "the page of a life that never began is removed"


def test_a_hint_about_a_process_keeps_the_step_that_stands(house: Folders) -> None:
    def work(executor: Executor) -> None:
        executor.hint("terminate")
        executor.hint(None, gateway={"pid": 7})
        assert json.loads(house.switch.read_text()) == {
            "generation": 1,
            "step": "terminate",
            "gateway": {"pid": 7},
            "condemned": [],
        }

    assert at_work(house, work) == []


def test_a_hint_that_can_not_be_written_is_told_in_the_log(house: Folders) -> None:
    house.switch.mkdir()
    assert at_work(house, lambda e: e.mark("kill")) == []
    (line,) = map(json.loads, (house.logs / "sentinel.log").read_text().splitlines())
    assert (line["kind"], line["step"]) == ("hint", "kill")


def test_who_is_condemned_is_known_also_where_the_file_of_the_steps_takes_no_more(house: Folders) -> None:
    house.switch.mkdir()  # as if there were no room

    def work(executor: Executor) -> None:
        executor.steps.condemn("0123")
        executor.mark("drain")
        assert steps.condemned(house) == {"0123"}
        executor.steps.absolve("0123")
        assert steps.condemned(house) == frozenset()

    assert at_work(house, work) == []


def test_a_spare_that_is_being_made_keeps_its_page_while_a_core_is_started(
    house: Folders, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, let_go = threading.Event(), threading.Event()
    pages: list[bool] = []

    def start(life: Life, terms: Terms, *_: object) -> None:
        if terms.spare:
            begun.set()
            let_go.wait(WAIT_S)
            pages.append(house.recorder(life.nonce).exists())
        raise OSError(errno.EAGAIN, "no process is to be made here")

    async def both(executor: Executor) -> None:
        executor.carry_out(orders.SpawnSpare(1))
        await executor.in_hand(begun.wait, WAIT_S)
        for number in range(2, 6):
            await executor._spawn(number, Terms())
        let_go.set()

    monkeypatch.setattr(lives, "start", start)
    monkeypatch.setattr(lives.sweep, "__defaults__", (0,))
    told = at_work(house, lambda e: e.begin(both(e)))
    assert {type(fact) for fact in told} == {seen.SpawnFailed}
    assert pages == [True]


def test_hands_that_hang_are_named_and_not_waited_for(
    house: Folders, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hands, "FINISH_S", 0.05)
    let_go = threading.Event()

    async def hang(executor: Executor) -> None:
        await executor.in_hand(let_go.wait)

    try:
        at_work(house, lambda e: e.begin(hang(e)))
    finally:
        let_go.set()
    (line,) = map(json.loads, (house.logs / "sentinel.log").read_text().splitlines())
    assert line["kind"] == "unfinished"
    assert line["work"].endswith("hang")


def test_the_investigators_log_is_rotated_too(house: Folders, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(logs, "LOG_BYTES_MAX", 10)
    log = house.logs / "postmortem.log"
    log.write_text("x" * 11)
    at_work(house, lambda e: e.begin(have_report(e, house, house.incidents)))
    assert log.with_name("postmortem.log.1").read_text() == "x" * 11


def test_a_leftover_that_does_not_die_is_no_exit_until_it_does_and_then_is_one(
    house: Folders, monkeypatch: pytest.MonkeyPatch
) -> None:
    argv = [sys.executable, "-c", "import time; time.sleep(600)"]
    handle = processes.spawn(argv, lives.clean_environment(), house.logs / "log", house.data)
    kills: list[int] = []
    monkeypatch.setattr(handle, "kill_tree", lambda: kills.append(1))  # as if it hung in the kernel
    facts: list[seen.Observation] = []

    def killed(times: int) -> bool:
        return len(kills) == times

    async def run() -> None:
        executor = Executor(house, 1, facts.append, lambda _line: None, lambda: None)
        executor.inherit((lives.Life(0, "0" * 16, house, None, handle),), None)
        for times in (1, 2, 3):
            executor.carry_out(orders.KillLeftovers())
            await condition(partial(killed, times))
        assert facts == []
        handle.signal(signal.SIGKILL)  # the kernel lets it go, whenever that is
        await condition(lambda: facts != [])
        executor.carry_out(orders.KillLeftovers())
        await executor.finish()

    asyncio.run(run())
    (told,) = facts
    assert isinstance(told, seen.CoreExited)
    assert told.life == 0
    os.waitpid(handle.pid, 0)


@pytest.mark.parametrize(
    "order",
    [orders.SampleStacks(7), orders.LookAtStore(7), orders.SetSafe(7, on=True, reason=Diagnosis.DISK_FULL)],
)
def test_an_order_about_a_life_that_is_not_there_is_given_to_nobody(
    house: Folders, order: orders.SampleStacks | orders.LookAtStore | orders.SetSafe
) -> None:
    assert at_work(house, lambda e: e.carry_out(order)) == []
    assert (house.logs / "sentinel.log").exists() is False


def test_what_a_machine_lets_the_guard_see_is_left_in_the_run_folder(house: Folders) -> None:
    assert at_work(house, lambda e: e.begin(e.senses.examine())) == []
    assert "can_dump" in json.loads(house.capability.read_text())


def test_an_order_to_read_only_that_nobody_hears_is_answered_with_the_reason(house: Folders) -> None:
    life = lives.Life(3, "0" * 16, house)
    (told,) = at_work(house, lambda e: e.begin(e.senses.set_safe(life, Diagnosis.DISK_FULL, on=True)))
    assert isinstance(told, seen.SafeSwitched)
    assert (told.life, told.on, told.done) == (3, True, False)
    assert "does not answer" in told.reason


# ---- a switch ----


class Core:
    """Stands at a core's control socket: answers each order as it is told to, and keeps what was asked."""

    def __init__(self, *answers: object) -> None:
        self.asked: list[dict[str, object]] = []
        self._answers = list(answers)

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.asked.append(json.loads(await reader.readline()))
        if self._answers:
            writer.write(json.dumps(self._answers.pop(0)).encode() + b"\n")
        writer.close()
        await writer.wait_closed()


@dataclass
class Scene:
    """Hands, a living process that stands for a core, and what was told."""

    executor: Executor
    life: lives.Life
    facts: list[seen.Observation]

    def steps(self) -> dict[str, object]:
        told: dict[str, object] = json.loads(self.life.folders.switch.read_text())
        return told


@pytest.fixture(autouse=True)
def patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine that stands still for a moment is not what these tests are about."""
    monkeypatch.setattr(handover, "PROMOTE_S", 30.0)


def on_stage(house: Folders, core: Core | None, play: Callable[[Scene], Awaitable[None]]) -> None:
    """Play a scene with a core that lives as life 3; its process is gone afterwards."""

    async def run() -> None:
        facts: list[seen.Observation] = []
        executor = Executor(house, 5, facts.append, lambda _line: None, lambda: None)
        argv = [sys.executable, "-c", "import time; time.sleep(600)"]
        handle = processes.spawn(argv, lives.clean_environment(), house.logs / "log", house.data)
        life = lives.Life(3, "a" * 16, house, None, handle, spare=True)
        executor._endings.keep_watch(life)
        server = None
        if core is not None:
            server = await asyncio.start_unix_server(core.serve, str(house.core_control(life.nonce)))
        try:
            await play(Scene(executor, life, facts))
        finally:
            executor.carry_out(orders.Halt())
            await executor.halted.wait()
            await executor.finish()
            if server is not None:
                server.close()

    asyncio.run(run())


PROMOTE = orders.Promote(3, 7, (Witness(12, 7, "ab" * 32, 1), Witness(11, 6, "cd" * 32, 1)), busy_ms=100)


def test_a_spare_is_told_all_that_a_core_is_told_at_its_start_and_its_ok_is_no_fact(house: Folders) -> None:
    core = Core({"ok": True})

    async def play(scene: Scene) -> None:
        scene.executor.carry_out(PROMOTE)
        assert scene.steps()["step"] == "promote", "it is written before anything is waited for"
        assert scene.steps()["core"] == {**scene.life.named()}["core"]
        await condition(lambda: core.asked != [])
        assert core.asked == [
            {
                "verb": "promote",
                "expected_epoch": 7,
                "witnesses": [f"12:7:{'ab' * 32}", f"11:6:{'cd' * 32}"],
                "busy_ms": 100,
                "generation": 5,
            }
        ]
        assert scene.facts == []

    on_stage(house, core, play)


@pytest.mark.parametrize(
    ("core", "reason"),
    [
        (Core({"ok": False, "error": "it is no spare"}), "it is no spare"),
        (Core(), "the core hung up"),
        (None, "the core's control socket does not answer (FileNotFoundError)"),
    ],
)
def test_a_spare_that_does_not_say_ok_has_refused(house: Folders, core: Core | None, reason: str) -> None:
    async def play(scene: Scene) -> None:
        scene.executor.carry_out(PROMOTE)
        await condition(lambda: scene.facts != [])
        (told,) = scene.facts
        assert isinstance(told, seen.PromoteRefused)
        assert (told.life, told.reason) == (3, reason)

    on_stage(house, core, play)


def test_a_spare_that_is_gone_or_never_was_can_not_be_promoted(house: Folders) -> None:
    async def play(scene: Scene) -> None:
        scene.executor.carry_out(structs.replace(PROMOTE, life=4))
        assert scene.facts == [], "a step of the manager is never told of within itself"
        await condition(lambda: scene.facts != [])
        (told,) = scene.facts
        assert isinstance(told, seen.PromoteRefused)
        assert told.life == 4

    on_stage(house, None, play)


def test_a_core_that_drains_is_not_to_be_gone_on_with_unless_it_could_not_be_drained(house: Folders) -> None:
    core = Core({"ok": False, "error": "one is still at work"}, {"ok": True, "seq": 41})

    async def play(scene: Scene) -> None:
        scene.executor.carry_out(orders.Drain(3, 60_000))
        await condition(lambda: len(scene.facts) == 1)
        assert scene.steps()["condemned"] == []
        scene.executor.carry_out(orders.Drain(3, 60_000))
        await condition(lambda: len(scene.facts) == 2)
        assert scene.steps()["condemned"] == [scene.life.nonce]
        refused, drained = scene.facts
        assert isinstance(refused, seen.Drained)
        assert (refused.done, refused.reason) == (False, "one is still at work")
        assert isinstance(drained, seen.Drained)
        assert (drained.done, drained.seq) == (True, 41)
        assert core.asked[0] == {"verb": "drain", "within_ms": 60_000, "generation": 5}

    on_stage(house, core, play)


def test_a_core_that_says_nothing_of_its_drain_is_left_to_the_managers_deadline(house: Folders) -> None:
    core = Core()

    async def play(scene: Scene) -> None:
        scene.executor.carry_out(orders.Drain(3, 60_000))
        await condition(lambda: core.asked != [])

    on_stage(house, core, play)


@pytest.mark.parametrize("order", [orders.Terminate(3), orders.Kill(3)])
def test_who_is_being_ended_is_not_to_be_gone_on_with(
    house: Folders, monkeypatch: pytest.MonkeyPatch, order: orders.Terminate | orders.Kill
) -> None:
    async def play(scene: Scene) -> None:
        told: list[object] = []
        steps = scene.executor.steps
        monkeypatch.setattr(steps, "_still_ours", lambda: told.append(steps._condemned))
        scene.executor.carry_out(order)
        await condition(lambda: scene.facts != [])
        assert told == [(scene.life.nonce,)]
        assert steps._condemned == (), "it is over"
        (ended,) = scene.facts
        assert isinstance(ended, seen.CoreExited)

    on_stage(house, None, play)


def test_a_spare_that_speaks_another_language_is_told_as_one_that_could_not_be_made_and_is_ended(
    house: Folders,
) -> None:
    async def play(scene: Scene) -> None:
        assert scene.life.handle is not None
        assert scene.executor.speaker(scene.life.handle.pid) is scene.life
        assert scene.executor.speaker(os.getpid()) is None
        scene.executor.reject(scene.life, "it speaks version 3")
        await condition(lambda: len(scene.facts) == 2)
        failed, ended = scene.facts
        assert isinstance(failed, seen.SpawnFailed)
        assert failed.reason == "it speaks version 3"
        assert isinstance(ended, seen.CoreExited)

    on_stage(house, None, play)


def test_nothing_of_ours_lives_when_all_is_halted(house: Folders) -> None:
    lived: list[lives.Life] = []

    async def play(scene: Scene) -> None:
        lived.append(scene.life)

    on_stage(house, None, play)
    assert lived[0].handle is not None
    assert processes.find(lived[0].handle.identity) is None


def test_a_core_that_serves_is_kept_however_many_spares_have_come_and_gone_since(house: Folders) -> None:
    async def play(scene: Scene) -> None:
        for number in range(4, 4 + 2 * endings.LIVES_KEPT_MAX):
            gone = lives.conceive(house, number)
            gone.ended = gone.spare = True
            scene.executor.lives[number] = gone
            await scene.executor._endings.bury(gone)
        assert set(scene.executor.lives) == {3}
        assert list(house.run.glob("recorder-*")) == [], "nothing of a spare is kept"

    on_stage(house, None, play)


@pytest.mark.parametrize(
    ("status", "how"), [(-9, seen.Exit(signal=9)), (75, seen.Exit(code=75)), (None, seen.Exit())]
)
def test_how_an_adopted_core_ended_is_read_from_the_launchers_note(
    house: Folders, status: int | None, how: seen.Exit
) -> None:
    house.exits.mkdir()
    argv = [sys.executable, "-c", "import time; time.sleep(600)"]
    with subprocess.Popen(argv) as process:

        async def run() -> list[seen.Observation]:
            facts: list[seen.Observation] = []
            executor = Executor(house, 1, facts.append, lambda _line: None, lambda: None)
            handle = processes.find(processes.Identity(process.pid, processes.start_of(process.pid) or 0))
            assert handle is not None
            note = house.exits / str(process.pid)
            note.write_text(
                json.dumps({"pid": process.pid, "status": 3, "at_ns": clock.now_ns()})
            )  # a stranger's
            executor.inherit((), lives.Life(0, "b" * 16, house, None, handle))
            executor.carry_out(orders.Adopt(1))
            assert executor.lives[1].number == 1
            process.kill()
            if status is not None:
                note.write_text(json.dumps({"status": status, "at_ns": clock.now_ns()}))
            await condition(lambda: facts != [])
            await executor.finish()
            return facts

        (told,) = asyncio.run(run())
    assert isinstance(told, seen.CoreExited)
    assert (told.life, told.exit) == (1, how)
