"""Suspects in the gateway: looked up, tried, run once or never."""

import base64
import json
import socket
import struct
from collections.abc import Iterator
from pathlib import Path
from threading import Event

import pytest

from tests.contract.gateway_world import Call, World, key_hash, silent
from tests.contract.receipts_world import (
    FORM,
    LOOK_UP,
    TAB,
    Ledger,
    becomes,
    has_read,
    kill,
    name_of,
    receipt,
    sent,
)
from tests.contract.trials_world import (
    BODY,
    KEY,
    LETTER,
    PATH,
    a_letter,
    case_of,
    on_trial,
    rules,
    trying,
    verdict,
)
from tests.waiting import WAIT_S, until


@pytest.fixture
def w(tmp_path: Path) -> Iterator[World]:
    with trying(tmp_path) as made:
        yield made


def test_a_suspect_runs_once_when_its_trial_has_cleared_it(w: World) -> None:
    client, core, ledger = on_trial(w, "Cookie: __hc=me; sid=secret", "Authorization: Basic secret")
    case = case_of(w, key_hash("a"))
    assert "secret" not in json.dumps(case)
    assert case["source"].startswith("browser:")
    assert (case["key"], case["digest"]) == ("a", name_of("POST", PATH, BODY))
    assert case["case"]["name"] == case["name"] == key_hash("a")
    request = case["case"]["request"]
    assert (request["method"], request["path"]) == ("POST", PATH)
    assert base64.b64decode(request["body"]) == BODY
    assert sent(core, "a") == []
    verdict(w, key_hash("a"), "cleared")
    assert client.read().status == 201
    assert ledger.booked == ["a"]
    until(lambda: not list((w.folder / "state" / "cases").glob("*.json")), "its case to go")


@pytest.mark.parametrize("outcome", ["convicted", "held"])
def test_a_suspect_that_is_set_aside_is_told_its_number_and_never_runs(w: World, outcome: str) -> None:
    client, core, _ = on_trial(w)
    verdict(w, key_hash("a"), outcome, LETTER)
    answer = client.read()
    assert (answer.status, answer.json()["type"]) == (422, "/problems/set-aside")
    assert (answer.json()["outcome"], answer.json()["letter"]) == ("not_done", LETTER)
    assert case_of(w, key_hash("a"))["key"] == "a"  # its letter may not be written yet
    again = w.ask("POST", PATH, KEY + "a", body=BODY)  # the rule is not written yet: the verdict counts
    assert (again.status, again.json()["letter"]) == (422, LETTER)
    assert sent(core, "a") == []


def test_a_suspect_of_which_nothing_more_is_expected_was_not_done(w: World) -> None:
    client, core, _ = on_trial(w)
    verdict(w, key_hash("a"), "dropped")
    answer = client.read()
    assert (answer.status, answer.json()["outcome"]) == (503, "not_done")
    assert sent(core, "a") == []


def test_a_suspect_whose_time_is_over_never_runs_by_us_whatever_its_verdict(tmp_path: Path) -> None:
    with trying(tmp_path, hold_ms=1_500) as w:
        client, core, _ = on_trial(w)
        answer = client.read()
        assert (answer.status, answer.json()["outcome"]) == (503, "not_done")
        verdict(w, key_hash("a"), "cleared")
        assert w.ask("GET", "/x").status == 200
        assert sent(core, "a") == []
        assert w.ask("POST", PATH, KEY + "a", body=BODY).status == 201  # it is the client's to ask again


def test_a_suspect_that_the_ledger_has_is_answered_and_settled(w: World) -> None:
    core = w.serving(silent)
    client = w.client().ask("POST", PATH, KEY + "a", body=BODY)
    core.wait(PATH)
    w.die(core)
    kept = {"a": (name_of("POST", PATH, BODY), 201, {"id": "t-a"})}
    w.feed.serve(w.core(2, Ledger(kept=kept)), incident="i1", suspects=(key_hash("a"),))
    assert client.read().status == 201
    assert w.feed.wait("settled")[0]["names"] == [key_hash("a")]


def test_the_death_of_another_core_means_nothing_to_whoever_is_on_trial(w: World) -> None:
    client, second, ledger = on_trial(w)
    w.die(second)
    w.feed.wait("holding", count=2)
    third = w.core(3, ledger)
    w.feed.serve(third, incident="i2")
    assert w.ask("GET", "/x").status == 200
    assert third.targets() == ["/x"]  # nobody asks about it once more
    verdict(w, key_hash("a"), "cleared")
    assert client.read().status == 201
    assert ledger.booked == ["a"]


