"""Promises: given once they are on the disk, kept once, over the death of everybody in between."""

import contextlib
import resource
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from tests.contract.gateway_world import World, key_hash
from tests.contract.receipts_world import (
    ASYNC,
    FORM,
    LOOK_UP,
    TAB,
    Ledger,
    becomes,
    hangs_up,
    has_read,
    hold,
    kill,
    name_of,
    promised,
    promising,
    reborn,
    receipt,
    saying,
    sent,
    serve,
    small_disk,
    wish,
)
from tests.contract.socket_world import live
from tests.waiting import until

ME = ("Cookie", "__hc=me")
PATH = "/api/ledger/t"


@pytest.fixture
def w(tmp_path: Path) -> Iterator[World]:
    """A world in an outage."""
    with promising(tmp_path) as made:
        hold(made)
        yield made


# -- who gets a promise ----------------------------------------------------------------------------------


def test_who_takes_a_promise_gets_one_after_the_hold_and_it_is_kept_once(w: World) -> None:
    answer = promised(w, "k1")
    assert answer.header("Location") == "/__hc/receipts/k1"
    assert answer.header("Preference-Applied") == "respond-async"
    waits = receipt(w, "k1")
    assert (waits["outcome"], waits["method"], waits["path"]) == ("waiting", "POST", PATH)
    ledger = Ledger()
    core = serve(w, ledger, 2)
    done = becomes(w, "k1", "done")
    assert (done["status"], done["answer"], ledger.booked) == (201, {"id": "t-k1"}, ["k1"])
    assert core.targets() == [f"{LOOK_UP}k1", PATH]  # looked up first
    assert core.calls.all()[1].request.body == b'{"a":1}'


@pytest.mark.parametrize(
    "headers",
    [
        pytest.param(("Idempotency-Key: k1",), id="no promise asked for"),
        pytest.param((ASYNC,), id="no key"),
        pytest.param((ASYNC, "Idempotency-Key: k 1"), id="no key that the ledger takes"),
    ],
)
def test_to_anybody_else_a_503_is_final(w: World, headers: tuple[str, ...]) -> None:
    answer = w.ask("POST", PATH, *headers, body=b"a")
    assert (answer.status, answer.json()["outcome"]) == (503, "not_done")
    core = serve(w, Ledger(), 2)
    assert w.ask("GET", "/later").status == 200
    assert core.targets() == ["/later"]


def test_a_body_that_is_not_kept_whole_is_not_promised(tmp_path: Path) -> None:
    with promising(tmp_path, replay_body_bytes_max=10) as w:
        hold(w)
        answer = wish(w, "k1", body=b"x" * 11).read()
        assert (answer.status, answer.json()["outcome"]) == (503, "not_done")
        assert w.ask("GET", "/__hc/receipts/k1").status == 404


@pytest.mark.parametrize(
    "limits", [{"receipts_max": 2}, {"receipts_per_browser_max": 2}, {"receipt_bytes_max": 800}]
)
def test_no_more_is_promised_than_there_is_room_for(tmp_path: Path, limits: dict[str, int]) -> None:
    with promising(tmp_path, **limits) as w:
        hold(w)
        body = b"x" * 250
        promised(w, "k1", body=body)
        promised(w, "k2", body=body)
        answer = wish(w, "k3", body=body).read()
        assert (answer.status, answer.json()["outcome"]) == (503, "not_done")
        ledger = Ledger()
        serve(w, ledger, 2)
        becomes(w, "k2", "done")
        assert ledger.booked == ["k1", "k2"]


def test_without_a_place_for_receipts_nothing_is_promised(tmp_path: Path) -> None:
    folder = tmp_path / "taken"
    folder.mkdir()
    with promising(tmp_path, folder) as w:
        hold(w)
        answer = wish(w, "k1").read()
        assert (answer.status, answer.json()["outcome"]) == (503, "not_done")
        assert w.ask("GET", "/__hc/receipts/k1").json()["type"] == "/problems/receipts-away"


# -- the disk --------------------------------------------------------------------------------------------


