"""A core that is drained for its successor, or that could not be and goes on: its process alone, on a guard's wires."""

import http.client
import json
import signal
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from websockets.sync.client import unix_connect
from websockets.typing import Subprotocol

from core.tenure import STOPPED_NS
from hardcore.model.recorder import LifeState
from tests import stores
from tests.integration.lone_core import Answer, verify
from tests.integration.test_imports import form, statement
from tests.integration.wired_core import Guard, Wired, guarding
from tests.waiting import WAIT_S, until

ROWS = 600
NOT_IN_TIME = "Not drained in time: "


@pytest.fixture
def guard(tmp_path: Path) -> Iterator[Guard]:
    with guarding(tmp_path) as made:
        yield made


@pytest.fixture
def served(guard: Guard) -> Wired:
    """A core of epoch 1 with three commits."""
    first = guard.core()
    assert first.core.open("bank").status == 201
    assert first.core.open("food", "expense").status == 201
    assert first.core.move(5, "food", "bank").status == 201
    return first


def import_begun(life: Wired, rows: int = ROWS) -> str:
    """Upload a file of so many rows and have it booked; returns its id at once."""
    body, kind = form(statement(rows, "row"), {"account": "bank"}, "bank.csv")
    connection = life.core.connect()
    connection.request("POST", "/api/ledger/imports", body, {"Content-Type": kind})
    answer = connection.getresponse()
    made: str = json.loads(answer.read())["id"]
    assert answer.status == 201
    assert life.core.ask("POST", f"/api/ledger/imports/{made}/commit", {}).status == 202
    return made


def progress(life: Wired, import_id: str) -> dict[str, Any]:
    told: dict[str, Any] = life.core.ask("GET", f"/api/ledger/imports/{import_id}").body
    return told


def test_a_drained_core_has_answered_everything_and_takes_nothing_new(guard: Guard, served: Wired) -> None:
    assert served.drain() == {"ok": True, "seq": 3}
    assert served.state() is LifeState.DRAINING
    for answer in (served.core.move(7, "food", "bank"), served.core.ask("GET", "/api/ledger/accounts/bank")):
        assert (answer.status, answer.headers["x-core-draining"]) == (503, "1")
    with stores.locked(guard.data, within_s=0):
        pass  # nobody has the store's lock, and nobody will
    assert served.drain() == {"ok": True, "seq": 3}, "an order that comes twice is done once"
    served.core.process.terminate()
    assert served.core.ends_with() == 0


def test_a_drained_core_says_so_and_no_other_does(guard: Guard, served: Wired) -> None:
    assert served.order(verb="status")["drained"] is False
    spare = guard.spare()
    assert served.drain()["ok"] is True
    told = served.order(verb="status")
    assert (told["drained"], told["epoch"], told["seq"]) == (True, 1, 3)
    spare.promote(1)
    spare.hears("READY")
    assert spare.order(verb="status")["drained"] is False


def test_a_drained_core_that_was_stopped_waits_for_its_term_with_the_sockets_of_pages_open(
    guard: Guard, served: Wired
) -> None:
    spare = guard.spare()
    with unix_connect(
        str(served.folder / "sock"), "ws://core/ws", subprotocols=[Subprotocol("hardcore.v1")]
    ) as page:
        assert json.loads(page.recv(timeout=WAIT_S))["type"] == "ledger.hello"
        assert served.drain()["ok"] is True
        assert spare.promote(1) == {"ok": True}
        spare.hears("READY")
        beats = served.page().beats.loop_count
        served.core.process.send_signal(signal.SIGSTOP)
        stopped_ns = time.monotonic_ns()
        until(lambda: time.monotonic_ns() - stopped_ns > 2 * STOPPED_NS, "it to be stopped for a while")
        served.core.process.send_signal(signal.SIGCONT)
        until(lambda: served.page().beats.loop_count > beats + 10, "it to go on")
        assert page.ping().wait(WAIT_S)
        assert served.core.process.poll() is None
        served.core.process.terminate()
        assert served.core.ends_with() == 0


def test_a_planned_switch_loses_nothing_and_the_old_core_leaves_when_told(
    guard: Guard, served: Wired
) -> None:
    spare = guard.spare()
    drained = served.drain()
    assert spare.promote(1, served.witness()) == {"ok": True}
    assert spare.hears("READY")["X_SEQ"] == str(drained["seq"])
    assert spare.core.move(7, "food", "bank").body["epoch"] == 2
    served.core.process.terminate()
    assert served.core.ends_with() == 0
    spare.core.process.terminate()
    assert spare.core.ends_with() == 0
    assert verify(guard.data).returncode == 0


