from typing import Any

import pytest

from frontend import catalogue_prevention as texts
from postmortem.analyzer import registry
from postmortem.analyzer.case import Case
from postmortem.analyzer.proposals import FOR_A_PERSON, Proposed, proposals
from postmortem.reports.report import proposal_text
from tests.unit.postmortem import story
from tests.unit.postmortem.test_rules_of_causes import case, core, trial

MS = 1_000_000


def proposed(one: Case) -> list[Proposed]:
    return list(proposals(one, registry.examine(one)))


def slot(**more: Any) -> dict[str, Any]:
    return {"taken_at_ns": 10**12, "in_flight": [{"command_id": "cmd-1", "stage": "DECIDING", **more}]}


def over_time(limit_ms: int, *, progress: bool = False) -> Case:
    page = slot(limit_ns=limit_ms * MS, stage_ns=10**9, progress_ns=2 * 10**9 if progress else 0)
    return case(page, diagnosis="TRANSACTION_TIMEOUT", core=core(signal=9), blamed=["cmd-1"])


def grew(body_bytes: int) -> Case:
    page = slot(payload_bytes=body_bytes)
    return case(page, diagnosis="OUT_OF_MEMORY", core=core(signal=9), suspects=["a" * 32])


def locked() -> Case:
    locks = {"store_write_lock": [{"pid": 7, "name": "viewer", "ours": False}]}
    one = case(diagnosis="DB_LOCKED")
    return Case(one.incident, (), {}, {}, "", locks=locks)


def held() -> Case:
    return case(
        diagnosis="CRASHED",
        trials=[trial("survived", "letter-1", fingerprint="f" * 64, kind="transaction.post")],
    )


def broken() -> Case:
    return case(diagnosis="CRASHED", core=core(signal=11), traceback='  File "x.py", line 3 in decide')


def test_a_wish_that_was_held_without_proof_may_be_refused_under_any_key() -> None:
    rules = [one.rule for one in proposed(held()) if one.kind == "fingerprint"]
    assert rules == [{"type": "fingerprint", "fingerprint": "f" * 64}]


def test_a_convicted_command_is_set_aside_already_and_proposed_by_nobody() -> None:
    one = case(diagnosis="CRASHED", trials=[trial("died", "letter-1", fingerprint="f" * 64)])
    assert not [each for each in proposed(one) if each.kind == "fingerprint"]


def test_a_kind_that_was_slow_but_went_on_is_given_more_time() -> None:
    assert [one.rule for one in proposed(over_time(5000, progress=True))] == [
        {"type": "deadline", "kind": "transaction.post", "limit_ms": 10_000}
    ]


def test_a_kind_that_hung_and_was_waited_for_long_is_given_less_time() -> None:
    assert [one.rule for one in proposed(over_time(20_000))] == [
        {"type": "deadline", "kind": "transaction.post", "limit_ms": 10_000}
    ]
    assert proposed(over_time(2000)) == []


def test_a_large_body_is_limited_in_size_and_a_small_one_in_number() -> None:
    assert [one.rule for one in proposed(grew(1 << 20))] == [
        {"type": "limit", "kind": "transaction.post", "per_minute": None, "body_bytes_max": 512 << 10}
    ]
    assert [one.rule for one in proposed(grew(500))] == [
        {"type": "limit", "kind": "transaction.post", "per_minute": 30, "body_bytes_max": None}
    ]


def test_nothing_is_limited_where_the_core_did_not_grow_during_the_command() -> None:
    assert proposed(case(slot(payload_bytes=1 << 20), diagnosis="OUT_OF_MEMORY", core=core(signal=9))) == []


def test_a_person_is_told_which_program_to_close() -> None:
    assert [(one.says, one.values) for one in proposed(locked())] == [
        ("off_the_lock", {"name": "viewer", "pid": "7"})
    ]


@pytest.mark.parametrize(
    "planned", [{"planned": True}, {"diagnosis": "OPERATOR"}, {"diagnosis": "PLANNED_SWITCH"}]
)
def test_what_was_wanted_needs_no_prevention(planned: dict[str, Any]) -> None:
    assert proposed(case(**planned)) == []


def test_a_proposal_keeps_its_id_however_often_the_report_is_made() -> None:
    assert proposed(over_time(20_000))[0].id == proposed(over_time(20_000))[0].id
    assert proposed(over_time(20_000))[0].id != proposed(over_time(5000, progress=True))[0].id


def test_every_proposal_has_its_sentence_in_each_language() -> None:
    cases = [
        held(),
        over_time(5000, progress=True),
        over_time(20_000),
        grew(1 << 20),
        grew(500),
        locked(),
        broken(),
    ]
    cases += [case(diagnosis=word) for word in FOR_A_PERSON]
    made = {one.says: one for each in cases for one in proposed(each)}
    assert set(made) == set(texts.PROPOSALS)
    for one in made.values():
        for language in ("ko", "en"):
            assert "{" not in proposal_text(one, language)


def test_no_text_of_prevention_lacks_a_language() -> None:
    for table in (
        texts.PROPOSALS,
        texts.CULPRITS,
        texts.CHANGES,
        texts.WHAT,
        texts.TITLES,
        texts.WORDS,
        texts.EXPORT,
    ):
        for key, text in table.items():
            assert set(text) == {"ko", "en"}, key
            assert all(text.values()), key


def test_hostile_slots_make_no_rule_out_of_range() -> None:
    for strange in (-1, 10**30, "x", None, True):
        one = case(
            slot(limit_ns=strange, payload_bytes=strange, stage_ns=strange, progress_ns=strange),
            diagnosis="TRANSACTION_TIMEOUT",
            blamed=["cmd-1"],
            in_flight=[story.command("cmd-1", "DECIDING", "tx", ["a"], "a" * 32)],
        )
        for each in proposed(one):
            assert each.rule is not None
            assert 1000 <= each.rule["limit_ms"] <= 300_000