def test_what_a_full_disk_did_not_take_is_not_done_and_never_runs(tmp_path: Path) -> None:
    with small_disk(tmp_path) as place, promising(tmp_path, place / "receipts.db") as w:
        hold(w)
        promised(w, "k1")
        answer = wish(w, "k2", body=b"x" * 200_000).read()
        assert (answer.status, answer.json()["outcome"]) == (503, "not_done")
        reborn(w)
        assert w.ask("GET", "/__hc/receipts/k2").status == 404
        ledger = Ledger()
        serve(w, ledger, 2)
        becomes(w, "k1", "done")
        assert ledger.booked == ["k1"]


def test_a_disk_that_does_not_say_whether_it_stored_leaves_the_outcome_unknown(w: World) -> None:
    promised(w, "k1")
    assert w.process is not None
    resource.prlimit(w.process.pid, resource.RLIMIT_FSIZE, (4096, 4096))  # a write beyond it is an I/O error
    answer = wish(w, "k2").read()
    assert (answer.status, answer.json()["outcome"]) == (503, "unknown")
    assert answer.json()["type"] == "/problems/promise-unknown"


def test_what_somebody_elses_lock_kept_from_the_disk_is_not_done(tmp_path: Path, w: World) -> None:
    promised(w, "k1")
    lock = sqlite3.connect(tmp_path / "receipts.db", isolation_level=None)
    try:
        lock.execute("BEGIN IMMEDIATE")
        answer = wish(w, "k2").read()
        assert (answer.status, answer.json()["outcome"]) == (503, "not_done")
        lock.execute("ROLLBACK")
        promised(w, "k2")
    finally:
        lock.close()


def test_nobody_else_may_read_what_is_kept_and_no_body_outlives_its_outcome(tmp_path: Path, w: World) -> None:
    promised(w, "k1", body=b'{"secret":"rosebud"}')
    files = list(tmp_path.glob("receipts.db*"))
    assert files
    assert all(file.stat().st_mode & 0o077 == 0 for file in files)
    assert any(b"rosebud" in file.read_bytes() for file in files)
    serve(w, Ledger(), 2)
    becomes(w, "k1", "done")
    until(
        lambda: not any(b"rosebud" in file.read_bytes() for file in tmp_path.glob("receipts.db*")),
        "the body to be gone",
    )


# -- the death of the gateway ----------------------------------------------------------------------------


def test_a_gateway_that_dies_while_it_stores_a_promise_has_given_none(tmp_path: Path, w: World) -> None:
    promised(w, "k0")
    lock = sqlite3.connect(tmp_path / "receipts.db", isolation_level=None)
    try:
        lock.execute("BEGIN IMMEDIATE")
        client = w.client().ask("GET", "/livez")
        assert client.read().status == 200  # it is taken, so it ends with the gateway
        client.ask("POST", PATH, "Idempotency-Key: k1", ASYNC, body=b"a")
        w.wait_held(1)
        kill(w)
        assert client.closed()
    finally:
        lock.close()
    reborn(w)
    assert w.ask("GET", "/__hc/receipts/k1").status == 404
    ledger = Ledger()
    serve(w, ledger, 2)
    becomes(w, "k0", "done")
    assert ledger.booked == ["k0"]


def test_a_promise_that_is_on_the_disk_is_kept_whether_or_not_anybody_heard_it(
    tmp_path: Path, w: World
) -> None:
    client = wish(w, "k1")

    def stored() -> bool:
        with (
            contextlib.suppress(sqlite3.OperationalError),  # the first promise makes the file
            closing(sqlite3.connect(f"file:{tmp_path / 'receipts.db'}?mode=ro", uri=True)) as look,
        ):
            (count,) = look.execute("SELECT count(*) FROM receipts").fetchone()
            return bool(count == 1)
        return False

    until(stored, "the promise to be on the disk")
    reborn(w)
    client.close()
    ledger = Ledger()
    serve(w, ledger, 2)
    becomes(w, "k1", "done")
    assert ledger.booked == ["k1"]


