"""The guard is killed between any two steps of a recovery or of a switch: the next one brings it to one core.

Each deed is written into `run/switch` before it is done, so a test that kills as soon as it reads a step there meets
the guard just before or just after that deed. What no step names is met by chance: kills at instants that a seed
chose. Whatever the instant, it ends with one core under the store's epoch, a gateway that answers, and a ledger in
which every acknowledged transaction stands once.
"""

import itertools
import random
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from typing import Any, Final

import pytest

from hardcore.control import client
from tests.integration import houses
from tests.integration.clients import assert_exactly_once, at_work
from tests.integration.house import START_S, WITH_SPARE, House
from tests.waiting import until

#: How long a kill by chance may come after the fault: a crash is over in far less, a hang in little more.
LATEST_S: Final = {"crash": 0.15, "hang": 2.5, "switch": 0.25}
SEEDS: Final = 1
#: A step may last for less time than a busy machine leaves its killer waiting: then the fault begins anew.
ATTEMPTS_MAX: Final = 8
#: So long nobody asks the guard for its status, which would be in the way of who is tested.
UNASKED_S: Final = 3.0
#: One for each load: no test takes another's keys, which one that failed has left in the ledger, for its own.
LOADS: Final = itertools.count(100)


@pytest.fixture(scope="module")
def shared_house(tmp_path_factory: pytest.TempPathFactory) -> Iterator[House]:
    """A house that keeps a spare."""
    house = House(tmp_path_factory.mktemp("spared") / "data", WITH_SPARE)
    try:
        house.up().open_accounts()
        yield house
    finally:
        house.end()


house = houses.house


@contextmanager
def killer(house: House, step: str) -> Iterator["subprocess.Popen[bytes]"]:
    """A process that kills the guard as soon as it has written that it is at this step."""
    sentinel = house.hold("sentinel")
    argv = [sys.executable, "-m", "tests.integration.step_killer"]
    process = subprocess.Popen(
        [*argv, str(house.folders.switch), step, str(sentinel.pidfd)],
        stdout=subprocess.PIPE,
        pass_fds=(sentinel.pidfd,),
    )
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == b"looking\n"
        yield process
    finally:
        process.kill()
        process.communicate()


def begin(house: House, fault: str) -> None:
    """Bring about what the guard has to answer; it may be killed before it has answered whoever asks."""
    match fault:
        case "crash":
            house.hit("core", signal.SIGKILL)
        case "hang":
            house.hit("core", signal.SIGSTOP)
        case _:
            with suppress(client.Unreachable):
                house.order("restart")


def strike(house: House, fault: str, step: str) -> None:
    """Bring about the fault until the guard was killed at the step; whoever books meanwhile goes on."""
    for _ in range(ATTEMPTS_MAX):
        before = house.spared()
        sentinel = house.hold("sentinel")
        house.folders.switch.unlink(missing_ok=True)  # what stands there is of the last switch
        with killer(house, step) as process:
            begin(house, fault)
            ended = partial(has_ended, house, process, before["core"]["pid"])
            with suppress(subprocess.TimeoutExpired):
                process.wait(UNASKED_S)
            until(ended, f"the guard to come to {step!r}, or to be done without", START_S)
        if process.returncode == 0 or sentinel.gone:
            return
    raise AssertionError(f"the guard was not met at {step!r} in {ATTEMPTS_MAX} attempts")


def has_ended(house: House, process: "subprocess.Popen[bytes]", core_pid: int) -> bool:
    """Whether the killer has killed, or the guard has answered the fault with another core before it could."""
    if process.poll() is not None:
        assert process.returncode == 0, f"the killer failed with {process.returncode}"
        return True
    status = house.status()
    return bool(
        status
        and status["phase"] == "RUNNING"
        and status["incident"] is None
        and status["core"]["pid"] not in {None, core_pid}
        and status["spare"]
        and status["spare"]["ready"]
    )


def converges(house: House, fault: str, kill: Callable[[], object]) -> None:
    """Have clients book while a fault and the guard's death happen; then hold everything to what was promised."""
    before = house.spared()
    with at_work(house, 2, f"{fault}-load{next(LOADS)}") as clients:
        until(lambda: len(clients.told) > 5, "the load to run")
        kill()
        house.until(lambda s: s["sentinel"]["pid"] != before["sentinel"]["pid"], "another sentinel")
        after = house.spared()
        told = len(clients.told)
        until(lambda: len(clients.told) > told + 5, "answers", START_S)
    assert {told.status for told in clients.told} == {201}
    assert_exactly_once(house, clients)
    assert after["core"]["epoch"] >= before["core"]["epoch"]
    assert house.ask("GET", "/api/ledger/verify").body["ok"]
    living = [line for line in house.processes().values() if "-m core serve" in line]
    assert len(living) == 2, living  # the core and its spare
    until(lambda: sum("hardcore.crisis" in line for line in house.processes().values()) == 1, "one gateway")


@pytest.mark.parametrize(
    ("fault", "step"),
    [
        ("crash", "promote"),
        ("crash", "released"),
        ("hang", "stop"),
        ("hang", "kill"),
        ("hang", "promote"),
        ("hang", "released"),
        ("switch", "drain"),
        (
            "switch",
            "promote",
        ),  # what follows is marked by two hands at one moment: met at random instants below
    ],
)
def test_a_guard_that_is_killed_at_a_step_is_followed_to_one_core(
    house: House, fault: str, step: str
) -> None:
    converges(house, fault, lambda: strike(house, fault, step))


@pytest.mark.parametrize("step", ["promote", "released"])
def test_a_death_that_its_guard_did_not_live_to_tell_is_told_by_the_next(house: House, step: str) -> None:
    house.spared()
    before = {item["id"] for item in house.incidents()}
    with at_work(house, 2, f"told-load{next(LOADS)}") as clients:
        until(lambda: len(clients.told) > 5, "the load to run")
        strike(house, "crash", step)
        house.spared()

    def told() -> dict[str, dict[str, Any]]:
        new = [item for item in house.incidents() if item["id"] not in before]
        return {
            item["diagnosis"]: item
            for item in new
            if (
                item["closed_at"] and item["served_again_at"] and item["outcome"] != "recovered"
            )  # before it was met
            or item["diagnosis"] == "SENTINEL_LOST"
        }

    until(lambda: set(told()) == {"KILLED_FROM_OUTSIDE", "SENTINEL_LOST"}, "both to be told", START_S)
    death, loss = told()["KILLED_FROM_OUTSIDE"], told()["SENTINEL_LOST"]
    assert (death["outcome"], death["outage_ms"] > 0) == ("abandoned", True)
    assert "it answered again after" in death["summary"]
    assert "all the while" not in loss["summary"]


@pytest.mark.parametrize("seed", range(SEEDS))
@pytest.mark.parametrize("fault", ["crash", "hang", "switch"])
def test_a_guard_that_is_killed_at_any_instant_is_followed_to_one_core(
    house: House, fault: str, seed: int
) -> None:
    after_s = random.Random(f"{fault}-{seed}").uniform(0, LATEST_S[fault])
    house.spared()
    sentinel = house.hold("sentinel")

    def kill() -> None:
        timer = threading.Timer(after_s, lambda: sentinel.hit(signal.SIGKILL))
        timer.start()
        begin(house, fault)
        timer.join()

    converges(house, fault, kill)
