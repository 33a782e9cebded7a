"""The hands alone: what becomes a fact, what is only a hint, what is waited for and what is not."""

import asyncio
import json
import os
import signal
import sys
import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from hardcore import executor as hands
from hardcore.executor import Executor
from hardcore.host import lives, logs, processes
from hardcore.host.folders import Folders
from hardcore.model import actions as orders
from hardcore.model import observations as seen
from hardcore.model.verdicts import Diagnosis
from tests.waiting import until


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
    at_work(house, lambda e: e.begin(e._report(house.incidents)))
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