def test_what_waits_is_run_by_the_next_gateway(w: World) -> None:
    promised(w, "k1")
    promised(w, "k2")
    reborn(w)
    assert receipt(w, "k1")["outcome"] == "waiting"
    ledger = Ledger()
    serve(w, ledger, 2)
    becomes(w, "k2", "done")
    assert ledger.booked == ["k1", "k2"]


def test_a_gateway_that_dies_while_a_receipt_runs_leaves_it_to_the_next(w: World) -> None:
    promised(w, "k1")
    ledger = Ledger(before=lambda _: True)  # the core has it, and has not begun
    core = serve(w, ledger, 2)
    core.wait(PATH)
    ledger.before = lambda _: False
    reborn(w, core)
    core.wait(f"{LOOK_UP}k1", 3)  # the next one knows who has it, and only asks
    assert (len(sent(core, "k1")), ledger.booked) == (1, [])
    w.die(core)
    serve(w, ledger, 3)
    becomes(w, "k1", "done")
    assert ledger.booked == ["k1"]


def test_a_gateway_that_dies_between_commit_and_answer_finds_it_done(w: World) -> None:
    promised(w, "k1")
    ledger = Ledger(after=lambda _: True)  # committed, and no answer
    core = serve(w, ledger, 2)
    until(lambda: ledger.booked, "the commit")
    ledger.after = lambda _: False
    reborn(w, core)
    told = becomes(w, "k1", "already_done")
    assert (told["status"], told["answer"], ledger.booked) == (201, {"id": "t-k1"}, ["k1"])
    assert len(sent(core, "k1")) == 1


def test_what_became_of_it_is_known_to_the_next_gateway_too(w: World) -> None:
    promised(w, "k1")
    ledger = Ledger()
    core = serve(w, ledger, 2)
    becomes(w, "k1", "done")
    reborn(w, core)
    assert receipt(w, "k1")["outcome"] == "done"
    assert w.ask("GET", "/later").status == 200
    assert len(sent(core, "k1")) == 1


# -- the death of the core -------------------------------------------------------------------------------


def test_a_core_that_dies_before_the_commit_leaves_it_to_the_next(w: World) -> None:
    promised(w, "k1")
    ledger = Ledger(before=hangs_up)
    core = serve(w, ledger, 2)
    core.wait(PATH)
    w.die(core)
    ledger.before = lambda _: False
    serve(w, ledger, 3)
    becomes(w, "k1", "done")
    assert ledger.booked == ["k1"]


def test_a_core_that_dies_between_commit_and_answer_has_done_it(w: World) -> None:
    promised(w, "k1")
    ledger = Ledger(after=hangs_up)
    core = serve(w, ledger, 2)
    core.wait(PATH)
    w.die(core)
    ledger.after = lambda _: False
    second = serve(w, ledger, 3)
    assert becomes(w, "k1", "done")["answer"] == {"id": "t-k1"}
    assert (ledger.booked, sent(second, "k1")) == (["k1"], [])


def test_a_core_that_may_still_be_running_it_is_not_sent_it_again(w: World) -> None:
    promised(w, "k1")
    ledger = Ledger(before=hangs_up)
    core = serve(w, ledger, 2)
    core.wait(f"{LOOK_UP}k1", 3)  # looked up again and again
    assert len(sent(core, "k1")) == 1


def test_what_a_core_says_it_did_not_do_waits_on(w: World) -> None:
    promised(w, "k1")
    ledger = Ledger(before=saying(503, {"outcome": "not_done"}))
    core = serve(w, ledger, 2)
    core.wait(PATH, 2)
    assert receipt(w, "k1")["outcome"] == "waiting"
    ledger.before = lambda _: False
    becomes(w, "k1", "done")
    assert ledger.booked == ["k1"]


def test_a_refusal_is_told_with_the_ledgers_own_words(w: World) -> None:
    promised(w, "k1")
    no = {"type": "/problems/account-closed", "detail": "This account is closed."}
    serve(w, Ledger(before=saying(422, no)), 2)
    told = becomes(w, "k1", "refused")
    assert (told["status"], told["answer"]) == (422, no)
    page = w.ask("GET", "/__hc/receipts/k1", TAB)
    assert b"This account is closed." in page.body


