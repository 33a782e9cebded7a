"""A spare and its promotion: the core's process alone, with the test in its guard's place."""

import json
import signal
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest
from websockets.sync.client import ClientConnection, unix_connect
from websockets.typing import Subprotocol

from core.build import own_build
from core.journal.schema import SCHEMA_VERSION
from hardcore.model.recorder import LifeState
from tests import stores
from tests.integration.lone_core import verify
from tests.integration.test_imports import form, statement
from tests.integration.wired_core import Guard, Wired, guarding
from tests.waiting import WAIT_S, until

REFUSED = {
    "promoted": {"ok": False, "error": "The spare was told to take over before."},
    "serving": {"ok": False, "error": "This core is no spare."},
    "waiting": {"ok": False, "error": "The core has not opened its book yet."},
}


@pytest.fixture
def guard(tmp_path: Path) -> Iterator[Guard]:
    with guarding(tmp_path) as made:
        yield made


@pytest.fixture
def served(guard: Guard) -> Wired:
    """A core of epoch 1 with three commits."""
    first = guard.core()
    assert first.core.open("cash").status == 201
    assert first.core.open("food", "expense").status == 201
    assert first.core.move(5, "food", "cash").status == 201
    return first


@contextmanager
def page_socket(life: Wired) -> Iterator[ClientConnection]:
    kind = [Subprotocol("hardcore.v1")]
    with unix_connect(str(life.folder / "sock"), "ws://core/ws", subprotocols=kind) as page:
        yield page


def import_shown(life: Wired) -> str:
    body, kind = form(statement(20, "row"), {"account": "cash"}, "bank.csv")
    answer = life.core.raw("POST", "/api/ledger/imports", body, Content_Type=kind)
    made: str = json.loads(answer)["id"]
    return made


def end(life: Wired) -> None:
    life.core.process.kill()
    life.core.ends_with()


def test_a_spare_says_what_it_is_and_serves_nothing_before_it_is_promoted(
    guard: Guard, served: Wired
) -> None:
    spare = guard.spare()
    assert spare.hears("X_SPARE") == {
        "X_SPARE": "1",
        "X_BUILD": own_build(),
        "X_CONTROL": "2",
        "X_SCHEMA": str(SCHEMA_VERSION),
    }
    assert spare.state() is LifeState.SPARE
    assert spare.page().beats.epoch == 0
    assert guard.epoch() == 1
    with pytest.raises(ConnectionRefusedError):
        spare.core.ask("GET", "/healthz")
    standing = {
        "epoch": 0,
        "seq": 3,
        "safe": None,
        "spare": True,
        "build": own_build(),
        "drained": False,
        "checkpoint": "",
    }
    assert spare.order(verb="status") == {"ok": True, "pid": spare.pid, **standing}
    assert spare.order(verb="drain", within_ms=100) == REFUSED["waiting"]
    assert not spare.has_said("READY")
    assert served.core.move(7, "food", "cash").status == 201, "the core goes on"


@pytest.mark.in_a_file  # its log
def test_a_waiting_spare_leaves_no_read_open_and_follows_the_head(guard: Guard, served: Wired) -> None:
    spare = guard.spare()
    for n in range(20):
        assert served.core.move(n + 1, "food", "cash").status == 201
    until(lambda: spare.order(verb="status")["seq"] == 23, "the spare to follow")

    def emptied() -> bool:
        # A read that is open keeps a log from being emptied: then this is busy, whenever it is asked.
        with closing(sqlite3.connect(guard.data / "ledger.db", timeout=5)) as store:
            busy, log, done = store.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()
        return (busy, log, done) == (0, 0, 0)

    until(emptied, "the log to be emptied")


def test_a_promoted_spare_serves_what_was_committed_under_the_next_epoch(guard: Guard, served: Wired) -> None:
    spare = guard.spare()
    before = served.core.ask("GET", "/api/ledger/accounts/cash").body
    seen = served.witness()
    end(served)
    assert spare.promote(1, seen) == {"ok": True}
    told = spare.hears("READY")
    assert (told["X_EPOCH"], told["X_SEQ"], told["X_PROOF"]) == ("2", "3", "witness")
    assert [next(iter(words)) for words in spare.heard if "WATCHDOG" not in words][:3] == [
        "X_SPARE",
        "X_EPOCH",
        "READY",
    ]
    assert guard.epoch() == 2
    assert spare.state() is LifeState.READY
    answer = spare.core.ask("GET", "/api/ledger/accounts/cash")
    assert (answer.body, answer.headers["x-core-epoch"]) == (before, "2")
    assert spare.core.move(9, "food", "cash").body["seq"] == 4
    assert spare.order(verb="status")["spare"] is False
    assert spare.promote(2) == REFUSED["promoted"]
    spare.hears("X_VERIFIED")
    spare.core.process.terminate()
    assert spare.core.ends_with() == 0
    assert verify(guard.data).returncode == 0


def test_who_serves_can_not_be_promoted_and_an_older_guard_gives_no_orders(
    guard: Guard, served: Wired
) -> None:
    assert served.promote(1) == REFUSED["serving"]
    spare = guard.spare()
    assert spare.order(verb="safe", on=True, reason="DISK_FULL", generation=5)["ok"] is False
    assert spare.promote(1, generation=4) == {
        "ok": False,
        "error": "Generation 4 is over: 5 gives the orders.",
    }
    assert guard.epoch() == 1


def test_a_spare_that_expects_another_epoch_leaves_as_a_start_would(guard: Guard, served: Wired) -> None:
    spare = guard.spare()
    end(served)
    assert guard.core().hears("READY")["X_EPOCH"] == "2"
    assert spare.promote(1) == {"ok": True}
    assert spare.core.ends_with() == 75
    assert guard.epoch() == 2


