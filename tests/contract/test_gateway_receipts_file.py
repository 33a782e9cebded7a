"""The file of the promises: what is in it is found again, whatever kept it from being read, and whoever else writes it."""

import contextlib
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

from tests.contract.gateway_world import Core, World
from tests.contract.receipts_world import (
    COOKIE,
    LOOK_UP,
    Ledger,
    becomes,
    has_read,
    hold,
    kill,
    promised,
    promising,
    receipt,
    sent,
    serve,
    small_disk,
    wish,
)
from tests.waiting import until

PATH = "/api/ledger/t"


@contextlib.contextmanager
def nobody_reads(file: Path) -> Iterator[None]:
    """Somebody has the file for himself."""
    with closing(sqlite3.connect(file, isolation_level=None, timeout=20)) as lock:
        lock.execute("PRAGMA locking_mode = EXCLUSIVE")
        lock.execute("BEGIN EXCLUSIVE")
        yield
        lock.execute("ROLLBACK")


def begin_anew(w: World) -> None:
    """Another gateway begins; whether it can read its receipts is not waited for."""
    kill(w)
    known = len(w.feed.subscribed)
    w.start()
    w.feed.wait_subscribed(known + 1)


def cancelled(w: World, ledger: Ledger, epoch: int) -> Core:
    """k1 is promised, and a person cancels it."""
    promised(w, "k1")
    core = serve(w, ledger, epoch)
    becomes(w, "k1", "ask")
    assert w.ask("POST", "/__hc/receipts/k1/cancel", body=b"").json()["outcome"] == "not_done"
    return core


def test_what_is_promised_is_found_behind_somebody_elses_lock(tmp_path: Path) -> None:
    with promising(tmp_path, receipt_store_ms=200) as w:
        hold(w)
        promised(w, "k1")
        kill(w)
        with nobody_reads(tmp_path / "receipts.db"):
            begin_anew(w)
            has_read(w)
            assert w.ask("GET", "/__hc/receipts/k1").json()["type"] == "/problems/receipts-away"
        ledger = Ledger()
        serve(w, ledger, 2)
        until(lambda: w.ask("GET", "/__hc/receipts/k1").status == 200, "the receipts to be read")
        becomes(w, "k1", "done")
        assert ledger.booked == ["k1"]


def test_what_is_promised_is_found_on_a_full_disk(tmp_path: Path) -> None:
    with small_disk(tmp_path) as place, promising(tmp_path, place / "receipts.db") as w:
        hold(w)
        promised(w, "k1")
        kill(w)
        with (place / "fill").open("wb", buffering=0) as fill, contextlib.suppress(OSError):
            while True:
                fill.write(b"x" * 1024)
        begin_anew(w)
        has_read(w)
        assert receipt(w, "k1")["outcome"] == "waiting"
        (place / "fill").unlink()
        ledger = Ledger()
        serve(w, ledger, 2)
        becomes(w, "k1", "done")
        assert ledger.booked == ["k1"]


def test_a_cancelled_wish_never_runs_also_while_the_file_is_not_read(tmp_path: Path) -> None:
    with promising(tmp_path, receipt_ask_after_ms=0, receipt_store_ms=200) as w:
        hold(w)
        ledger = Ledger()
        core = cancelled(w, ledger, 2)
        kill(w)
        copy = ("POST", PATH, "Idempotency-Key: k1", COOKIE)
        with nobody_reads(tmp_path / "receipts.db"):
            begin_anew(w)
            w.feed.serve(core)
            told = w.ask(*copy, body=b'{"a":1}')
            assert (told.status, told.json()["type"]) == (503, "/problems/receipts-away")
            assert w.ask("GET", "/read").status == 200  # nobody else waits for it
        until(lambda: w.ask(*copy, body=b'{"a":1}').status == 409, "its receipt to be read")
        assert w.ask(*copy, body=b'{"a":1}').json()["outcome"] == "not_done"
        assert (ledger.booked, sent(core, "k1")) == ([], [])


def test_a_cancelled_wish_that_comes_before_the_file_is_read_waits_for_that(tmp_path: Path) -> None:
    with promising(tmp_path, receipt_ask_after_ms=0, receipt_store_ms=20_000) as w:
        hold(w)
        ledger = Ledger()
        core = cancelled(w, ledger, 2)
        kill(w)
        with nobody_reads(tmp_path / "receipts.db"):
            begin_anew(w)
            w.feed.serve(core)
            early = w.client().ask("POST", PATH, "Idempotency-Key: k1", COOKIE, body=b'{"a":1}')
            other = w.client().ask("POST", PATH, "Idempotency-Key: k2", COOKIE, body=b'{"a":1}')
            assert w.ask("GET", "/read").status == 200
        assert (early.read().status, other.read().status) == (409, 201)
        assert ledger.booked == ["k2"]


