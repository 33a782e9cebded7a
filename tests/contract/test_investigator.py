import json
import os
import stat
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import Any

import pytest

from tests.contract.investigator_world import World, investigator_world
from tests.unit.postmortem.letter_slips import slip
from tests.waiting import until

NUMBERS = count(1)


@pytest.fixture(scope="module")
def shared() -> Iterator[World]:
    with tempfile.TemporaryDirectory() as folder, investigator_world(Path(folder)) as world:
        yield world


@pytest.fixture
def world(shared: World) -> World:
    shared.guard.serving, shared.guard.refuses, shared.guard.is_mute = True, False, False
    shared.guard.asked.clear()
    shared.ledger.answer = shared.ledger.book
    shared.ledger.held.clear()
    return shared


@pytest.fixture
def own() -> Iterator[World]:
    with tempfile.TemporaryDirectory() as folder, investigator_world(Path(folder)) as world:
        yield world


def _letter(world: World, **fields: Any) -> str:
    return world.put_letter(slip(next(NUMBERS), **fields))


def _retry(world: World, letter: str) -> tuple[int, dict[str, Any]]:
    return world.post(f"letters/{letter}/retry", {"anyway": True})


def test_the_socket_is_its_owners_alone(world: World) -> None:
    assert stat.S_IMODE(world.socket.stat().st_mode) == 0o600


def test_a_letter_is_told_with_its_sentence_in_both_languages(world: World) -> None:
    letter = _letter(world)
    told = world.get(f"letters/{letter}?lang=ko")
    assert told["state"] == "QUARANTINED"
    assert told["sentence"] != world.get(f"letters/{letter}?lang=en")["sentence"]
    assert told["sums"] == ["12000 KRW"]


def test_nobody_asks_without_the_gateways_word(world: World) -> None:
    assert world.ask("GET", "letters", **{"X-Admin": "0"})[0] == 403


@pytest.mark.parametrize(
    "headers",
    [
        {},
        {"X-CSRF": "guess"},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Sec-Fetch-Site": "cross-site"},
        {"Sec-Fetch-Site": "same-site"},
    ],
)
def test_no_act_without_our_word_or_from_a_foreign_page(world: World, headers: dict[str, str]) -> None:
    letter = _letter(world)
    token = world.get("token")["token"]
    given = {"X-CSRF": token, **headers} if headers and "X-CSRF" not in headers else headers
    status, _ = world.ask("POST", f"letters/{letter}/hold", {}, **given)
    assert status == 403
    assert world.state(letter) == "QUARANTINED"


@pytest.mark.parametrize("number", ["nobody", "..%2F..%2Fetc%2Fpasswd", "%00", "a" * 4_000, "%F0%9F%92%A9"])
def test_a_number_that_is_none_is_told_so(world: World, number: str) -> None:
    for method, path in (
        ("GET", f"letters/{number}"),
        ("GET", f"incidents/{number}"),
        ("GET", f"bulk/{number}"),
    ):
        assert world.ask(method, path)[0] == 404
    assert world.post(f"letters/{number}/retry")[0] == 404


@pytest.mark.parametrize("body", ["x", [], 3, None])
def test_a_bulk_of_another_shape_is_refused(world: World, body: object) -> None:
    assert world.post("letters/bulk", {"verb": "hold", "ids": body})[0] in (400, 422)
    assert world.post("letters/bulk", body)[0] in (400, 422)


def test_a_retry_leaves_the_queue_when_a_core_has_it(world: World) -> None:
    letter = _letter(world)
    status, told = _retry(world, letter)
    assert (status, told["state"]) == (200, "RESOLVED")
    assert told["history"][-1]["outcome"] == "done"
    assert letter not in world.guard.rules
    assert world.ledger.done[told["idempotency_key"]] == 1
    assert "Cookie" not in world.ledger.headers[-1]