def test_a_page_is_told_that_a_request_of_its_browser_waits_for_a_trial(w: World) -> None:
    client, _, _ = on_trial(w, "Cookie: __hc=me")
    told = w.ask("GET", "/__hc/status.json", "Cookie: __hc=me").json()
    assert (told["text"], told["held"], told["trial"]) == (None, 1, 1)
    assert w.ask("GET", "/__hc/status.json", "Cookie: __hc=other").json()["trial"] == 0
    verdict(w, key_hash("a"), "cleared")
    assert client.read().status == 201


def test_a_verdict_while_no_core_serves_is_kept_for_the_next_one(w: World) -> None:
    client, second, ledger = on_trial(w)
    w.die(second)
    w.feed.wait("holding", count=2)
    verdict(w, key_hash("a"), "cleared")
    w.feed.serve(w.core(3, ledger), incident="i2")
    assert client.read().status == 201
    assert ledger.booked == ["a"]


def test_a_suspect_that_is_sent_again_is_looked_up_and_waits_for_the_same_trial(w: World) -> None:
    first, core, ledger = on_trial(w)
    second = w.client().ask("POST", PATH, KEY + "a", body=BODY)
    core.wait(LOOK_UP + "a", 2)
    w.wait_held(2)
    assert sent(core, "a") == []
    verdict(w, key_hash("a"), "cleared")
    assert (first.read().status, second.read().status) == (201, 201)
    assert ledger.booked == ["a"]


def test_a_gateway_that_dies_in_the_middle_of_a_trial_loses_no_suspect(w: World) -> None:
    _, core, ledger = on_trial(w)
    kill(w)
    w.start()
    w.feed.wait_subscribed(2)
    w.feed.serve(core, incident="i1", suspects=(key_hash("a"),))
    w.feed.wait("case", count=2)  # what lies there is told to whoever may not have heard it
    client = w.client().ask("POST", PATH, KEY + "a", body=BODY)
    core.wait(LOOK_UP + "a", 2)
    w.wait_held(1)
    assert sent(core, "a") == []
    verdict(w, key_hash("a"), "convicted", LETTER)
    assert client.read().json()["letter"] == LETTER
    assert sent(core, "a") == []
    assert ledger.booked == []


def test_a_request_without_a_key_has_a_name_is_filed_and_never_runs_again(w: World) -> None:
    core = w.serving(silent)
    client = w.client().ask("POST", PATH, "X-Request-Name: " + "f" * 32, body=BODY)
    (call,) = core.wait(PATH)
    names = [value for name, value in call.request.headers if name == "X-Request-Name"]
    assert len(names) == 1
    assert names[0] != "f" * 32
    w.die(core)
    assert client.read().json()["outcome"] == "unknown"
    second = w.core(2, Ledger())
    w.feed.serve(second, incident="i1", suspects=(names[0],))
    case = case_of(w, names[0])
    assert (case["key"], case["source"]) == (None, "peer:127.0.0.1")
    verdict(w, names[0], "cleared")
    assert w.ask("GET", "/x").status == 200
    assert second.targets() == ["/x"]


def test_a_suspect_whose_client_has_left_is_tried_all_the_same(w: World) -> None:
    core = w.serving(silent)
    client = w.client().ask("POST", PATH, KEY + "a", body=BODY)
    core.wait(PATH)
    client.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    client.close()
    core.calls.all()[0].wait_closed()
    w.die(core)
    second = w.core(2, Ledger())
    w.feed.serve(second, incident="i1", suspects=(key_hash("a"),))
    assert case_of(w, key_hash("a"))["key"] == "a"
    verdict(w, key_hash("a"), "cleared")
    assert w.ask("GET", "/x").status == 200
    assert sent(second, "a") == []


def test_a_form_waits_for_its_verdict_on_the_page_that_sent_it(w: World) -> None:
    body = b"_idempotency_key=a&amount=1"
    client, core, _ = on_trial(w, FORM, TAB, "Accept-Language: ko", body=body)
    verdict(w, key_hash("a"), "convicted", LETTER)
    page = client.read()
    assert page.status == 422
    assert "이 요청은 따로 보관했어요" in page.body.decode()
    assert "번호: 0000abcd" in page.body.decode()
    assert [call.request.method for call in core.calls.all()] == ["GET"]


