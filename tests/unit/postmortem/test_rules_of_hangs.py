"""What the rules read off a hang, a disk, a lock and a memory that ran out."""

from typing import Any

import pytest

from frontend import catalogue_reports as texts
from hardcore.model.verdicts import Diagnosis
from postmortem import incident
from postmortem.analyzer import registry
from postmortem.analyzer.case import Case, Confidence, Finding, read_threads
from postmortem.reports.report import finding_line
from tests.unit.postmortem import story
from tests.unit.postmortem.story import frame, thread

NS = 1_000_000_000
RUNNING: dict[str, Any] = {"pid": 7, "exit": None}
WAITS_A = thread(
    8,
    frame("wait_for_lock", 60, "core/guarded/locks.py", lock_name='"books"', held_by='"9"'),
    frame("settle", 3, transaction_id='"tx-9"', account_id='"assets:kb"'),
    name="writer",
)
WAITS_B = thread(
    9, frame("wait_for_lock", 60, "core/guarded/locks.py", lock_name='"rates"', held_by='"8"'), name="rates"
)
LOCKS = {"one": "<_thread.lock at 0x7f01>", "other": "<_thread.lock at 0x7f02>"}
OVER = {
    "command_id": "cmd-1",
    "kind": "transaction.post",
    "stage": "DECIDING",
    "transaction_id": "tx-1",
    "account_ids": ["assets:kb"],
    "thread": 8,
    "stage_ns": 10 * NS,
    "progress_ns": 12 * NS,
    "limit_ns": 2 * NS,
}


def case(diagnosis: str, threads: list[dict[str, Any]] | None = None, **other: Any) -> Case:
    facts = {
        name: other.pop(name)
        for name in ("evidence", "waits_for", "blamed", "grade", "deaths")
        if name in other
    }
    told = story.facts(diagnosis=diagnosis, core=RUNNING, **facts)
    process = other.pop("process", {"pid": 7})
    recorder = other.pop("recorder", {})
    one = incident.from_facts(story.ID, told)
    return Case(one, read_threads(threads), process, recorder, "", **other)


def found(one: Case) -> dict[str, Finding]:
    return {finding.rule: finding for finding in registry.examine(one)}


def test_a_deadlock_names_both_threads_both_locks_and_the_transaction() -> None:
    finding = found(case("DEADLOCK", [WAITS_A, WAITS_B]))["deadlock"]
    assert finding.confidence is Confidence.CERTAIN
    assert finding.values["ring"] == "writer → [books] → rates → [rates] → writer"
    assert (finding.transaction_ids, finding.account_ids) == (("tx-9",), ("assets:kb",))


def test_threads_that_wait_in_a_row_are_no_ring() -> None:
    last = thread(9, frame("commit"), name="rates")
    assert "deadlock" not in found(case("DEADLOCK", [WAITS_A, last]))


def test_locks_without_a_name_make_a_likely_ring() -> None:
    pair = [thread(tid, frame("run", 1, "x.py", **LOCKS), name=name) for tid, name in ((8, "a"), (9, "b"))]
    finding = found(case("DEADLOCK", pair))["deadlock_likely"]
    assert (finding.confidence, finding.values["ring"]) == (Confidence.LIKELY, "a ↔ b")


def test_a_deadlock_without_stacks_claims_no_ring() -> None:
    assert found(case("DEADLOCK")) == {}


def test_whoever_held_the_interpreter_is_named_with_its_frame() -> None:
    idle = thread(7, frame("select"))
    holder = thread(8, frame("compile", 9), name="worker") | {"owns_gil": True}
    finding = found(case("GIL_HELD", [idle, holder]))["gil_held"]
    assert (finding.values["function"], finding.values["thread"]) == ("compile", "worker")
    assert finding.confidence is Confidence.CERTAIN


def test_an_interpreter_whose_holder_nobody_saw_is_only_likely() -> None:
    finding = found(case("GIL_HELD", [thread(7, frame("sort"))]))["gil_held"]
    assert finding.confidence is Confidence.LIKELY


@pytest.mark.parametrize(
    ("line", "said"), [(12, "the same place"), (99, "had found it in turn (core/x.py:99)")]
)
def test_the_first_look_and_the_last_one_are_compared(line: int, said: str) -> None:
    first = read_threads([thread(7, frame("turn", line))])
    finding = found(case("SPINNING", [thread(7, frame("turn", 12))], first_threads=first))["spinning"]
    assert any(said in fact for fact in finding.evidence)


def test_a_command_over_its_time_is_named_with_its_thread_and_its_ids() -> None:
    recorder = {"taken_at_ns": 20 * NS, "in_flight": [OVER]}
    both = found(case("TRANSACTION_TIMEOUT", [thread(8, frame("wait", 4))], recorder=recorder))
    finding = both["over_time"]
    assert (finding.values["seconds"], finding.values["limit"]) == ("8.0", "2.0"), "counted from its progress"
    assert (finding.transaction_ids, finding.account_ids) == (("tx-1",), ("assets:kb",))
    assert both["waits_in"].values["function"] == "wait"


