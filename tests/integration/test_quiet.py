"""Nothing is wrong, so nothing is done: no kill without two kinds of evidence, whatever the load."""

import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from tests.integration.clients import assert_exactly_once, at_work
from tests.integration.house import House
from tests.waiting import until

QUIET_S = 3.0
PROOFS = 40


@contextmanager
def untouched(house: House) -> Iterator[None]:
    """Whatever happens in the block: the same core, the same epoch, no incident."""
    before, count = house.status(), len(house.incidents())
    yield
    after = house.running()
    assert (after["core"]["pid"], after["core"]["epoch"]) == (before["core"]["pid"], before["core"]["epoch"])
    assert after["budget"]["used"] == before["budget"]["used"]
    assert len(house.incidents()) == count


@contextmanager
def busy_processors(count: int) -> Iterator[None]:
    """Keep so many processors busy while the block runs."""
    burning = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for process in burning:
            process.kill()
            process.wait()


def pass_by() -> None:
    """Let the guard look at the core for some seconds; here the passing of time itself is what is tested."""
    threading.Event().wait(QUIET_S)


def test_a_quiet_run_has_no_incident(house: House) -> None:
    with untouched(house):
        pass_by()


def test_busy_processors_are_no_reason_to_kill(house: House) -> None:
    with untouched(house), busy_processors(4), at_work(house, 2, "beside-burners") as clients:
        pass_by()
    assert {told.status for told in clients.told} == {201}
    assert_exactly_once(house, clients)


def test_a_core_that_works_hard_is_never_killed(house: House) -> None:
    proofs = 0
    enough = threading.Event()

    def prove() -> None:
        nonlocal proofs
        while not enough.is_set():
            answer = house.ask("GET", "/api/ledger/verify")
            assert answer.status in {200, 503}, answer
            proofs += answer.status == 200

    with untouched(house), at_work(house, 4, "hard-work") as clients:
        threads = [threading.Thread(target=prove, daemon=True) for _ in range(3)]
        for thread in threads:
            thread.start()
        try:
            until(lambda: proofs >= PROOFS and len(clients.told) > 200, "a lot of work")
        finally:
            enough.set()
            for thread in threads:
                thread.join(20)
    assert {told.status for told in clients.told} == {201}
    assert house.ask("GET", "/api/ledger/verify").body["ok"]