def test_a_running_import_goes_on_at_its_next_row_in_the_promoted_core_once_the_suspects_are_named(
    guard: Guard, served: Wired
) -> None:
    spare = guard.spare(CORE_GUARDS_WORD_MS="60000")
    made = import_begun(served)
    until(lambda: progress(served, made)["done"] > 0, "the first rows to be booked")
    drained = served.drain()
    assert drained["ok"], drained
    assert 3 < drained["seq"] < 3 + ROWS, "in the middle of the file"
    spare.promote(1)
    spare.hears("READY")
    until(lambda: progress(spare, made)["done"] > 0, "the import to be taken up")
    waiting = progress(spare, made)["done"]
    assert spare.core.move(7, "food", "bank").status == 201, "who asks is served"
    assert progress(spare, made)["done"] == waiting < ROWS
    assert spare.order(verb="quarantine")["ok"] is True
    until(lambda: progress(spare, made)["state"] == "done", "the import to be done")
    told = progress(spare, made)
    assert told["rows"]["new"] == told["done"] == ROWS
    assert told["rows"]["duplicates"] == 0
    served.core.process.terminate()
    assert served.core.ends_with() == 0
    spare.core.process.terminate()
    assert spare.core.ends_with() == 0
    assert verify(guard.data).returncode == 0


def test_a_core_whose_writer_is_stuck_is_not_drained_and_serves_reads_as_before(
    served: Wired,
) -> None:
    assert served.order(verb="drill", fault="slow-tx") == {"ok": True}
    until(served.reader.in_flight, "the drill to be at work")
    assert served.drain(200) == {"ok": False, "error": f"{NOT_IN_TIME}requests are not answered."}
    assert served.state() is LifeState.READY
    assert served.core.ask("GET", "/api/ledger/accounts/bank").status == 200
    assert "UNDRAINED" in served.events()


def test_what_a_drain_has_held_up_goes_on_when_it_is_taken_back(guard: Guard, served: Wired) -> None:
    with stores.locked(guard.data) as holder:
        made = import_begun(served, 40)
        with ThreadPoolExecutor(1) as asking:
            booked = asking.submit(served.core.move, 7, "food", "bank", Idempotency_Key="k-1")
            until(lambda: len(served.reader.in_flight() or ()) > 1, "all to wait for the lock")
            refused = served.drain(50)
            assert refused["ok"] is False
            assert refused["error"].startswith(NOT_IN_TIME)
            holder.execute("ROLLBACK")
            first = booked.result()
    if first.status == 503:  # it has waited for the lock for as long as a batch may
        first = served.core.move(7, "food", "bank", Idempotency_Key="k-1")
    assert first.status == 201
    until(lambda: progress(served, made)["state"] == "done", "the import to be done")
    assert progress(served, made)["rows"]["new"] == 40
    assert served.core.move(8, "food", "bank").status == 201
    assert served.drain()["ok"] is True


def test_a_core_that_serves_reads_only_is_drained_as_well(guard: Guard, served: Wired) -> None:
    assert served.order(verb="safe", on=True, reason="DISK_FULL") == {"ok": True}
    assert served.drain() == {"ok": True, "seq": 3}
    served.core.process.kill()
    served.core.ends_with()
    reading = guard.core(HARDCORE_SAFE="DISK_FULL")
    assert reading.drain() == {"ok": True, "seq": 3}
    assert reading.core.ask("GET", "/api/ledger/accounts").status == 503
    reading.core.process.terminate()
    assert reading.core.ends_with() == 0


def test_a_core_that_is_told_to_leave_while_it_is_drained_leaves(guard: Guard, served: Wired) -> None:
    with stores.locked(guard.data) as holder, ThreadPoolExecutor(2) as asking:
        booking = asking.submit(_tried, served)
        until(served.reader.in_flight, "it to wait for the lock")
        draining = asking.submit(_told, served)
        until(lambda: served.state() is LifeState.DRAINING, "the drain to begin")
        served.core.process.terminate()
        holder.execute("ROLLBACK")
        assert served.core.ends_with() == 0
        answered = booking.result()
        draining.result()
    after = guard.core()
    booked = after.core.ask("GET", "/api/ledger/commands/k-1").status == 200
    assert booked is (answered is not None and answered.status == 201)


def _tried(life: Wired) -> Answer | None:
    try:
        return life.core.move(7, "food", "bank", Idempotency_Key="k-1")
    except (OSError, http.client.HTTPException):
        return None


def _told(life: Wired) -> dict[str, Any] | None:
    try:
        return life.drain()
    except (OSError, ValueError):
        return None  # it was gone before it could say anything


def test_the_sockets_of_open_pages_stay_open_over_a_drain(served: Wired) -> None:
    with unix_connect(
        str(served.folder / "sock"), "ws://core/ws", subprotocols=[Subprotocol("hardcore.v1")]
    ) as page:
        assert json.loads(page.recv(timeout=WAIT_S))["type"] == "ledger.hello"
        assert served.drain()["ok"] is True
        assert page.ping().wait(WAIT_S)
        served.core.process.send_signal(signal.SIGTERM)
        assert served.core.ends_with() == 0