def test_a_request_that_was_at_the_core_is_promised_and_looked_up(tmp_path: Path) -> None:
    with promising(tmp_path) as w:
        ledger = Ledger(after=lambda _: True)
        core = w.serving(ledger)
        has_read(w)
        client = wish(w, "k1")
        until(lambda: ledger.booked, "the commit")
        w.die(core)
        assert client.read().status == 202
        ledger.after = lambda _: False
        second = serve(w, ledger, 2)
        becomes(w, "k1", "already_done")
        assert (ledger.booked, sent(second, "k1")) == (["k1"], [])


# -- the same key again ----------------------------------------------------------------------------------


def test_the_same_request_again_gets_the_same_receipt(w: World) -> None:
    promised(w, "k1")
    promised(w, "k1")
    ledger = Ledger(before=lambda _: True)
    core = serve(w, ledger, 2)
    core.wait(PATH)
    promised(w, "k1")  # also while it runs
    assert len(sent(core, "k1")) == 1


def test_two_that_wait_under_one_key_get_one_receipt(tmp_path: Path) -> None:
    with promising(tmp_path, hold_ms=300) as w:
        hold(w)
        clients = [wish(w, "k1"), wish(w, "k1")]
        assert [client.read().status for client in clients] == [202, 202]
        ledger = Ledger()
        core = serve(w, ledger, 2)
        becomes(w, "k1", "done")
        assert (ledger.booked, len(sent(core, "k1"))) == (["k1"], 1)


def test_another_request_under_the_key_of_a_receipt_is_refused(w: World) -> None:
    promised(w, "k1")
    answer = wish(w, "k1", body=b"other").read()
    assert (answer.status, answer.json()["type"]) == (422, "/problems/key-reused")


# -- a person's word -------------------------------------------------------------------------------------


def test_an_old_promise_runs_only_when_a_person_says_so(tmp_path: Path) -> None:
    with promising(tmp_path, receipt_ask_after_ms=1) as w:
        hold(w)
        promised(w, "k1")
        promised(w, "k2")
        until(lambda: receipt(w, "k2")["age_ms"] > 1, "it to be old")
        ledger = Ledger()
        core = serve(w, ledger, 2)
        becomes(w, "k1", "ask")
        becomes(w, "k2", "ask")
        assert ledger.booked == []
        cancelled = w.ask("POST", "/__hc/receipts/k2/cancel", body=b"")
        assert (cancelled.status, cancelled.json()["outcome"]) == (202, "not_done")
        late = w.ask("POST", PATH, "Idempotency-Key: k2", body=b'{"a":1}')
        assert (late.status, late.json()["outcome"]) == (409, "not_done")
        assert w.ask("POST", "/__hc/receipts/k2/run", body=b"").status == 409
        assert sent(core, "k2") == []


def test_what_a_person_lets_run_is_young_again(tmp_path: Path) -> None:
    with promising(tmp_path, receipt_ask_after_ms=2_000) as w:
        hold(w)
        promised(w, "k1")
        until(lambda: receipt(w, "k1")["age_ms"] > 2_000, "it to be old")
        ledger = Ledger()
        core = serve(w, ledger, 2)
        becomes(w, "k1", "ask")
        reborn(w, core)
        assert receipt(w, "k1")["outcome"] == "ask"
        assert w.ask("POST", "/__hc/receipts/k1/run", body=b"").json()["outcome"] == "waiting"
        becomes(w, "k1", "done")
        assert ledger.booked == ["k1"]


def test_an_old_promise_that_is_done_already_is_not_asked_about(tmp_path: Path) -> None:
    with promising(tmp_path, receipt_ask_after_ms=0) as w:
        hold(w)
        ledger = Ledger()
        promised(w, "k1")
        ledger.kept["k1"] = (name_of("POST", PATH, b'{"a":1}'), 201, {"id": "t"})
        serve(w, ledger, 2)
        assert becomes(w, "k1", "already_done")["answer"] == {"id": "t"}


