"""What the quarantine refuses at the door: by name, by digest, by who sends it; and what is done is told again."""

import hashlib
import itertools
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.contract.gateway_world import Call, World, key_hash, silent
from tests.contract.receipts_world import FORM, LOOK_UP, TAB, Ledger, name_of, sent
from tests.contract.trials_world import (
    BODY,
    KEY,
    LETTER,
    PATH,
    a_letter,
    on_trial,
    rules,
    trying,
    verdict,
)
from tests.waiting import until

ME = "Cookie: __hc=me"


@pytest.fixture
def w(tmp_path: Path) -> Iterator[World]:
    with trying(tmp_path) as made:
        yield made


def in_force(w: World, serial: int, **fields: list[dict[str, Any]]) -> None:
    """These rules, once the gateway goes by them: it refuses a probe, each under a key of its own."""
    probe = b"%d" % serial
    letters = fields.pop("rules", [])
    probes = a_letter(id="probe", name="f" * 32, digest=name_of("DELETE", "/probe", probe))
    rules(w, serial, rules=[*letters, probes], sources=fields.pop("sources", []))
    keys = (KEY + f"probe-{serial}-{n}" for n in itertools.count())  # a used one says nothing of the rules
    until(lambda: w.ask("DELETE", "/probe", next(keys), body=probe).status == 422, "the rules")


def booked(ledger: Ledger) -> list[str]:
    return [key for key in ledger.booked if not key.startswith("probe")]


def stop(w: World, browser: str) -> None:
    source = "browser:" + hashlib.sha256(browser.encode()).hexdigest()[:16]
    in_force(w, 1, sources=[{"source": source, "until": "2099-01-01T00:00:00Z"}])


def test_the_quarantine_refuses_by_name_and_by_digest_and_no_core_sees_it(w: World) -> None:
    rules(w, 1, told=False, rules=[a_letter(name=key_hash("a"), digest=name_of("POST", PATH, BODY))])
    core = w.serving(Ledger())
    by_name = w.ask("POST", PATH, KEY + "a", body=b"{}")
    by_digest = w.ask("POST", PATH, KEY + "b", body=BODY)
    by_form = w.ask("POST", PATH, FORM, TAB, body=b"_idempotency_key=a")
    assert [one.status for one in (by_name, by_digest, by_form)] == [422, 422, 422]
    assert (by_name.json()["letter"], by_digest.json()["outcome"]) == (LETTER, "not_done")
    assert (
        "It was not done" not in by_form.body.decode()
    )  # it may be several commands, under keys of their own
    assert {call.request.method for call in core.calls.all()} == {"GET"}  # looked up, and not sent
    assert w.ask("POST", PATH, KEY + "b", body=b"{}").status == 201
    hits = w.folder / "state" / "rule_hits.json"
    until(lambda: hits.exists() and json.loads(hits.read_text())["hits"][LETTER]["count"] >= 1, "the count")
    rules(w, 2)
    until(lambda: w.ask("POST", PATH, KEY + "a", body=BODY).status == 201, "the rule to go")


def test_what_is_done_is_told_again_though_its_twin_was_convicted(w: World) -> None:
    w.serving(ledger := Ledger())
    assert w.ask("POST", PATH, KEY + "k1", body=BODY).status == 201
    in_force(w, 1, rules=[a_letter(name=key_hash("k2"), digest=name_of("POST", PATH, BODY))])
    again = w.ask("POST", PATH, KEY + "k1", body=BODY)
    assert (again.status, again.header("Idempotent-Replayed")) == (201, "true")
    assert w.ask("POST", PATH, KEY + "k2", body=BODY).json()["letter"] == LETTER
    assert booked(ledger) == ["k1"]


def test_what_is_done_is_told_again_though_its_own_name_is_set_aside(w: World) -> None:
    w.serving(Ledger())
    assert w.ask("POST", PATH, KEY + "k1", body=BODY).status == 201
    in_force(w, 1, rules=[a_letter(name=key_hash("k1"), digest=name_of("POST", PATH, BODY))])
    assert w.ask("POST", PATH, KEY + "k1", body=BODY).status == 201


def test_what_is_done_is_told_again_to_a_source_that_was_stopped_since(w: World) -> None:
    w.serving(ledger := Ledger())
    assert w.ask("POST", PATH, KEY + "k1", ME, body=BODY).status == 201
    stop(w, "me")
    assert w.ask("POST", PATH, KEY + "k1", ME, body=BODY).status == 201
    assert w.ask("POST", PATH, KEY + "k2", ME, body=BODY).status == 429
    assert booked(ledger) == ["k1"]


def test_while_no_core_lives_nobody_is_told_that_what_a_rule_names_was_not_done(tmp_path: Path) -> None:
    with trying(tmp_path, hold_ms=500) as w:
        rules(w, 1, told=False, rules=[a_letter(digest=name_of("POST", PATH, BODY))])
        w.holding()
        answer = w.ask("POST", PATH, KEY + "k1", body=BODY)
        assert (answer.status, answer.json()["outcome"]) == (503, "unknown")
        without_a_key = w.ask("POST", PATH, body=BODY)
        assert (without_a_key.status, without_a_key.json()["outcome"]) == (422, "not_done")


