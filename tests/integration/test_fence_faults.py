"""The fence, and what stands before it, on a disk that fails: with a spare whose readers were open at the death.

The faults are put into the system calls of one process by strace, so the store and the disk are real ones.
"""

import shutil
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import pytest

from tests import stores
from tests.integration.lone_core import Answer, Core, moving, verify
from tests.integration.wired_core import Guard, Wired, guarding
from tests.waiting import until

STRACE = shutil.which("strace")
pytestmark = [pytest.mark.skipif(STRACE is None, reason="no strace here")]

ONE_FLUSH: Final = "fdatasync:error=EIO:when=1"
EVERY_FLUSH: Final = "fsync,fdatasync:error=EIO"
TAKEN_OVER: Final = 75


@pytest.fixture
def guard(tmp_path: Path) -> Iterator[Guard]:
    with guarding(tmp_path) as made:
        yield made


@pytest.fixture
def served(guard: Guard) -> Wired:
    first = guard.core()
    assert first.core.open("cash").status == 201
    assert first.core.open("food", "expense").status == 201
    assert book(first.core, "before").status == 201
    return first


@contextmanager
def failing(life: Wired, injected: str) -> Iterator[None]:
    """Trace a process, with an error in some of its system calls."""
    argv = [STRACE or "strace", "-f", "-q", "-o", "/dev/null", "-p", str(life.pid), f"--inject={injected}"]
    with subprocess.Popen(argv) as tracer:
        try:
            traced = Path(f"/proc/{life.pid}/status")
            until(lambda: f"TracerPid:\t{tracer.pid}" in traced.read_text(), "the core to be traced")
            yield
        finally:
            tracer.terminate()


def book(core: Core, key: str) -> Answer:
    return core.ask("POST", "/api/ledger/transactions", moving(5, "food", "cash"), **{"Idempotency-Key": key})


def outcome(core: Core, key: str) -> str:
    body = core.ask("GET", f"/api/ledger/commands/{key}").body
    found: str = body["outcome"]
    return found


def booked(core: Core) -> list[str]:
    events = core.ask("GET", "/api/ledger/events").body["items"]
    return [event["key"] for event in events if event["kind"] == "transaction.posted"]


def kill(*lives: Wired) -> None:
    for life in lives:
        life.core.process.kill()
        life.core.ends_with()


def fails_a_commit(life: Wired, key: str) -> None:
    with failing(life, ONE_FLUSH):
        answer = book(life.core, key)
        assert (answer.status, answer.body["outcome"]) == (503, "unknown")
        assert life.core.ends_with() == 74
    words = life.page().last_words
    assert words is not None
    assert words.code == "COMMIT_FAILED"


@pytest.mark.in_a_file  # a server flushes its own disk
@pytest.mark.parametrize("readers_open", [True, False])
def test_what_became_of_a_commit_that_raised_is_said_after_the_next_fence_and_stays_so(
    guard: Guard, served: Wired, *, readers_open: bool
) -> None:
    """A row whose flush failed may come back or not; what is said of it by a later epoch is true for ever."""
    spare = guard.spare() if readers_open else None
    seen = served.witness()
    fails_a_commit(served, "ghost")
    if spare is None:
        successor = guard.core(HARDCORE_EPOCH="1", HARDCORE_WITNESS=seen)
    else:
        successor = spare
        assert spare.promote(1, seen) == {"ok": True}
    assert successor.hears("READY")["X_EPOCH"] == "2"
    said = outcome(successor.core, "ghost")
    kept = booked(successor.core)
    assert kept == ["before", "ghost"] if said == "done" else ["before"]
    kill(successor)
    last = guard.core(HARDCORE_EPOCH="2")
    assert (outcome(last.core, "ghost"), booked(last.core)) == (said, kept)
    again = book(last.core, "ghost")
    assert (again.status, again.headers.get("idempotent-replayed") == "true") == (201, said == "done")
    assert booked(last.core) == ["before", "ghost"]
    assert verify(guard.data).returncode == 0


@pytest.mark.in_a_file
def test_a_commit_that_raised_is_not_seen_by_those_who_had_the_store_open(
    guard: Guard, served: Wired
) -> None:
    spare = guard.spare()
    fails_a_commit(served, "ghost")
    until(lambda: spare.order(verb="status")["seq"] == 3, "the spare to look at the store")
    assert spare.promote(1) == {"ok": True}
    spare.hears("READY")
    assert outcome(spare.core, "ghost") == "not_done"