def test_what_touches_a_suspects_account_waits_for_its_verdict_in_its_order(w: World) -> None:
    client, _, ledger = on_trial(w)
    w.feed.say("suspects", keys=[key_hash("a")], account_ids=["assets:cash"])
    w.feed.wait("case", count=2)
    mine = [w.client().ask("POST", PATH, KEY + key, body=BODY) for key in ("b",)]
    w.wait_held(2)
    mine.append(w.client().ask("PUT", "/api/ledger/accounts/assets%3Acash", KEY + "c", body=b"{}"))
    w.wait_held(3)
    assert w.ask("POST", PATH, KEY + "d", body=b'{"account":"assets:bank"}').status == 201
    assert w.ask("GET", "/api/ledger/accounts/assets:cash").status == 200
    assert ledger.booked == ["d"]
    verdict(w, key_hash("a"), "cleared")
    assert client.read().status == 201
    assert [one.read().status for one in mine] == [201, 201]
    assert sorted(ledger.booked) == ["a", "b", "c", "d"]


def test_what_touches_a_suspects_account_does_not_wait_for_ever(tmp_path: Path) -> None:
    with trying(tmp_path, account_hold_ms=200) as w:
        _, core, ledger = on_trial(w)
        w.feed.say("suspects", keys=[key_hash("a")], account_ids=["assets:cash"])
        w.feed.wait("case", count=2)
        assert w.ask("POST", PATH, KEY + "b", body=BODY).status == 201
        assert ledger.booked == ["b"]
        assert sent(core, "a") == []


# -- what was promised -----------------------------------------------------------------------------------


def kept(w: World, key: str) -> None:
    """Have a wish promised while no core serves."""
    w.holding()
    has_read(w)
    answer = w.ask("POST", PATH, KEY + key, "Prefer: respond-async", "Cookie: __hc=me", body=BODY)
    assert answer.status == 202


def test_a_promised_suspect_is_tried_and_runs_once_it_is_cleared(tmp_path: Path) -> None:
    with trying(tmp_path, hold_ms=50) as w:
        kept(w, "a")
        core = w.core(2, ledger := Ledger())
        w.feed.serve(core, incident="i1", suspects=(key_hash("a"),))
        case = case_of(w, key_hash("a"))
        assert (case["key"], case["source"][:8]) == ("a", "browser:")
        assert receipt(w, "a")["outcome"] == "waiting"
        assert sent(core, "a") == []
        verdict(w, key_hash("a"), "cleared")
        becomes(w, "a", "done")
        assert ledger.booked == ["a"]


def test_a_promised_suspect_that_nobody_could_try_asks_a_person(tmp_path: Path) -> None:
    with trying(tmp_path, hold_ms=50) as w:
        kept(w, "a")
        core = w.core(2, ledger := Ledger())
        w.feed.serve(core, incident="i1", suspects=(key_hash("a"),))
        case_of(w, key_hash("a"))
        verdict(w, key_hash("a"), "dropped")
        becomes(w, "a", "ask")
        assert sent(core, "a") == []
        assert w.ask("POST", "/__hc/receipts/a/run", body=b"").status == 202
        becomes(w, "a", "done")
        assert ledger.booked == ["a"]


def test_what_was_set_aside_and_let_go_is_seen_to_be_done(tmp_path: Path) -> None:
    with trying(tmp_path, hold_ms=50) as w:
        kept(w, "a")
        rules(w, 1, rules=[a_letter(name=key_hash("a"))])
        core = w.core(2, ledger := Ledger())
        w.feed.serve(core, incident="i1")
        assert becomes(w, "a", "set_aside")["letter"] == LETTER
        assert w.ask("POST", PATH, KEY + "a", body=BODY).status == 422
        rules(w, 2)
        until(lambda: w.ask("POST", PATH, KEY + "a", body=BODY).status == 201, "the rule to go")
        becomes(w, "a", "already_done")
        assert ledger.booked == ["a"]


def test_a_request_whose_rule_goes_while_it_is_looked_up_runs(w: World) -> None:
    named = [a_letter(name=key_hash(key)) for key in ("a", "b")]
    rules(w, 1, told=False, rules=named)
    asked, may_answer, ledger = Event(), Event(), Ledger()

    def slow(call: Call) -> None:
        if call.request.target == f"{LOOK_UP}a":
            asked.set()
            assert may_answer.wait(WAIT_S)
        ledger(call)

    core = w.serving(slow)
    assert w.ask("POST", PATH, KEY + "b", body=BODY).status == 422
    client = w.client().ask("POST", PATH, KEY + "a", body=BODY)
    assert asked.wait(WAIT_S)
    rules(w, 2)
    until(lambda: w.ask("POST", PATH, KEY + "b", body=BODY).status == 201, "the rule to go")
    may_answer.set()
    assert client.read().status == 201
    assert sent(core, "a") == [PATH]
