"""The core's own look at all of its ledger, behind the serving: told once, and never in anybody's way."""

import asyncio
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from core.audit import audit_behind
from core.auditor import Auditor
from core.guarded.beacon import Beacon
from core.journal.store import LEDGER_FILE, open_reading
from core.service import Service
from core.settings import Settings
from tests.unit.core.books import Pen, moving, opening, order, tamper
from tests.unit.core.test_writer import Heard, writing

AT_ONCE = Settings(verify_after_ms=0, verify_rest_ms=0, verify_again_ms=10)


@contextmanager
def ear(folder: Path) -> Iterator[socket.socket]:
    """A guard's notify socket."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) as listening:
        listening.bind(str(folder / "notify"))
        yield listening


def said(folder: Path, break_it: str = "", *, leave: bool = False) -> list[bytes]:
    """What a core that serves a small book tells its guard."""
    made = Pen(folder)
    made.carry_out(opening("a"), opening("b"))
    made.write(*[order(moving(n, "a", "b"), f"k{n}") for n in range(1, 9)])
    if break_it:
        tamper(folder, break_it)

    async def audited(beacon: Beacon) -> None:
        async with writing(made, Heard()) as writer:
            readers = open_reading(folder / LEDGER_FILE, 2, 1_000)
            service = Service(writer, readers, made.recorder, AT_ONCE, made.epoch)
            if leave:
                service.drain()
            await audit_behind(service, beacon)
            service.drain()
            await service.close()

    with ear(folder) as listening:
        beacon = Beacon(str(folder / "notify"))
        asyncio.run(audited(beacon))
        beacon.close()
        return list(iter(lambda: _next(listening), b""))


def _next(listening: socket.socket) -> bytes:
    try:
        return listening.recv(4096)
    except BlockingIOError:
        return b""


def test_a_whole_ledger_is_told_with_its_last_number(tmp_path: Path) -> None:
    assert said(tmp_path) == [b"X_VERIFIED=10"]


def test_a_ledger_that_is_not_whole_is_told_with_the_place_and_the_next_step(tmp_path: Path) -> None:
    (told,) = said(tmp_path, "UPDATE posting SET amount = amount + 1 WHERE seq = 5 AND line = 0")
    assert told == (
        b"X_UNSOUND=The ledger is not whole: what is listed for event 5 is not what the event says. "
        b"Nothing was changed; compare with a backup before going on."
    )


def test_a_core_that_leaves_says_nothing_of_a_proof_that_it_did_not_end(tmp_path: Path) -> None:
    assert said(tmp_path, leave=True) == []


def test_a_proof_that_raises_is_said_in_the_log_and_to_the_guard(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    async def raising(_auditor: Auditor) -> None:
        raise KeyError("account")

    monkeypatch.setattr(Auditor, "verify_behind", raising)
    (told,) = said(tmp_path)
    assert told.startswith(b"X_UNSOUND=The ledger can't be proven, its proof fails (KeyError: 'account').")
    assert sum(record.exc_info is not None for record in caplog.records) == 2, "once more, then it is said"