def test_what_a_rule_names_waits_for_a_core_that_can_say_whether_it_is_done(w: World) -> None:
    rules(w, 1, told=False, rules=[a_letter(digest=name_of("POST", PATH, BODY))])
    w.holding()
    kept = {"k1": (name_of("POST", PATH, BODY), 201, {"id": "t"})}
    done, absent = (w.client().ask("POST", PATH, KEY + key, body=BODY) for key in ("k1", "k2"))
    w.wait_held(2)
    w.feed.serve(core := w.core(2, Ledger(kept=kept)))
    assert (done.read().status, absent.read().status) == (201, 422)
    assert {call.request.method for call in core.calls.all()} == {"GET"}


def test_a_lost_request_that_a_rule_names_is_looked_up_and_not_repeated(w: World) -> None:
    core = w.serving(Ledger(before=lambda call: call.request.header("Idempotency-Key") == "k1"))
    client = w.client().ask("POST", PATH, KEY + "k1", body=BODY)
    core.wait(PATH)
    in_force(w, 1, rules=[a_letter(digest=name_of("POST", PATH, BODY))])
    w.die(core)
    w.feed.serve(second := w.core(2, Ledger()), incident="i1")
    answer = client.read()
    assert (answer.status, answer.json()["letter"]) == (422, LETTER)
    assert second.targets() == [LOOK_UP + "k1"]


def test_a_form_that_a_core_has_had_is_never_said_to_be_not_done(w: World) -> None:
    client, _, _ = on_trial(w, FORM, TAB, "Accept-Language: en", body=b"_idempotency_key=a&amount=1")
    verdict(w, key_hash("a"), "convicted", LETTER)
    page = client.read().body.decode()
    assert "Number: 0000abcd" in page
    assert "not done" not in page
    assert "Some of it may have been done" in page


def test_a_verdict_that_is_told_once_more_does_not_outlive_its_rule(w: World) -> None:
    rules(w, 1, told=False)
    w.serving(Ledger())
    verdict(w, key_hash("a"), "convicted", LETTER)  # as a guard says it to a gateway that joins late
    until(lambda: w.ask("POST", PATH, KEY + "a", body=BODY).status == 201, "what the rules say to count")


def test_a_request_whose_rule_is_gone_is_refused_by_no_verdict_of_before(w: World) -> None:
    client, core, ledger = on_trial(w)
    verdict(w, key_hash("a"), "convicted", LETTER)
    assert client.read().status == 422
    in_force(w, 1, rules=[a_letter(name=key_hash("a"))])
    in_force(w, 2)
    core.script = silent
    again = w.client().ask("POST", PATH, KEY + "a", body=BODY)
    core.wait(PATH)
    w.die(core)
    third = w.core(3, silent)
    w.feed.serve(third, incident="i2")
    third.wait(PATH)
    w.die(third)
    w.feed.serve(w.core(4, ledger), incident="i3")
    answer = again.read()
    assert (answer.status, answer.json()["outcome"]) == (503, "not_done")
    assert "letter" not in answer.json()


def test_hostile_files_leave_the_rules_before_them_in_force(w: World) -> None:
    rules(w, 1, told=False, rules=[a_letter(name=key_hash("a"))])
    core = w.serving(Ledger())
    path = w.folder / "state" / "quarantine.json"
    for data in (b"", b"{", b"[" * 100_000, b'{"version": 2}', b"\xff\xfe", b'{"version":1,"serial":"9"}'):
        path.write_bytes(data)
        w.feed.say("quarantine", serial=2)
        assert w.ask("POST", PATH, KEY + "a", body=b"{}").status == 422
    odd = [None, 7, {"id": 5}, {"id": "../x", "type": "letter", "name": key_hash("b")}, {"type": "letter"}]
    rules(
        w,
        3,
        rules=[*odd, a_letter(digest=name_of("POST", PATH, BODY))],
        suspects=[{"name": 1}],
        sources=["x", {"source": 1}],
    )
    keys = (KEY + f"probe-{n}" for n in itertools.count())
    until(lambda: w.ask("POST", PATH, next(keys), body=BODY).status == 422, "the rule that makes sense")
    assert w.ask("POST", PATH, KEY + "b", body=b"{}").status == 201
    assert sent(core, "a") == []


def test_a_source_that_is_stopped_may_read_and_change_nothing(w: World) -> None:
    core = w.serving(Ledger())
    stop(w, "me")
    refused = w.ask("POST", PATH, KEY + "a", ME, body=BODY)
    assert (refused.status, refused.json()["type"]) == (429, "/problems/source-stopped")
    assert refused.json()["outcome"] == "not_done"
    assert int(refused.header("Retry-After") or 0) > 60
    assert w.ask("GET", "/x", ME).status == 200
    assert w.ask("POST", PATH, KEY + "b", "Cookie: __hc=other", body=BODY).status == 201
    assert sent(core, "a") == []


def test_an_address_is_nobody_who_could_be_stopped(w: World) -> None:
    w.serving(Ledger())
    in_force(w, 1, sources=[{"source": "peer:127.0.0.1", "until": "2099-01-01T00:00:00Z"}])
    assert w.ask("POST", PATH, KEY + "another-program", body=BODY).status == 201


def test_which_rule_a_core_has_refused_by_is_counted_and_not_passed_on(w: World) -> None:
    def limited(call: Call) -> None:
        call.answer(429, b"{}", headers=("X-Core-Rule: limit-1",))

    w.serving(limited)
    assert w.ask("POST", PATH, KEY + "a", body=BODY).header("X-Core-Rule") is None
    hits = w.folder / "state" / "rule_hits.json"
    until(lambda: hits.exists() and "limit-1" in json.loads(hits.read_text())["hits"], "the count")