def test_a_spare_that_misses_a_commit_somebody_saw_does_not_serve(guard: Guard, served: Wired) -> None:
    spare = guard.spare()
    end(served)
    assert spare.promote(1, f"9:1:{'ab' * 32}") == {"ok": True}
    assert spare.core.ends_with() == 65
    assert spare.has_said("X_EPOCH")
    assert not spare.has_said("READY")
    words = spare.page().last_words
    assert words is not None
    assert words.code == "STORE_CORRUPT"


def test_a_spare_that_can_not_draw_a_page_leaves_with_its_name(guard: Guard, served: Wired) -> None:
    stores.tamper(guard.data, "UPDATE account SET type = 'none of ours' WHERE id = 'cash'")
    spare = guard.start(HARDCORE_SPARE="1")
    assert spare.core.ends_with() == 70
    words = spare.page().last_words
    assert words is not None
    assert words.code == "BUG"
    assert "drawing /" in words.text
    assert served.core.process.poll() is None, "the core goes on"
    assert not spare.has_said("X_SPARE")


def test_a_spare_waits_for_a_held_lock_as_long_as_it_was_told(guard: Guard, served: Wired) -> None:
    spare = guard.spare()
    end(served)
    with stores.locked(guard.data):
        assert spare.promote(1, busy_ms=50) == {"ok": True}
        assert spare.core.ends_with() == 69
    assert spare.hears("X_FENCE") == {"X_FENCE": "BLOCKED"}
    assert guard.epoch() == 1


def test_a_waiting_spare_leaves_when_it_is_asked_to(guard: Guard, served: Wired) -> None:
    spare = guard.spare()
    spare.core.process.terminate()
    assert spare.core.ends_with() == 0
    assert guard.epoch() == 1
    assert served.core.move(7, "food", "cash").status == 201


def test_a_spare_that_can_not_be_ordered_does_not_begin(tmp_path: Path, guard: Guard) -> None:
    for wrong in ({"HARDCORE_SPARE": "yes"}, {"HARDCORE_SPARE": "1", "HARDCORE_SAFE": "DISK_FULL"}):
        assert guard.start(**wrong).core.ends_with() == 78
    assert not (tmp_path / "data" / "ledger.db").exists()


def test_a_spare_is_ended_before_a_core_and_one_that_took_over_no_longer(guard: Guard, served: Wired) -> None:
    assert served.oom_score() == 300
    spare = guard.spare()
    assert spare.oom_score() == 800
    end(served)
    spare.promote(1)
    spare.hears("READY")
    assert spare.oom_score() == 300


def test_a_stopped_spare_takes_over_when_it_goes_on_unless_another_did(guard: Guard, served: Wired) -> None:
    slow, quick = guard.spare(), guard.spare()
    end(served)
    slow.core.process.send_signal(signal.SIGSTOP)
    assert quick.promote(1) == {"ok": True}
    quick.hears("READY")
    slow.core.process.send_signal(signal.SIGCONT)
    assert slow.promote(1) == {"ok": True}
    assert slow.core.ends_with() == 75
    assert quick.core.move(7, "food", "cash").status == 201


def imported(life: Wired) -> list[str]:
    """What it has imported since it began to wait, in its own words."""
    after = life.core.said().split("waits, at event", 1)[1]
    return [line for line in after.splitlines() if line.startswith("import time:")]


def test_a_spare_imports_nothing_any_more_once_it_waits(guard: Guard, served: Wired) -> None:
    spare = guard.spare(PYTHONPROFILEIMPORTTIME="1")
    assert "import time:" in spare.core.said(), "it tells what it imports"
    end(served)
    spare.promote(1)
    spare.hears("READY")
    core = spare.core
    for lang in ("ko", "en"):
        for path in (
            "/",
            "/register?q=a",
            "/accounts",
            "/import",
            "/entries/none",
            "/nowhere",
            "/api/openapi.json",
        ):
            core.raw("GET", path, Accept="text/html", Accept_Language=lang)
    assert core.ask("POST", "/api/ledger/accounts", b"nonsense").status == 400
    entry = {"date": "2026-11-21", "amount": "-5", "account": "cash", "category": "food", "description": "a"}
    made = core.ask("POST", "/api/ledger/entries", entry).body["id"]
    core.raw("GET", f"/entries/{made}", Accept="text/html")
    assert core.ask("DELETE", f"/api/ledger/entries/{made}").status == 200
    fields = {"Content_Type": "application/x-www-form-urlencoded", "Sec_Fetch_Site": "same-origin"}
    core.raw("POST", "/accounts", b"name=more&type=asset&currency=KRW&key=k-9", **fields)
    assert core.ask("GET", "/api/ledger/verify").body["ok"] is True
    with page_socket(spare) as page:
        assert core.move(5, "food", "cash").status == 201
        assert json.loads(page.recv(timeout=WAIT_S))["type"] == "ledger.hello"
        assert json.loads(page.recv(timeout=WAIT_S))["type"] == "ledger.transaction"
    shown = import_shown(spare)
    core.raw("GET", f"/import/{shown}", Accept="text/html")
    assert core.ask("POST", f"/api/ledger/imports/{shown}/preview", {"encoding": "utf-8"}).status == 200
    assert core.ask("POST", f"/api/ledger/imports/{shown}/commit", {}).status == 202
    until(lambda: core.ask("GET", f"/api/ledger/imports/{shown}").body["state"] == "done", "it to be booked")
    assert spare.order(verb="tasks")["ok"] is True
    spare.hears("X_VERIFIED")
    assert spare.drain()["ok"] is True
    assert imported(spare) == []
    core.process.terminate()
    assert core.ends_with() == 0
    assert imported(spare) == []
