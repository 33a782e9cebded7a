"""A core that was stopped while another took over, and goes on: it commits nothing, says nothing, and is gone with 75."""

import http.client
import random
import signal
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import pytest

from core.tenure import STOPPED_NS
from tests import stores
from tests.integration.lone_core import Answer, moving, verify
from tests.integration.wired_core import Guard, Wired, guarding
from tests.waiting import until

FENCED = 75
SEEDS = range(2)
CLIENTS = 4
LOT = 600


@pytest.fixture
def guard(tmp_path: Path) -> Iterator[Guard]:
    with guarding(tmp_path) as made:
        yield made


@pytest.fixture
def served(guard: Guard) -> Wired:
    """A core of epoch 1 with two accounts."""
    first = guard.core()
    assert first.core.open("bank").status == 201
    assert first.core.open("food", "expense").status == 201
    return first


@pytest.fixture
def asking() -> Iterator[ThreadPoolExecutor]:
    with ThreadPoolExecutor(CLIENTS) as threads:
        yield threads


def stop(life: Wired) -> None:
    life.core.process.send_signal(signal.SIGSTOP)
    state = Path(f"/proc/{life.pid}/stat")
    until(lambda: state.read_text().rpartition(")")[2].split()[0] == "T", "it to be stopped")


def thaw(life: Wired) -> None:
    """Let it go on, after it was stopped for longer than it could overlook."""

    def silent_ns() -> int:
        return time.monotonic_ns() - life.page().beats.loop_ns

    until(lambda: silent_ns() > 2 * STOPPED_NS, "it to be stopped for a while")
    life.core.process.send_signal(signal.SIGCONT)


def tried(life: Wired, method: str, path: str, body: object = None, **headers: str) -> Answer | None:
    """Ask, and return None where the core was gone before it answered."""
    try:
        return life.core.ask(method, path, body, **headers)
    except (OSError, http.client.HTTPException):
        return None


def booked(life: Wired, key: str) -> Answer | None:
    try:
        return life.core.move(5, "food", "bank", Idempotency_Key=key)
    except (OSError, http.client.HTTPException):
        return None


def replaced(guard: Guard, served: Wired) -> Wired:
    """Stop the core, wherever it is, and have a spare take over."""
    spare = guard.spare()
    stop(served)
    assert spare.promote(1) == {"ok": True}
    spare.hears("READY")
    return spare


def test_an_idle_core_that_goes_on_after_another_took_over_leaves_by_itself(
    guard: Guard, served: Wired
) -> None:
    replaced(guard, served)
    thaw(served)
    assert served.core.ends_with() == FENCED
    words = served.page().last_words
    assert words is not None
    assert words.code == "FENCED"


def test_a_question_that_waited_for_a_stopped_core_is_not_answered_from_the_past(
    guard: Guard, served: Wired, asking: ThreadPoolExecutor
) -> None:
    spare = guard.spare()
    stop(served)
    asked = [asking.submit(tried, served, "GET", path) for path in ("/healthz", "/", "/api/ledger/accounts")]
    assert spare.promote(1) == {"ok": True}
    spare.hears("READY")
    assert spare.core.move(7, "food", "bank").status == 201
    assert not any(one.done() for one in asked)
    thaw(served)
    assert served.core.ends_with() == FENCED
    assert [one.result() for one in asked] == [None, None, None]


def test_a_booking_that_waited_for_a_stopped_core_is_never_committed_by_it(
    guard: Guard, served: Wired, asking: ThreadPoolExecutor
) -> None:
    spare = guard.spare()
    stop(served)
    asked = asking.submit(booked, served, "k-1")
    assert spare.promote(1) == {"ok": True}
    spare.hears("READY")
    thaw(served)
    assert served.core.ends_with() == FENCED
    assert asked.result() is None
    assert spare.core.ask("GET", "/api/ledger/commands/k-1").status == 404
    again = booked(spare, "k-1")
    assert again is not None
    assert (again.status, again.body["epoch"]) == (201, 2)


def test_a_command_that_was_waiting_for_the_store_when_its_core_was_stopped_is_not_done(
    guard: Guard, served: Wired, asking: ThreadPoolExecutor
) -> None:
    spare = guard.spare()
    with stores.locked(guard.data) as holder:
        asked = asking.submit(booked, served, "k-1")
        until(served.reader.in_flight, "it to wait for the lock")
        stop(served)
        holder.execute("ROLLBACK")
    assert spare.promote(1) == {"ok": True}
    spare.hears("READY")
    thaw(served)
    assert served.core.ends_with() == FENCED
    assert asked.result() is None
    assert spare.core.ask("GET", "/api/ledger/commands/k-1").status == 404


@pytest.mark.parametrize("atomic", [True, False])
def test_a_batch_whose_core_is_killed_after_its_commit_is_booked_once_whoever_asks_again(
    guard: Guard, served: Wired, asking: ThreadPoolExecutor, *, atomic: bool
) -> None:
    batch = {"atomic": atomic, "transactions": [moving(1, "food", "bank")] * LOT}
    path, key = "/api/ledger/transactions/batch", {"Idempotency_Key": "lot"}
    before = served.witness()
    asked = asking.submit(partial(tried, served, "POST", path, batch, **key))
    until(lambda: served.witness() != before, "a commit to be seen")
    served.core.process.kill()
    first = asked.result()
    successor = guard.core().core
    again = successor.ask("POST", path, batch, **key)
    assert again.status == (201 if atomic else 200)
    assert first is None or again.body == first.body
    assert successor.ask("POST", path, batch, **key).body == again.body
    assert successor.ask("GET", "/api/ledger/accounts/food").body["balances"]["posted"] == str(LOT)


def test_a_core_that_was_stopped_for_a_while_and_is_still_the_core_serves_on(
    served: Wired, asking: ThreadPoolExecutor
) -> None:
    stop(served)
    asked = asking.submit(booked, served, "k-1")
    thaw(served)
    first = asked.result()
    assert first is not None
    assert first.status == 201
    assert served.core.move(6, "food", "bank").body["epoch"] == 1


@pytest.mark.parametrize("seed", SEEDS)
def test_stopped_at_any_moment_under_load_nothing_is_lost_doubled_or_answered_twice(
    guard: Guard, served: Wired, asking: ThreadPoolExecutor, seed: int
) -> None:
    spare = guard.spare()
    keys = [f"k-{n}" for n in range(400)]
    answers = {key: asking.submit(booked, served, key) for key in keys}
    moment = answers[keys[random.Random(seed).randrange(8, 200)]]
    until(moment.done, "some to be booked")
    stop(served)
    assert spare.promote(1, busy_ms=300) == {"ok": True}
    until(lambda: spare.has_said("READY") or spare.core.process.poll(), "the promotion to end")
    if not spare.has_said("READY"):
        # Stopped inside a transaction, it holds the store: whoever would follow has to leave, and it goes on.
        assert spare.core.ends_with() == 69
        thaw(served)
        assert all((one := asked.result()) is not None and one.status == 201 for asked in answers.values())
        return
    thaw(served)
    assert served.core.ends_with() == FENCED
    acknowledged = {key for key, asked in answers.items() if (one := asked.result()) and one.status == 201}
    for key in keys:
        again = booked(spare, key)
        assert again is not None
        assert again.status == 201
        assert key not in acknowledged or again.headers.get("idempotent-replayed") == "true"
    assert spare.order(verb="status")["seq"] == 2 + len(keys)
    spare.core.process.terminate()
    assert spare.core.ends_with() == 0
    assert verify(guard.data).returncode == 0