def test_a_retry_without_a_dry_run_that_went_well_is_refused(world: World) -> None:
    letter = _letter(world)
    status, told = world.post(f"letters/{letter}/retry")
    assert (status, told["type"]) == (409, "/problems/dry-run-needed")
    # There is no ledger to copy here, so the dry run says that it could not be made.
    assert world.post(f"letters/{letter}/dry-run")[1]["dry_run"]["ordeal"] == "untried"
    assert world.post(f"letters/{letter}/retry")[1]["type"] == "/problems/dry-run-failed"
    assert world.guard.asked == []


def test_what_the_ledger_has_already_is_not_done_twice(world: World) -> None:
    letter = _letter(world)
    key = world.get(f"letters/{letter}")["idempotency_key"]
    world.ledger.done[key] = 1
    assert _retry(world, letter)[1]["history"][-1]["outcome"] == "already done"
    assert world.ledger.done[key] == 1


def test_a_no_of_the_ledger_brings_the_letter_and_its_rule_back(world: World) -> None:
    letter = _letter(world)
    world.ledger.answer = lambda _: (422, {"type": "/problems/account-closed", "outcome": "not_done"})
    told = _retry(world, letter)[1]
    assert (told["state"], told["reason"]) == ("QUARANTINED", "CRASHED_CORE"), "why it was set aside stays"
    assert "account-closed" in told["history"][-1]["detail"]
    assert letter in world.guard.rules
    assert world.guard.asked[-1]["rule"]["name"] == told["name"]


def test_a_lost_answer_is_looked_up_and_found(world: World) -> None:
    letter = _letter(world)

    def lost(key: str) -> tuple[int, dict[str, Any]]:
        world.ledger.book(key)
        return 0, {}

    world.ledger.answer = lost
    assert _retry(world, letter)[1]["state"] == "RESOLVED"


def test_a_lost_answer_to_what_was_not_done_is_refused_from_then_on(world: World) -> None:
    letter = _letter(world)
    world.ledger.answer = lambda _: (503, {"outcome": "not_done"})
    assert _retry(world, letter)[1]["state"] == "QUARANTINED"
    assert letter in world.guard.rules


def test_a_request_without_a_key_is_never_run_again(world: World) -> None:
    letter = _letter(world, idempotency_key=None)
    sent = len(world.ledger.headers)
    assert _retry(world, letter)[1]["type"] == "/problems/letter-without-key"
    assert len(world.ledger.headers) == sent


def test_a_letter_whose_request_nobody_has_says_so(world: World) -> None:
    letter = _letter(world, case=None)
    assert _retry(world, letter)[1]["type"] == "/problems/letter-without-request"
    assert world.post(f"letters/{letter}/dry-run")[1]["type"] == "/problems/letter-without-request"


def test_a_row_is_released_for_a_new_import_of_its_file(world: World) -> None:
    letter = _letter(world, case={"row": {"import": "01", "ordinal": 4}}, idempotency_key="01:4")
    told = _retry(world, letter)[1]
    assert told["state"] == "DISCARDED"
    assert letter not in world.guard.rules
    assert world.post(f"letters/{letter}/undo-discard")[1]["state"] == "QUARANTINED"
    until(lambda: letter in world.guard.rules, "the rule to be back")


def test_with_the_ledger_down_a_retry_says_so_and_changes_nothing(world: World) -> None:
    letter = _letter(world)
    world.guard.serving = False
    status, told = _retry(world, letter)
    assert (status, told["type"]) == (503, "/problems/ledger-away")
    assert world.state(letter) == "QUARANTINED"


def test_a_guard_that_keeps_its_rule_keeps_the_letter(world: World) -> None:
    letter = _letter(world)
    world.guard.refuses = True
    assert _retry(world, letter)[1]["type"] == "/problems/guard-away"
    assert world.state(letter) == "QUARANTINED"
    assert letter in world.guard.rules


def test_of_two_retries_at_once_exactly_one_runs(world: World) -> None:
    letter = _letter(world)
    world.ledger.release.clear()
    found: list[tuple[int, dict[str, Any]]] = []
    first = threading.Thread(target=lambda: found.append(_retry(world, letter)))
    first.start()
    try:
        assert world.ledger.held.wait(20)
        assert _retry(world, letter)[1]["type"] == "/problems/letter-busy"
        assert world.post(f"letters/{letter}/discard", {"reason": "x"})[1]["type"] == "/problems/letter-busy"
    finally:
        world.ledger.release.set()
        first.join(20)
    assert found[0][1]["state"] == "RESOLVED"


