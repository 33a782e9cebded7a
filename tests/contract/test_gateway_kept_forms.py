"""The recovery page's "keep it for me": a form's wish that the page alone carries becomes a promise."""

import re
import sqlite3
from base64 import urlsafe_b64decode
from collections.abc import Iterator
from contextlib import closing
from html import unescape
from pathlib import Path
from urllib.parse import urlencode

import pytest

from tests.contract.gateway_world import Client, Response, World, key_hash, silent
from tests.contract.receipts_world import (
    COOKIE,
    FORM,
    LOOK_UP,
    TAB,
    Ledger,
    becomes,
    has_read,
    hold,
    name_of,
    promising,
    reborn,
    receipt,
    serve,
    wish,
)
from tests.waiting import until


@pytest.fixture
def w(tmp_path: Path) -> Iterator[World]:
    """A world in an outage."""
    with promising(tmp_path, paper_after_ms=0) as made:
        hold(made)
        yield made


ENTRY = b"amount=100&description=%EA%B9%80%EB%B0%A5&_idempotency_key=f1"


def fields_of(page: bytes) -> dict[str, str]:
    """The hidden fields of the form that a page offers."""
    found = re.findall(r'<input type="hidden" name="([a-z]+)" value="([^"]*)">', page.decode())
    return {name: unescape(value) for name, value in found}


def offered(w: World) -> dict[str, str]:
    """What the page carries that offers to keep a form's wish."""
    told = (TAB, FORM, COOKIE, "Referer: http://localhost/register?q=<a>")

    def keepable() -> bytes:  # until the pages are drawn, a plain one is shown
        page = w.ask("POST", "/entries?x=1", *told, body=ENTRY)
        assert page.status == 503
        return page.body if b'action="/__hc/keep"' in page.body else b""

    return fields_of(until(keepable, "the page to be drawn"))


def keep(w: World, fields: dict[str, str], *headers: str) -> Response:
    return w.ask("POST", "/__hc/keep", TAB, FORM, COOKIE, *headers, body=urlencode(fields).encode())


def test_a_forms_wish_is_kept_by_the_page_alone_and_done_once(w: World) -> None:
    fields = offered(w)
    assert (fields["key"], fields["path"]) == ("f1", "/entries?x=1")
    assert urlsafe_b64decode(fields["body"]) == ENTRY
    reborn(w)  # the gateway that drew the page is gone
    for _ in range(2):  # pressed twice
        answer = until(lambda: keep(w, fields), "an answer")
        assert answer.status == 303
        assert answer.header("Location") == "/__hc/receipts/f1"
    until(lambda: b'data-outcome="waiting"' in w.ask("GET", "/__hc/receipts/f1", TAB).body, "its page")
    again = w.ask("POST", "/entries?x=1", TAB, FORM, COOKIE, body=ENTRY)
    assert (again.status, again.header("Location")) == (303, "/__hc/receipts/f1")
    ledger = Ledger()
    core = serve(w, ledger, 2)
    becomes(w, "f1", "done")
    (call,) = core.wait("/entries?x=1")
    assert (call.request.body, call.request.header("Accept")) == (ENTRY, "application/json")
    assert call.request.header("Content-Type") == "application/x-www-form-urlencoded"
    assert ledger.booked == ["f1"]
    page = w.ask("GET", "/__hc/receipts/f1", TAB)
    assert b'data-outcome="done"' in page.body
    assert b"<!--" not in page.body


@pytest.mark.parametrize(
    "wrong",
    [
        {"path": "//elsewhere.example/x"},
        {"path": "/__hc/receipts/f1/run"},
        {"path": "/a b"},
        {"path": "/x\r\nX-Evil: 1"},
        {"key": "other"},
        {"body": "!"},
        {"type": "text/plain"},
        {"type": "application/x-www-form-urlencoded\r\nX-Evil: 1"},
    ],
)
def test_what_no_form_of_ours_said_is_not_kept(w: World, wrong: dict[str, str]) -> None:
    answer = keep(w, {**offered(w), **wrong})
    assert answer.status == 422
    assert w.ask("GET", "/__hc/receipts/f1").status == 404


def test_another_form_under_the_key_of_a_receipt_is_refused(w: World) -> None:
    fields = offered(w)
    assert keep(w, fields).status == 303
    assert keep(w, {**fields, "path": "/entries/7"}).status == 422


def test_a_form_without_a_key_is_offered_nothing(w: World) -> None:
    offered(w)  # the pages are drawn
    page = w.ask("POST", "/entries", TAB, FORM, COOKIE, body=b"amount=100")
    assert (page.status, b"/__hc/keep" in page.body) == (503, False)