def test_a_file_that_is_none_of_ours_holds_nobody_up_and_is_left_as_it_is(tmp_path: Path) -> None:
    file = tmp_path / "receipts.db"
    file.write_bytes(b"a letter to my bank" * 100)
    with promising(tmp_path) as w:
        hold(w)
        assert wish(w, "k1").read().json()["outcome"] == "not_done"
        ledger = Ledger()
        serve(w, ledger, 2)
        assert wish(w, "k2").read().status == 201
        assert file.read_bytes() == b"a letter to my bank" * 100


def test_no_secret_outlives_its_outcome_and_what_opens_doors_is_never_written(tmp_path: Path) -> None:
    with promising(tmp_path) as w:
        hold(w)
        promised(w, "k1", "Authorization: Bearer CANARY-1", "X-Pin: CANARY-2")

        def stands(secret: bytes) -> bool:
            return any(secret in file.read_bytes() for file in tmp_path.glob("receipts.db*"))

        assert (stands(b"CANARY-1"), stands(b"CANARY-2")) == (False, True)
        core = serve(w, Ledger(), 2)
        becomes(w, "k1", "done")
        (call,) = core.wait(PATH)
        assert (call.request.header("X-Pin"), call.request.header("Authorization")) == ("CANARY-2", None)
        until(lambda: not stands(b"CANARY-2"), "the header to be gone")


def test_a_file_of_the_version_before_is_read_and_written_on(tmp_path: Path) -> None:
    with promising(tmp_path) as w:
        hold(w)
        promised(w, "k1")
        kill(w)
        with closing(sqlite3.connect(tmp_path / "receipts.db", isolation_level=None)) as old:
            old.execute("ALTER TABLE receipts DROP COLUMN sent_epoch")
            old.execute("PRAGMA user_version = 1")
        begin_anew(w)
        has_read(w)
        w.feed.hold()
        promised(w, "k2")
        ledger = Ledger()
        serve(w, ledger, 2)
        becomes(w, "k2", "done")
        assert ledger.booked == ["k1", "k2"]


# -- two gateways ----------------------------------------------------------------------------------------


def test_what_another_gateway_has_promised_is_kept_by_the_one_that_stays(tmp_path: Path) -> None:
    with promising(tmp_path) as w:
        hold(w)
        promised(w, "k1")
        older = w.process
        assert older is not None
        known = len(w.feed.subscribed)
        w.start()
        try:
            w.feed.wait_subscribed(known + 1)
            for number in range(6):  # either of them may take each
                promised(w, f"m{number}")
        finally:
            older.terminate()
            older.wait(20)
        w.feed.hold()
        ledger = Ledger()
        serve(w, ledger, 2)
        for key in ("k1", *(f"m{number}" for number in range(6))):
            becomes(w, key, "done")
        assert sorted(ledger.booked) == ["k1", *(f"m{number}" for number in range(6))]


def test_what_another_gateway_has_settled_is_not_sent(tmp_path: Path) -> None:
    with promising(tmp_path) as w:
        hold(w)
        promised(w, "k1")
        with closing(sqlite3.connect(tmp_path / "receipts.db", isolation_level=None, timeout=20)) as other:
            other.execute("UPDATE receipts SET outcome = 'not_done', body = NULL WHERE key = 'k1'")
            ledger = Ledger()
            core = serve(w, ledger, 2)
            becomes(w, "k1", "not_done")
            assert (sent(core, "k1"), ledger.booked) == ([], [])


def test_which_core_has_it_is_on_the_disk_before_it_has(tmp_path: Path) -> None:
    with promising(tmp_path) as w:
        hold(w)
        promised(w, "k1")
        core = serve(w, Ledger(before=lambda _: True), 2)
        core.wait(PATH)
        with closing(sqlite3.connect(f"file:{tmp_path / 'receipts.db'}?mode=ro", uri=True)) as look:
            assert look.execute("SELECT sent_epoch FROM receipts").fetchall() == [(2,)]


def test_a_receipt_that_the_disk_does_not_let_be_claimed_is_not_sent(tmp_path: Path) -> None:
    with promising(tmp_path) as w:
        hold(w)
        promised(w, "k1")
        with closing(sqlite3.connect(tmp_path / "receipts.db", isolation_level=None, timeout=20)) as lock:
            lock.execute("BEGIN IMMEDIATE")
            ledger = Ledger()
            core = serve(w, ledger, 2)
            core.wait(f"{LOOK_UP}k1", 2)
            assert sent(core, "k1") == []
            lock.execute("ROLLBACK")
            becomes(w, "k1", "done")
            assert ledger.booked == ["k1"]