@pytest.mark.in_a_file
@pytest.mark.parametrize(("injected", "code"), [(ONE_FLUSH, 74), (EVERY_FLUSH, 73)])
def test_a_spare_whose_fence_can_not_be_flushed_serves_nobody_and_the_next_one_does(
    guard: Guard, served: Wired, injected: str, code: int
) -> None:
    first, second = guard.spare(), guard.spare()
    seen = served.witness()
    kill(served)
    with failing(first, injected):
        assert first.promote(1, seen) == {"ok": True}
        assert first.core.ends_with() == code
    assert not first.has_said("READY")
    assert not first.has_said("X_EPOCH")
    # It may have raised the epoch without living to say so: nobody can expect one now.
    assert second.promote(None, seen) == {"ok": True}
    ready = second.hears("READY")
    assert int(ready["X_EPOCH"]) in {2, 3}
    assert ready["X_PROOF"] == "witness"
    assert book(second.core, "after").status == 201
    assert booked(second.core) == ["before", "after"]
    assert verify(guard.data).returncode == 0


def test_two_spares_that_are_promoted_from_one_epoch_make_one_core(guard: Guard, served: Wired) -> None:
    spares = [guard.spare(), guard.spare()]
    kill(served)
    for spare in spares:
        assert spare.promote(1) == {"ok": True}

    def settled() -> bool:
        return any(spare.has_said("READY") for spare in spares) and any(
            spare.core.process.poll() is not None for spare in spares
        )

    until(settled, "one to serve and one to leave")
    core, other = sorted(spares, key=lambda spare: spare.core.process.poll() is not None)
    assert other.core.ends_with() == TAKEN_OVER
    assert core.hears("READY")["X_EPOCH"] == "2"
    assert not other.has_said("X_EPOCH")
    assert book(core.core, "after").headers["x-core-epoch"] == "2"
    assert guard.epoch() == 2


def test_each_witness_is_asked_and_the_one_that_objects_is_named(guard: Guard, served: Wired) -> None:
    seen = served.witness()
    seq, epoch, _ = seen.split(":")
    kill(served)
    for witnesses, says in (
        (f"{seen},9:{epoch}:{'ab' * 32}", "event 9 had been committed, as witness 2 of 2, of epoch 1"),
        (f"{seq}:7:{'ab' * 32},{seen}", f"event {seq} is not the one"),
    ):
        life = guard.start(HARDCORE_WITNESS=witnesses)
        assert life.core.ends_with() == 65
        assert says in life.core.said()
    assert guard.core(HARDCORE_WITNESS=f"{seen},{seen}").hears("READY")["X_PROOF"] == "witness"


def test_an_answer_says_what_it_has_booked_and_a_replay_says_nothing_of_this_life(
    guard: Guard, served: Wired
) -> None:
    fresh = book(served.core, "k")
    assert fresh.headers["x-core-commit"] == f"{fresh.body['seq']}:{fresh.body['hash']}"
    assert "x-core-commit" not in book(served.core, "k").headers
    assert "x-core-commit" not in served.core.open("cash").headers
    assert "x-core-commit" not in served.core.ask("GET", "/api/ledger/accounts").headers
    opened = served.core.open("gifts", "expense")
    assert opened.headers["x-core-commit"].startswith("5:")
    seq, digest = opened.headers["x-core-commit"].split(":")
    kill(served)
    life = guard.core(HARDCORE_WITNESS=f"{seq}:1:{digest}")
    assert life.hears("READY")["X_PROOF"] == "witness"


@pytest.mark.parametrize("waits", [True, False])
def test_a_spare_that_meets_a_broken_chain_tells_it_and_is_none(
    guard: Guard, served: Wired, *, waits: bool
) -> None:
    spare = guard.spare() if waits else None
    if spare is not None:
        spare.core.process.send_signal(signal.SIGSTOP)  # else it may have read the event before it was broken
    assert book(served.core, "after").status == 201
    stores.tamper(guard.data, "UPDATE event SET body = hash WHERE seq = 4")
    if spare is not None:
        spare.core.process.send_signal(signal.SIGCONT)
    met = spare or guard.start(HARDCORE_SPARE="1")
    assert "the hash of event 4 does not follow" in met.hears("X_UNSOUND")["X_UNSOUND"]
    assert met.core.ends_with() == 65
    words = met.page().last_words
    assert words is not None
    assert words.code == "STORE_CORRUPT"
    assert met.has_said("X_SPARE") == waits
    assert not met.has_said("X_EPOCH")


def test_a_promoted_spare_has_seen_the_book_before_and_hashes_what_came_since(
    guard: Guard, served: Wired
) -> None:
    spare = guard.spare()
    until(lambda: spare.order(verb="status")["seq"] == 3, "the spare to follow")
    assert book(served.core, "late").status == 201
    seen = served.witness()
    kill(served)
    assert spare.promote(1, seen) == {"ok": True}
    ready = spare.hears("READY")
    assert (ready["X_SEQ"], ready["X_TAIL"], ready["X_PROOF"]) == ("4", "4", "witness")