def test_the_command_that_the_guard_blamed_is_told_even_where_the_page_gives_no_limit() -> None:
    recorder = {"taken_at_ns": 20 * NS, "in_flight": [OVER | {"limit_ns": 0}]}
    assert found(case("TRANSACTION_TIMEOUT", recorder=recorder)) == {}
    assert "over_time" in found(case("TRANSACTION_TIMEOUT", recorder=recorder, blamed=["cmd-1"]))


def test_the_program_that_held_the_store_is_named_and_the_core_itself_never() -> None:
    holders = [
        {"pid": 4711, "name": "sqlitebrowser", "ours": False},
        {"pid": 7, "name": "core", "ours": True},
    ]
    finding = found(case("DB_LOCKED", locks={"store_write_lock": holders}))["locked_out_by"]
    assert finding.values == {"name": "sqlitebrowser", "pid": "4711"}


def test_a_lock_whose_holder_nobody_saw_names_nobody() -> None:
    evidence = [{"kind": "store", "text": "a stranger has held it"}]
    finding = found(case("DB_LOCKED", evidence=evidence))["locked_out"]
    assert (finding.confidence, finding.evidence) == (Confidence.LIKELY, ("a stranger has held it",))


def test_a_database_that_was_away_is_told_whatever_began_the_outage_and_blames_nobody() -> None:
    deaths = [{"diagnosis": "STORE_AWAY"}, {"diagnosis": "STORE_AWAY"}]
    finding = found(case("KILLED_FROM_OUTSIDE", deaths=deaths))["store_away"]
    assert (finding.confidence, finding.evidence[-1]) == (Confidence.CERTAIN, "starts that met it: 2")


@pytest.mark.parametrize("diagnosis", ["DISK_FULL", "DISK_READ_ONLY", "DISK_STALLED"])
def test_the_disk_is_as_sure_as_the_guard_was_and_blames_nobody(diagnosis: str) -> None:
    evidence = [{"kind": "disk", "text": "0 MiB are free (ENOSPC)"}]
    finding = found(case(diagnosis, evidence=evidence, grade="likely"))[diagnosis.lower()]
    assert finding.confidence is Confidence.LIKELY
    assert finding.evidence == ("disk: 0 MiB are free (ENOSPC)",)


def test_a_start_that_waited_for_the_disk_says_so() -> None:
    assert "disk_full" in found(case("CRASHED", waits_for="DISK_FULL"))


def test_memory_that_ran_out_names_what_had_grown_as_likely() -> None:
    grown = [{"name": "builtins.dict", "count": 900, "size_bytes": 64 << 20, "new": False}]
    memory = {"growth": {"types": grown}, "group": {"memory.events": "oom 1\noom_kill 1"}}
    both = found(case("OUT_OF_MEMORY", memory=memory, process={"last_sample": {"rss_bytes": 512 << 20}}))
    assert both["out_of_memory"].values == {"mib": "512"}
    assert "memory group: memory.events = oom 1 oom_kill 1" in both["out_of_memory"].evidence
    assert both["grew"].confidence is Confidence.LIKELY
    assert "+900 objects, +64.0 MiB" in both["grew"].evidence[0]


def test_memory_without_censuses_claims_no_growth() -> None:
    assert list(found(case("OUT_OF_MEMORY"))) == ["out_of_memory_unsized"]


@pytest.mark.parametrize("strange", ["x", 7, None, [[1]], {"types": [None, {"size_bytes": "x"}]}])
def test_no_strange_piece_of_a_box_stops_a_rule(strange: Any) -> None:
    pieces = {"growth": strange, "group": strange, "store_write_lock": strange, "in_flight": strange}
    for diagnosis in Diagnosis:
        one = case(diagnosis, [WAITS_A], recorder=pieces, process={"last_sample": strange}, memory=pieces)
        for finding in registry.examine(one):
            assert all("{" not in finding_line(finding, language) for language in texts.LANGUAGES)


def every_rule() -> list[Case]:
    """One case for each rule of this page."""
    pair = [thread(tid, frame("run", 1, "x.py", **LOCKS), name=name) for tid, name in ((8, "a"), (9, "b"))]
    grown = {"growth": {"types": [{"name": "dict", "count": 1, "size_bytes": 1}]}}
    holders = {"store_write_lock": [{"pid": 4711, "name": "viewer"}]}
    return [
        case("DEADLOCK", [WAITS_A, WAITS_B]),
        case("DEADLOCK", pair),
        case("GIL_HELD", [thread(7, frame("sort"))]),
        case("TRANSACTION_TIMEOUT", recorder={"taken_at_ns": 20 * NS, "in_flight": [OVER]}),
        case("DB_LOCKED"),
        case("DB_LOCKED", locks=holders),
        case("STORE_AWAY"),
        case("OUT_OF_MEMORY", memory=grown),
        case("OUT_OF_MEMORY", process={"last_sample": {"rss_bytes": 512 << 20}}),
        *(case(one) for one in ("DISK_FULL", "DISK_READ_ONLY", "DISK_STALLED")),
    ]


def test_every_diagnosis_has_a_sentence() -> None:
    assert {str(one) for one in Diagnosis} <= set(texts.CAUSES)
