"""A guard that dies alone: the next one goes on with the core and the gateway it finds, and nobody notices."""

import asyncio
import json
import signal
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from websockets.sync.client import connect
from websockets.typing import Subprotocol

from hardcore.host import core_control
from tests.integration.clients import assert_exactly_once, at_work
from tests.integration.conftest import MakeHouse
from tests.integration.house import ANSWER_S, START_S, House
from tests.waiting import until

HARDCORE = Subprotocol("hardcore.v1")


def another_sentinel(house: House, old: int) -> dict[str, Any]:
    """Wait until the next guard answers at the door and has its gateway."""
    return house.until(
        lambda s: s["sentinel"]["pid"] not in {None, old} and s["gateway"]["pid"], "another sentinel"
    )


def noted(house: House, kind: str, holds: Callable[[dict[str, Any]], object]) -> bool:
    """Tell whether the guard's log has such a line."""
    lines = (house.folders.logs / "sentinel.log").read_text("utf-8").splitlines()
    return any(line["kind"] == kind and holds(line) for line in map(json.loads, lines))


def test_a_guard_that_dies_alone_is_followed_without_a_request_that_waits(house: House) -> None:
    before, count = house.status(), len(house.incidents())
    core, gateway = house.hold("core"), house.hold("gateway")
    with at_work(house, 3, "alone") as clients:
        until(lambda: len(clients.told) > 20, "the load to run")
        sentinel = house.hit("sentinel")
        story = house.closed(count + 1)
        another_sentinel(house, sentinel.pid)
        told = len(clients.told)
        until(lambda: len(clients.told) > told + 20, "answers under the new guard")
    assert {(told.status, told.tries) for told in clients.told} == {(201, 1)}
    assert_exactly_once(house, clients)
    assert (story["diagnosis"], story["outcome"], story["outage_ms"]) == ("SENTINEL_LOST", "recovered", None)
    assert not core.gone
    assert not gateway.gone
    after = house.running()
    for who in ("core", "gateway", "launcher"):
        assert after[who]["pid"] == before[who]["pid"]
    assert after["core"]["epoch"] == before["core"]["epoch"]
    assert (after["sentinel"]["adopted"], after["budget"]["used"]) == (True, before["budget"]["used"])


def test_a_page_that_is_open_hears_nothing_of_a_guard_that_dies(house: House) -> None:
    live = house.url.replace("http://", "ws://") + "/__hc/live"
    booked = house.url.replace("http://", "ws://") + "/ws"
    with (
        connect(live, compression=None, ping_interval=None) as tab,
        connect(booked, subprotocols=[HARDCORE], compression=None, ping_interval=None) as ledger,
    ):
        assert json.loads(tab.recv(ANSWER_S))["type"] == "hello"
        assert json.loads(tab.recv(ANSWER_S))["phase"] == "RUNNING"
        sentinel = house.hit("sentinel")
        another_sentinel(house, sentinel.pid)
        house.running()
        assert house.book("after-the-guard").status == 201
        frames = [json.loads(ledger.recv(ANSWER_S))]
        while frames[-1].get("description") != "after-the-guard":
            frames.append(json.loads(ledger.recv(ANSWER_S)))
        assert "ledger.resync" not in {frame["type"] for frame in frames}
        old = house.hit("core")
        until(lambda: old.gone, "the core to be gone")
        told = [json.loads(tab.recv(ANSWER_S))]
        while told[-1].get("state") != "RECOVERY":
            told.append(json.loads(tab.recv(ANSWER_S)))
        assert {(f["type"], f["state"], f["text"]) for f in told[:-1]} <= {("state", "OPERATIONAL", None)}
    # The page may hear of the death before the guard's own door tells of it.
    house.until(lambda s: s["core"]["pid"] not in {None, old.pid}, "another core")
    house.running()


def test_a_request_that_is_held_when_the_guard_dies_is_answered_once(house: House) -> None:
    sentinel, core = house.hold("sentinel"), house.hold("core")
    answers: list[int] = []
    core.hit(signal.SIGSTOP)
    asking = threading.Thread(target=lambda: answers.append(house.book("held").status))
    asking.start()
    house.until(lambda s: s["phase"] not in {"RUNNING", "SUSPECT"}, "the frozen core to be judged")
    sentinel.hit(signal.SIGKILL)
    another_sentinel(house, sentinel.pid)
    asking.join(START_S)
    assert answers == [201]
    house.running()
    assert house.booked().count("held") == 1


def test_the_core_that_was_gone_on_with_is_watched_like_any_other(house: House) -> None:
    count = len(house.incidents())
    sentinel = house.hit("sentinel")
    another_sentinel(house, sentinel.pid)
    house.closed(count + 1)  # that nobody watched
    before = house.running()
    house.hit("core")
    story = house.closed(count + 2)
    assert (story["diagnosis"], story["outcome"]) == ("KILLED_FROM_OUTSIDE", "recovered")
    after = house.running()
    assert after["core"]["epoch"] == before["core"]["epoch"] + 1
    assert after["gateway"]["pid"] == before["gateway"]["pid"]