def test_a_discard_needs_a_reason_and_can_be_undone(world: World) -> None:
    letter = _letter(world)
    assert world.post(f"letters/{letter}/discard", {"reason": "  "})[1]["type"] == "/problems/reason-needed"
    told = world.post(f"letters/{letter}/discard", {"reason": "<b>twice</b>"})[1]
    assert (told["state"], told["discarded_because"]) == ("DISCARDED", "<b>twice</b>")
    assert letter in world.guard.rules  # a mark: it goes on being refused
    assert world.post(f"letters/{letter}/undo-discard")[1]["state"] == "QUARANTINED"


def test_every_act_is_written_down_also_the_refused_ones(world: World) -> None:
    letter = _letter(world)
    world.post(f"letters/{letter}/hold")
    world.post(f"letters/{letter}/hold")
    acts = [act for act in world.get("audit")["items"] if letter in act["what"]]
    assert [(act["verb"], act["outcome"]) for act in acts] == [("hold", "letter_held"), ("hold", "HELD")]


def test_a_bulk_does_one_after_the_other_and_tells_how_far_it_is(world: World) -> None:
    letters = [_letter(world, reason="MEMORY_LIMIT") for _ in range(3)]
    wish = {"verb": "discard", "where": {"reason": "MEMORY_LIMIT"}, "reason": "all of them"}
    status, begun = world.post("letters/bulk", wish)
    assert (status, begun["total"]) == (202, 3)
    until(lambda: world.get(f"bulk/{begun['id']}")["ended"] == "done", "the bulk to end")
    assert {world.state(letter) for letter in letters} == {"DISCARDED"}


def test_a_bulk_stops_as_soon_as_the_ledger_is_away(world: World) -> None:
    letters = [_letter(world) for _ in range(2)]
    world.guard.serving = False
    begun = world.post("letters/bulk", {"verb": "retry", "ids": letters})[1]
    until(lambda: world.get(f"bulk/{begun['id']}")["ended"] == "stopped", "the bulk to stop")
    assert {world.state(letter) for letter in letters} == {"QUARANTINED"}


def test_a_bulk_of_more_than_is_allowed_or_of_nothing_is_refused(world: World) -> None:
    many = {"verb": "hold", "ids": [f"x{number}" for number in range(501)]}
    assert world.post("letters/bulk", many)[1]["type"] == "/problems/too-many"
    nothing = {"verb": "hold", "where": {"account": "nobody"}}
    assert world.post("letters/bulk", nothing)[1]["type"] == "/problems/nothing-matches"


def test_a_correction_is_another_request_and_its_letter_is_discarded_with_the_link(world: World) -> None:
    letter = _letter(world)
    status, told = world.post(f"letters/{letter}/correct", {"body": {"postings": []}})
    assert (status, told["state"]) == (200, "DISCARDED")
    key = told["corrected_by"]
    assert key not in ("", told["idempotency_key"])
    assert world.ledger.done == {**world.ledger.done, key: 1}
    assert json.loads(world.ledger.bodies[-1]) == {"postings": []}
    assert letter in world.guard.rules  # what it said before goes on being refused
    assert told["history"][-1]["what"] == "correction"
    assert world.post(f"letters/{letter}/undo-discard")[1]["type"] == "/problems/letter-corrected"


def test_a_correction_that_the_ledger_refuses_leaves_the_letter_where_it_was(world: World) -> None:
    letter = _letter(world)
    world.ledger.answer = lambda _: (422, {"type": "/problems/account-closed", "outcome": "not_done"})
    told = world.post(f"letters/{letter}/correct", {"body": {"postings": []}})[1]
    assert (told["state"], told["reason"], told["corrected_by"]) == ("QUARANTINED", "CRASHED_CORE", "")
    assert letter in world.guard.rules