def test_a_person_answers_for_an_old_one_with_a_form(tmp_path: Path) -> None:
    with promising(tmp_path, receipt_ask_after_ms=0, paper_after_ms=0) as w:
        hold(w)
        assert keep(w, offered(w)).status == 303
        ledger = Ledger()
        serve(w, ledger, 2)
        becomes(w, "f1", "ask")
        assert b"/__hc/receipts/f1/run" in w.ask("GET", "/__hc/receipts/f1", TAB).body
        answer = w.ask("POST", "/__hc/receipts/f1/cancel", TAB, FORM, body=b"")
        assert (answer.status, answer.header("Location")) == (303, "/__hc/receipts/f1")
        assert receipt(w, "f1")["outcome"] == "not_done"
        assert ledger.booked == []


def test_whoever_waits_for_a_disk_that_hangs_is_told_in_time_that_nobody_knows(tmp_path: Path) -> None:
    with promising(tmp_path, receipt_store_ms=300, paper_after_ms=0) as w:
        hold(w)
        fields = offered(w)
        until(lambda: wish(w, "k0").read().status == 202, "the receipts to be read")
        with closing(sqlite3.connect(tmp_path / "receipts.db", isolation_level=None)) as lock:
            lock.execute("BEGIN IMMEDIATE")  # for longer than anybody waits
            answer = wish(w, "k1").read()
            assert (answer.status, answer.json()["type"]) == (503, "/problems/promise-unknown")
            assert keep(w, fields).status == 503
            assert w.ask("GET", "/__hc/receipts/k0").status == 200  # nobody else waits for it


# -- a form whose core dies under it ---------------------------------------------------------------------


def drawn(w: World) -> None:
    """Wait until the gateway has drawn its pages."""
    until(lambda: w.ask("GET", "/__hc/client.js").status == 200, "the pages to be drawn")


def post_form(w: World) -> Client:
    return w.client().ask("POST", "/entries", TAB, FORM, "Referer: http://localhost/register", body=ENTRY)


def test_a_form_that_says_its_key_is_one_slow_click(tmp_path: Path) -> None:
    with promising(tmp_path, hold_ms=20_000, navigation_hold_ms=20_000) as w:
        core = w.serving(silent)
        client = post_form(w)
        core.wait("/entries")
        w.die(core)
        second = w.core(2, lambda call: call.answer(303, b"", headers=("Location: /",)))
        w.feed.serve(second, incident="i1")
        assert client.read().status == 303
        assert second.wait("/entries")[0].request.body == ENTRY


def test_a_suspected_form_is_only_looked_up_and_told_as_a_page(tmp_path: Path) -> None:
    with promising(tmp_path, hold_ms=20_000, navigation_hold_ms=20_000) as w:
        core = w.serving(silent)
        client = post_form(w)
        core.wait("/entries")
        w.die(core)
        ledger = Ledger()
        ledger.kept["f1"] = (name_of("POST", "/entries", ENTRY), 201, {"id": "t"})
        serve(w, ledger, 2, key_hash("f1"))
        answer = client.read()
        assert (answer.status, answer.header("Location")) == (303, "/register")
        assert ledger.booked == []


@pytest.mark.parametrize("booked", [True, False])
def test_a_form_that_was_at_a_core_when_it_died_can_be_kept_and_is_done_once(
    tmp_path: Path, *, booked: bool
) -> None:
    ledger = Ledger()
    with promising(tmp_path, hold_ms=20_000) as w:
        core = w.serving(silent)
        has_read(w)
        drawn(w)
        client = post_form(w)
        core.wait("/entries")
        if booked:
            ledger.booked.append("f1")
            ledger.kept["f1"] = (name_of("POST", "/entries", ENTRY), 201, {"id": "t"})
        w.die(core)
        page = client.read()
        assert (page.status, b'data-outcome="doubtful"' in page.body) == (503, True)
        assert keep(w, fields_of(page.body)).status == 303
        serve(w, ledger, 2)
        becomes(w, "f1", "already_done" if booked else "done")
        assert ledger.booked == ["f1"]


def test_of_a_form_that_is_not_found_nobody_says_that_it_was_not_done(tmp_path: Path) -> None:
    with promising(tmp_path, hold_ms=20_000, navigation_hold_ms=20_000) as w:
        core = w.serving(silent)
        has_read(w)
        drawn(w)
        client = post_form(w)
        core.wait("/entries")
        w.die(core)
        second = serve(w, Ledger(), 2, key_hash("f1"))
        second.wait(f"{LOOK_UP}f1")
        w.feed.say("verdict", name=key_hash("f1"), outcome="dropped", letter=None, reason=None)
        page = client.read()
        assert (page.status, b'data-outcome="doubtful"' in page.body) == (503, True)
        assert second.targets() == [f"{LOOK_UP}f1"]