def test_a_core_that_was_stopped_before_its_guard_died_is_found_out_by_the_next(house: House) -> None:
    count = len(house.incidents())
    core, sentinel = house.hold("core"), house.hold("sentinel")
    sentinel.hit(signal.SIGSTOP)  # so that it can't have begun anything
    core.hit(signal.SIGSTOP)
    sentinel.hit(signal.SIGKILL)
    another_sentinel(house, sentinel.pid)
    until(lambda: len(house.incidents()) > count, "it to be told")
    house.until(lambda s: s["core"]["pid"] not in {None, core.pid}, "another core")
    house.running()
    assert core.gone
    assert house.book("after-the-frozen-one").status == 201


def test_guards_that_die_one_after_another_leave_the_same_core_serving(house: House) -> None:
    before = house.status()
    for _ in range(3):
        sentinel = house.hit("sentinel")
        another_sentinel(house, sentinel.pid)
    after = house.running()
    assert after["core"]["pid"] == before["core"]["pid"]
    assert house.book(f"after-{after['sentinel']['pid']}").status == 201


def test_a_gateway_that_does_not_dial_is_replaced_and_the_core_stays(house: House) -> None:
    before = house.status()
    gateway, sentinel = house.hold("gateway"), house.hold("sentinel")
    gateway.hit(signal.SIGSTOP)
    sentinel.hit(signal.SIGKILL)
    house.until(lambda s: s["gateway"]["pid"] not in {None, gateway.pid}, "another gateway")
    after = house.running()
    until(lambda: gateway.gone, "the old gateway to be gone")
    assert after["core"]["pid"] == before["core"]["pid"]
    assert house.book("through-the-new-gateway").status == 201


def test_a_gateway_that_was_told_other_limits_is_seen_off(new_house: MakeHouse) -> None:
    house = new_house().up()
    gateway, sentinel = house.hold("gateway"), house.hold("sentinel")
    told = json.loads(house.folders.policy.read_text("utf-8"))
    told["gateway"]["hold_ms"] += 1
    house.folders.policy.write_text(json.dumps(told), "utf-8")
    core = house.status()["core"]["pid"]
    sentinel.hit(signal.SIGKILL)
    house.until(lambda s: s["gateway"]["pid"] not in {None, gateway.pid}, "another gateway")
    until(lambda: gateway.gone, "the old gateway to leave")
    assert house.running()["core"]["pid"] == core


def test_where_nothing_is_wanted_nothing_is_gone_on_with(new_house: MakeHouse) -> None:
    house = new_house().up()
    sentinel = house.hold("sentinel")
    sentinel.hit(signal.SIGSTOP)
    wanted = house.folders.state / "wanted.json"
    wanted.write_text(wanted.read_text("utf-8").replace("UP", "DOWN"), "utf-8")
    sentinel.hit(signal.SIGKILL)
    assert house.launcher is not None
    assert house.launcher.wait(START_S) == 0
    until(lambda: not house.processes(), "everything to be stopped")


def test_the_spare_of_the_guard_before_is_ended_and_another_one_comes(new_house: MakeHouse) -> None:
    house = new_house(spare=True, spare_memory_mb=0).up()
    first = house.until(lambda s: s["spare"] and s["spare"]["ready"], "a spare")["spare"]["pid"]
    held = house.hold_pid(first)
    before = house.status()
    house.hit("sentinel")
    house.until(lambda s: s["spare"] and s["spare"]["ready"] and s["spare"]["pid"] != first, "another spare")
    until(lambda: held.gone, "the first spare to be gone")
    after = house.running()
    assert after["core"]["pid"] == before["core"]["pid"]
    cores = [line for line in house.processes().values() if "-m core serve" in line]
    assert len(cores) == 2, cores


def test_a_core_that_nothing_leads_to_is_not_gone_on_with(new_house: MakeHouse) -> None:
    house = new_house().up()
    house.open_accounts()
    core = house.hold("core")
    sentinel = house.hold("sentinel")
    sentinel.hit(signal.SIGSTOP)
    for path in Path(house.folders.run).glob("core-*.sock"):
        path.unlink()
    sentinel.hit(signal.SIGKILL)
    another_sentinel(house, sentinel.pid)
    house.running()
    assert core.gone
    assert house.book("after").status == 201


def test_a_core_that_nobody_heard_say_that_it_reads_only_is_found_out_and_writes_again(
    new_house: MakeHouse,
) -> None:
    house = new_house(safe_retry_ms=1500).up()
    house.open_accounts()
    generation = json.loads((house.folders.run / "generation").read_text("utf-8"))["generation"]
    core = house.status()["core"]["pid"]
    (control,) = house.folders.run.glob("core-*.ctl")
    order = {"verb": "safe", "on": True, "reason": "DISK_FULL", "generation": generation}
    assert asyncio.run(core_control.give(control, order, ANSWER_S)) == ""
    assert house.book("refused").status == 503
    house.until(lambda s: s["safe"] == "DISK_FULL", "the guard to find out")
    house.until(lambda s: s["safe"] is None, "a try to write")
    assert house.book("taken").status == 201
    assert house.running()["core"]["pid"] == core