def test_what_was_booked_already_is_not_corrected(world: World) -> None:
    letter = _letter(world)
    world.ledger.done[world.get(f"letters/{letter}")["idempotency_key"]] = 1
    sent = len(world.ledger.bodies)
    told = world.post(f"letters/{letter}/correct", {"body": {"postings": []}})[1]
    assert told["type"] == "/problems/letter-resolved"
    assert world.state(letter) == "RESOLVED"
    assert len(world.ledger.bodies) == sent


@pytest.mark.parametrize("body", ["{", "[]", "3", '{"amount": NaN}'])
def test_a_correction_that_is_none_is_refused(world: World, body: str) -> None:
    letter = _letter(world)
    told = world.post(f"letters/{letter}/correct", {"body": body})[1]
    assert told["type"] == "/problems/correction-unreadable"
    same = world.get(f"letters/{letter}")["payload"]
    assert world.post(f"letters/{letter}/correct", {"body": same})[1]["type"] == "/problems/correction-same"
    assert world.state(letter) == "QUARANTINED"


def test_the_guard_is_told_that_we_keep_the_record(world: World) -> None:
    letter = _letter(world)
    _retry(world, letter)
    assert world.guard.asked
    assert all(asked["audited"] is True for asked in world.guard.asked)


def _incident(world: World, number: int, **facts: Any) -> str:
    """An incident with a proposal that a machine enforces: a request that was held without proof."""
    incident = f"01a1{number:04x}-0000-7000-8000-0000000000aa"
    trial = {"name": "a" * 32, "ordeal": "untried", "letter": "x", "fingerprint": f"{number:064x}"}
    told = {"version": 1, "id": incident, "diagnosis": "CRASHED", "trials": [trial], **facts}
    draft = world.data / "draft"
    draft.mkdir()
    (draft / "incident.json").write_text(json.dumps(told))
    (world.data / "incidents").mkdir(exist_ok=True)
    draft.rename(world.data / "incidents" / incident)
    until(lambda: world.ask("GET", f"incidents/{incident}")[0] == 200, "the incident to be read")
    return incident


def _proposal(world: World, incident: str) -> dict[str, Any]:
    [found] = world.get(f"proposals?incident={incident}")["items"]
    return dict(found)