@pytest.mark.parametrize("foreign", ["Sec-Fetch-Site: cross-site", "Origin: http://elsewhere.example"])
def test_no_page_of_somebody_else_says_a_word_or_has_anything_kept(w: World, foreign: str) -> None:
    promised(w, "k1")
    for path in ("/__hc/receipts/k1/run", "/__hc/receipts/k1/cancel", "/__hc/keep"):
        assert w.ask("POST", path, foreign, FORM, body=b"").status == 403
    assert w.ask("GET", "/__hc/receipts/k1/cancel").status == 405
    assert receipt(w, "k1")["outcome"] == "waiting"


def test_a_suspect_is_only_looked_up(w: World) -> None:
    promised(w, "k1")
    promised(w, "k2")
    ledger = Ledger()
    first = serve(w, ledger, 2, key_hash("k1"))
    first.wait(f"{LOOK_UP}k1")
    assert receipt(w, "k1")["outcome"] == "waiting"
    w.feed.say(
        "verdict", name=key_hash("k1"), outcome="convicted", letter="0193-letter-1", reason="CRASHED_CORE"
    )
    told = becomes(w, "k1", "set_aside")
    assert (told["letter"], told["status"]) == ("0193-letter-1", 422)
    assert w.ask("GET", "/__hc/client.js").status == 200  # the pages are drawn
    page = w.ask("GET", "/__hc/receipts/k1", TAB, "Accept-Language: ko").body.decode()
    assert "번호: letter-1" in page
    becomes(w, "k2", "done")
    w.die(first)
    second = serve(w, ledger, 3)
    second.wait(f"{LOOK_UP}k1")
    assert (sent(first, "k1"), sent(second, "k1")) == ([], [])
    assert w.ask("POST", "/__hc/receipts/k1/run", body=b"").status == 409
    until(lambda: w.ask("POST", "/__hc/receipts/k1/cancel", body=b"").status == 202, "the look-up to be over")
    assert receipt(w, "k1")["outcome"] == "not_done"


# -- their order -----------------------------------------------------------------------------------------


def test_each_browser_keeps_its_order_and_four_run_at_a_time(w: World) -> None:
    for number in range(6):
        promised(w, f"a{number}", f"Cookie: __hc=b{number}")  # the last of two cookies counts
    promised(w, "second", "Cookie: __hc=b0")
    ledger = Ledger(before=lambda _: True)
    core = serve(w, ledger, 2)
    core.wait(PATH, 4)
    assert w.ask("GET", "/later").status == 200
    assert core.targets().count(PATH) == 4
    assert sent(core, "second") == []


# -- telling ---------------------------------------------------------------------------------------------


def test_the_pages_of_the_browser_that_was_promised_hear_of_it_and_no_others(w: World) -> None:
    with live(w, ME) as mine, live(w, ("Cookie", "__hc=other")) as other:
        promised(w, "k1")
        assert mine.read_type("receipt")["outcome"] == "waiting"
        assert mine.read_until(lambda frame: frame.get("promised") == 1)["held"] == 1
        serve(w, Ledger(), 2)
        told = mine.read_type("receipt")
        assert told == {"v": 1, "type": "receipt", "key": "k1", "outcome": "done", "status": 201}
        w.feed.phase("FORWARD", state="DEGRADED", phase="SUSPECT")
        while (frame := other.read())["type"] != "state" or frame["state"] != "DEGRADED":
            assert frame["type"] != "receipt"


def test_a_page_that_opens_hears_of_what_nobody_has_seen(w: World) -> None:
    promised(w, "k1")
    core = serve(w, Ledger(), 2)
    becomes(w, "k1", "done")
    reborn(w, core)
    with live(w, ME) as own:
        assert own.read_type("receipt")["outcome"] == "done"
    assert w.ask("POST", "/__hc/receipts/k1/seen", body=b"").json()["seen"] is True
    with live(w, ME) as own:
        w.feed.phase("FORWARD", state="DEGRADED", phase="SUSPECT")
        while (frame := own.read())["type"] != "state" or frame["state"] != "DEGRADED":
            assert frame["type"] != "receipt"