def test_a_proposal_that_is_accepted_by_two_at_once_is_one_rule(world: World) -> None:
    proposal = _proposal(world, _incident(world, next(NUMBERS)))
    before = set(world.guard.rules)
    threads = [
        threading.Thread(target=world.post, args=(f"proposals/{proposal['id']}/accept",)) for _ in range(2)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(20)
    [rule] = world.guard.rules - before
    assert world.post(f"proposals/{proposal['id']}/revoke")[1]["state"] == "revoked"
    assert rule not in world.guard.rules


def test_a_rule_whose_answer_was_lost_does_not_outlive_the_word_that_was_not_taken(own: World) -> None:
    proposal = _proposal(own, _incident(own, 1))
    own.guard.is_mute = True
    assert own.post(f"proposals/{proposal['id']}/accept")[1]["type"] == "/problems/guard-away"
    assert own.guard.rules
    own.kill()
    own.guard.is_mute = False
    own.start()
    until(lambda: not own.guard.rules, "the rule to be taken away again")
    assert own.get("proposals")["items"][0]["state"] == "open"


def test_the_evidence_of_an_incident_can_be_removed_and_its_line_stays(world: World) -> None:
    incident = _incident(world, next(NUMBERS))
    assert world.post(f"incidents/{incident}/note", {"text": "seen"})[1]["note"] == "seen"
    assert world.post(f"incidents/{incident}/remove-evidence")[0] == 200
    assert not (world.data / "incidents" / incident).exists()
    assert world.get(f"incidents/{incident}")["note"] == "seen"
    again = world.post(f"incidents/{incident}/remove-evidence")[1]
    assert again["type"] == "/problems/evidence-absent"
    assert world.post("incidents/..%2F..%2Fstate/remove-evidence")[0] == 404


def test_groups_are_put_together_and_taken_apart(world: World) -> None:
    incidents = [_incident(world, next(NUMBERS), diagnosis=one) for one in ("CRASHED", "FROZEN")]
    one, other = (world.get(f"incidents?limit=500&diagnosis={name}") for name in ("CRASHED", "FROZEN"))
    first, second = (
        next(line["fingerprint"] for line in lines["items"] if line["id"] == incident)
        for lines, incident in zip((one, other), incidents, strict=True)
    )
    assert world.post(f"groups/{first}/merge", {"into": second})[1]["merged"] == [first]
    assert world.post(f"groups/{second}/split")[1]["merged"] == []
    assert world.post(f"groups/{second}/split")[1]["type"] == "/problems/group-whole"
    acts = [act["verb"] for act in world.get("audit")["items"]]
    assert acts[:3] == ["split", "split", "merge"]


def test_a_drill_is_told(world: World) -> None:
    world.put("drill", {"fault": "poison", "ok": True, "outage_ms": 120, "scheduled": True, "incident": "i9"})
    assert world.get("drills")["items"][0]["fault"] == "poison"


def test_a_retry_is_looked_up_after_our_own_death(own: World) -> None:
    done, lost = _letter(own), _letter(own)
    for letter in (done, lost):
        own.ledger.held.clear()
        own.ledger.release.clear()
        thread = threading.Thread(target=_swallowed, args=(own, letter), daemon=True)
        thread.start()
        assert own.ledger.held.wait(20)
        own.kill()
        if letter == done:
            own.ledger.done[slip()["idempotency_key"]] = 0
            own.ledger.answer = own.ledger.book
            own.ledger.release.set()
            until(lambda: any(own.ledger.done.values()), "the ledger to book it")
        else:
            own.ledger.answer = lambda _: (503, {"outcome": "not_done"})
            own.ledger.release.set()
        thread.join(20)
        own.start()
        _settled(own, letter)
    assert own.state(done) == "RESOLVED"
    assert own.state(lost) == "QUARANTINED"
    until(lambda: lost in own.guard.rules, "its rule to be back")
    assert set(own.ledger.done.values()) <= {0, 1}


def _settled(world: World, letter: str) -> None:
    until(lambda: world.state(letter) != "RETRYING", "the letter to be looked up")


def _swallowed(world: World, letter: str) -> None:
    try:
        _retry(world, letter)
    except (OSError, ValueError):
        return


def test_a_bulk_goes_on_after_our_own_death(own: World) -> None:
    letters = [_letter(own) for _ in range(2)]
    own.kill()
    own.guard.serving = False
    own.start("--pace-s", "30")
    begun = own.post("letters/bulk", {"verb": "dry-run", "ids": letters})[1]
    until(lambda: own.get(f"bulk/{begun['id']}")["done"] == 1, "the first one to be done")
    own.kill()
    own.start()
    until(lambda: own.get(f"bulk/{begun['id']}")["ended"] == "done", "the bulk to end")
    assert own.get(f"bulk/{begun['id']}")["done"] == 2


def test_a_cancelled_bulk_leaves_the_others_where_they_are(own: World) -> None:
    own.kill()
    own.start("--pace-s", "30")
    letters = [_letter(own) for _ in range(2)]
    begun = own.post("letters/bulk", {"verb": "dry-run", "ids": letters})[1]
    until(lambda: own.get(f"bulk/{begun['id']}")["done"] == 1, "the first one to be done")
    assert own.post(f"bulk/{begun['id']}/cancel")[1]["ended"] == "cancelled"
    assert [own.get(f"letters/{one}")["dry_run"] is None for one in letters] == [False, True]


def test_a_second_investigator_leaves_once_the_first_listens(own: World) -> None:
    argv = [sys.executable, "-I", "-m", "postmortem", "serve", "--data", str(own.data)]
    argv += ["--socket", str(own.socket), "--control", "/nobody"]
    assert subprocess.run(argv, timeout=30, check=False).returncode == 0
    assert own.get("letters")["total"] == 0


def test_it_ends_by_itself_when_nobody_asks(own: World) -> None:
    own.kill()
    own.start("--idle-s", "0.2")
    process = own.process
    assert process is not None
    until(lambda: process.poll() is not None, "it to end")
    assert process.returncode == 0
    assert not own.socket.exists()
    assert os.access(own.data / "hardcore.db", os.R_OK)
