import itertools
from typing import Any

import pytest
from msgspec.structs import replace

from postmortem import incident
from postmortem.analyzer import registry
from postmortem.analyzer.case import Case, Confidence, Finding, read_threads
from postmortem.analyzer.culprit import name_culprit
from postmortem.analyzer.tape import Look, Tape, curve, read_tape
from postmortem.reports.report import finding_line
from tests.unit.postmortem import story
from tests.unit.postmortem.story import frame, thread

MIB = 1 << 20
NS = 1_000_000_000
STORY = """2026-11-22 09:41:27 INFO core Serving the ledger of <masked>.
Traceback (most recent call last):
  File "core/service.py", line 20, in run
  File "core/ledger/decider.py", line 88, in decide
ZeroDivisionError: <masked>
"""
NATIVE = """Fatal Python error: Segmentation fault

Current thread 0x00007f2 (most recent call first):
  File "core/asked.py", line 5 in asked_before

Fatal Python error: Segmentation fault

Current thread 0x00007f2 (most recent call first):
  File "ledger/decider.py", line 88 in decide

Current thread's C stack trace (most recent call first):
  Binary file "/usr/bin/python3.14", at _Py_DumpStack+0x31 [0x55]
  Binary file "/lib/libc.so.6", at +0x45330 [0x7f]
  Binary file "/lib/libsqlite3.so.0", at sqlite3_step+0x1c [0x7f]
"""


def case(
    recorder: dict[str, Any] | None = None,
    threads: tuple[dict[str, Any], ...] = (),
    tape: Tape | None = None,
    log: str = "",
    traceback: str = "",
    **facts: Any,
) -> Case:
    return Case(
        incident.from_facts(story.ID, story.facts(**facts)),
        read_threads(list(threads)),
        {"pid": 101},
        recorder or {},
        traceback,
        log=log,
        tape=tape or Tape(),
    )


def core(**how: int) -> dict[str, Any]:
    return {"pid": 101, "epoch": 7, "exit": how}


def trial(ordeal: str, letter: str = "", **more: Any) -> dict[str, Any]:
    return {
        "name": "a" * 32,
        "command_id": "cmd-1",
        "ordeal": ordeal,
        "letter": letter,
        "took_ms": 40,
        "why": "",
        **more,
    }


def found(one: Case) -> dict[str, Finding]:
    return {finding.rule: finding for finding in registry.examine(one)}


def crashed(**more: Any) -> Case:
    return case(diagnosis="CRASHED", core=core(signal=11), **more)


def finished(kind: str, at_ns: int) -> dict[str, Any]:
    return {
        "stage": "FREE",
        "command_id": f"done-{kind}",
        "kind": kind,
        "transaction_id": f"tx-{kind}",
        "key_hash": "d" * 32,
        "account_ids": ["assets:cash"],
        "stage_ns": at_ns,
    }


def component(name: str, *, silent_s: int, since_ns: int = 1) -> dict[str, Any]:
    page = {"name": name, "since_ns": since_ns, "beat_ns": (100 - silent_s) * NS, "limit_ns": 10 * NS}
    return {"taken_at_ns": 100 * NS, "components": [page]}


def busy() -> Tape:
    return Tape(late_ns=tuple(range(300_000_000, 300_000_006)))


def every_rule() -> list[Case]:
    words = {"code": "BUG", "text": "a mistake of our own"}
    batch = [story.command(f"cmd-{n}", "WRITING", f"tx-{n}", ["assets:cash"], "c" * 32) for n in (1, 2)]
    near = {"taken_at_ns": 100 * NS, "finished": [finished("import.row", 99 * NS)]}
    often = [{"kind": "near", "text": "kind import.row had finished"}]
    return [
        *(crashed(trials=[trial(ordeal, "letter-1")]) for ordeal in ("died", "hung", "grew", "untried")),
        case(diagnosis="LEAK", planned=True, tape=Tape(course=((-600.0, 100 * MIB), (0.0, 300 * MIB)))),
        *(crashed(trials=[trial("survived", letter)]) for letter in ("", "letter-1")),
        crashed(in_flight=batch),
        crashed(in_flight=[], recorder=near),
        crashed(in_flight=[], recorder=near, evidence=often),
        case(diagnosis="EXITED", core=core(code=70), log=STORY),
        case(diagnosis="EXITED", core=core(code=70), last_words=words),
        *(
            case(diagnosis=word, last_words=words)
            for word in ("CONFIG_INVALID", "STARTUP_FAILED", "CRASH_LOOP")
        ),
        case(diagnosis="COMPONENT_STALLED", recorder=component("importer", silent_s=20)),
        case(diagnosis="COMPONENT_STALLED"),
        case(diagnosis="STARVED"),
        case(diagnosis="SLEPT"),
        crashed(tape=busy()),
    ]


def cut_short() -> tuple[Finding, ...]:
    def never_ends(_case: Case) -> list[Finding]:
        raise registry.OverTimeError

    return registry.examine(case(), (never_ends,))


def test_what_does_it_again_is_the_culprit_and_certain() -> None:
    one = crashed(trials=[trial("survived", name="b" * 32, command_id="cmd-2"), trial("died", "letter-1")])
    finding = found(one)["poison_died"]
    assert finding.confidence is Confidence.CERTAIN
    assert finding.transaction_ids == ("tx-1",)
    assert finding.account_ids == ("assets:bank:kb", "expenses:food")
    assert "it is set aside as letter letter-1" in finding.evidence
    culprit = name_culprit(one, registry.examine(one))
    assert culprit is not None
    assert (culprit.why, culprit.confidence, culprit.command_id) == (
        "reproduced",
        Confidence.CERTAIN,
        "cmd-1",
    )


def test_a_suspect_that_survived_its_trial_is_told_as_cleared_and_never_named_as_certain() -> None:
    one = crashed(trials=[trial("survived")])
    assert found(one)["cleared"].values == {"count": "1"}
    assert "at_work" not in found(one)
    assert name_culprit(one, registry.examine(one)) is None


def test_what_was_held_without_proof_is_never_called_a_poison() -> None:
    for ordeal, rule in (("survived", "unproven"), ("untried", "untried")):
        finding = found(crashed(trials=[trial(ordeal, "letter-1")]))[rule]
        assert finding.confidence is Confidence.UNKNOWN
        assert "waits for a person" in finding_line(finding, "en")
        assert ("did not do it again" in finding_line(finding, "en")) == (ordeal == "survived")


def test_beside_a_convicted_one_nobody_is_likely() -> None:
    assert "at_work" not in found(
        crashed(trials=[trial("died", "letter-1", name="b" * 32, command_id="cmd-2")])
    )


def test_a_command_at_work_in_a_crash_is_likely_and_says_that_it_proves_nothing() -> None:
    one = crashed()
    finding = found(one)["at_work"]
    assert (finding.confidence, finding.transaction_ids) == (Confidence.LIKELY, ("tx-1",))
    culprit = name_culprit(one, registry.examine(one))
    assert culprit is not None
    assert (culprit.why, culprit.account_ids) == ("at_work", ("assets:bank:kb", "expenses:food"))


@pytest.mark.parametrize("diagnosis", ["KILLED_FROM_OUTSIDE", "FROZEN", "DISK_FULL", "DB_LOCKED", "STARVED"])
def test_nobody_is_named_where_it_came_from_outside(diagnosis: str) -> None:
    one = case(diagnosis=diagnosis)
    assert "at_work" not in found(one)
    assert name_culprit(one, registry.examine(one)) is None


def test_a_command_on_another_thread_than_the_hung_one_is_not_told() -> None:
    stack = thread(101, frame("wait_for_ever", 3, "core/x.py"))
    slots = {"in_flight": [{"command_id": "cmd-1", "thread": 55}], "threads": {"loop": 101}}
    elsewhere = case(slots, (stack,), diagnosis="LOOP_BLOCKED", core=core(signal=9))
    assert "at_work" not in found(elsewhere)
    slots["in_flight"][0]["thread"] = 101  # type: ignore[index]
    there = case(slots, (stack,), diagnosis="LOOP_BLOCKED", core=core(signal=9))
    assert found(there)["at_work"].confidence is Confidence.LIKELY


def test_a_command_during_which_the_core_did_not_grow_is_not_told_of_for_want_of_memory() -> None:
    assert "at_work" not in found(case(diagnosis="OUT_OF_MEMORY", core=core(signal=9)))
    suspect = case(diagnosis="OUT_OF_MEMORY", core=core(signal=9), suspects=["a" * 32])
    assert found(suspect)["at_work"].transaction_ids == ("tx-1",)


def test_of_a_batch_nobody_is_named() -> None:
    batch = [story.command(f"cmd-{n}", "WRITING", f"tx-{n}", ["assets:cash"], "c" * 32) for n in (1, 2)]
    one = crashed(in_flight=batch)
    assert found(one)["batch_at_work"].confidence is Confidence.UNKNOWN
    assert name_culprit(one, registry.examine(one)) is None


def test_what_finished_right_before_is_near_and_no_more() -> None:
    page = {"taken_at_ns": 100 * NS, "finished": [finished("a", 99 * NS), finished("b", 90 * NS)]}
    one = crashed(in_flight=[], recorder=page)
    finding = found(one)["near"]
    assert (finding.confidence, finding.transaction_ids) == (Confidence.UNKNOWN, ("tx-a",))
    assert name_culprit(one, registry.examine(one)) is None


def test_what_was_near_several_deaths_is_likely() -> None:
    page = {"taken_at_ns": 100 * NS, "finished": [finished("a", 99 * NS)]}
    one = crashed(
        in_flight=[],
        recorder=page,
        evidence=[{"kind": "near", "text": f"request {'d' * 32} had finished before"}],
    )
    assert found(one)["near_often"].transaction_ids == ("tx-a",)
    culprit = name_culprit(one, registry.examine(one))
    assert culprit is not None
    assert (culprit.why, culprit.confidence) == ("near", Confidence.LIKELY)


def test_that_a_kind_was_near_names_nobody() -> None:
    page = {"taken_at_ns": 100 * NS, "finished": [finished("a", 99 * NS)]}
    one = crashed(
        in_flight=[], recorder=page, evidence=[{"kind": "near", "text": "kind a had finished before"}]
    )
    assert found(one)["near_often"].account_ids == ()
    assert name_culprit(one, registry.examine(one)) is None


def test_a_command_of_the_writer_is_not_told_where_the_loops_thread_has_died() -> None:
    stack = (
        'Current thread 0x1 (most recent call first):\n  File "core/x.py", line 1 in f\n'
        '  File "asyncio/runners.py", line 9 in run\n'
    )
    page = {"threads": {"loop": 101}, "in_flight": [{"command_id": "cmd-1", "thread": 55}]}
    assert "at_work" not in found(crashed(recorder=page, traceback=stack))
    page["in_flight"][0]["thread"] = 101  # type: ignore[index]
    assert "at_work" in found(crashed(recorder=page, traceback=stack))


def test_an_uncaught_exception_names_its_kind_and_its_own_frame() -> None:
    finding = found(case(diagnosis="EXITED", core=core(code=70), log=STORY))["uncaught"]
    assert finding.values == {"kind": "ZeroDivisionError", "place": "decide (decider.py:88)"}
    assert finding.confidence is Confidence.CERTAIN


def test_a_story_from_before_the_last_start_is_only_likely() -> None:
    log = STORY + "2026-11-22 09:41:28 INFO core Serving the ledger of <masked>.\n"
    finding = found(case(diagnosis="EXITED", core=core(code=70), log=log))["uncaught"]
    assert finding.confidence is Confidence.LIKELY


@pytest.mark.parametrize("code", [0, 3, 65, 73, 75])
def test_a_story_in_the_log_explains_no_other_exit(code: int) -> None:
    assert "uncaught" not in found(case(diagnosis="EXITED", core=core(code=code), log=STORY))


def test_a_crash_has_its_native_frame_where_the_handler_prints_it() -> None:
    finding = found(crashed(traceback=NATIVE))["crashed_at"]
    assert finding.values["place"] == "decide (decider.py:88)"
    assert "native frame: sqlite3_step (libsqlite3.so.0)" in finding.evidence
    assert not any("_Py_DumpStack" in line for line in finding.evidence)


def test_a_crash_without_a_native_frame_says_that_it_is_missing() -> None:
    assert any("native frame is not on record" in line for line in found(crashed())["crashed"].evidence)


def test_a_silent_component_is_named_and_one_without_work_is_not() -> None:
    stalled = found(case(diagnosis="COMPONENT_STALLED", recorder=component("importer", silent_s=20)))
    assert stalled["component"].values == {"name": "importer", "seconds": "20.0"}
    assert stalled["component"].confidence is Confidence.CERTAIN
    assert "component" not in found(crashed(recorder=component("importer", silent_s=5)))
    assert "component" not in found(crashed(recorder=component("importer", silent_s=50, since_ns=0)))
    beside = found(crashed(recorder=component("importer", silent_s=20)))["component"]
    assert beside.confidence is Confidence.LIKELY


def test_a_busy_machine_is_a_remark_beside_the_cause() -> None:
    assert found(crashed(tape=busy()))["busy_machine"].confidence is Confidence.LIKELY
    assert "busy_machine" not in found(crashed(tape=Tape(late_ns=(300_000_000,))))


def test_running_out_of_memory_shows_how_it_grew() -> None:
    looks = tuple(Look(n * NS, 2, (100 + 50 * n) * MIB) for n in range(6))
    tape = Tape(looks=(*looks, Look(6 * NS, 2, 0), Look(7 * NS, 3, MIB)), lives={101: 2})
    one = case(diagnosis="OUT_OF_MEMORY", core=core(signal=9), tape=tape)
    finding = found(one)["out_of_memory"]
    assert finding.values == {"mib": "350"}
    assert "it grew from 100 MiB to 350 MiB in its last 5.0 s" in finding.evidence


def test_a_recording_is_read_for_its_numbers_whatever_else_it_holds() -> None:
    lines = [
        '{"version":1,"policy_sha256":"02e9","state":{"memory_bytes":536870912}}',
        '{"fact":{"CoreSpawned":{"at_ns":1,"life":4,"pid":101}}}',
        '{"fact":{"Sampled":{"at_ns":1000000000,"life":4,"process":{"ProcessSample":{"rss_bytes":5}}}}}',
        '{"fact":{"Sampled":{"at_ns":1900000000,"life":4,"process":{"ProcessSample":{"rss_bytes":7}}}}}',
        '{"fact":{"Sampled":' + "x" * (1 << 20),
        '{"fact":{"Sampled":null}}',
        "\x1b[2J<script>",
    ]
    tape = read_tape("\n".join(lines))
    assert (tape.policy_sha256, tape.memory_limit_bytes) == ("02e9", 512 * MIB)
    assert tape.late_ns == (900_000_000,)
    assert curve(tape, 101) == ((-0.9, 5), (0.0, 7))
    assert curve(tape, 99) == ()
    assert read_tape("") == Tape()


def test_a_rule_that_does_not_end_costs_its_own_finding_and_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "RULE_S_MAX", 0.05)

    def never_ends(_case: Case) -> list[Finding]:
        for number in itertools.count():
            assert number >= 0
        return []

    def falls_over(_case: Case) -> list[Finding]:
        raise KeyError("x")

    def finds(_case: Case) -> list[Finding]:
        return [Finding("killed", Confidence.CERTAIN, {}, ())]

    told = registry.examine(case(), (never_ends, falls_over, finds))
    assert [finding.rule for finding in told] == ["killed", "not_asked", "not_asked"]
    assert "it took longer than" in told[1].evidence[0]
    assert told[2].evidence == ("it failed: KeyError",)


def test_when_the_time_of_all_rules_is_over_the_rest_is_told_as_not_asked() -> None:
    ticks = iter([0.0, 0.0, 9.0])

    def finds(_case: Case) -> list[Finding]:
        return [Finding("killed", Confidence.CERTAIN, {}, ())]

    told = registry.examine(case(), (finds, finds), lambda: next(ticks))
    assert [finding.rule for finding in told] == ["killed", "not_asked"]


@pytest.mark.parametrize(
    "raw", [None, 3, "x", [], [None, 3, {"ordeal": 4}], [{"name": ["x"], "took_ms": "y"}]]
)
def test_trials_of_any_form_are_read(raw: Any) -> None:
    one = crashed(trials=raw)
    registry.examine(one)
    assert all(trial.ordeal == "untried" for trial in one.incident.trials)


def test_findings_of_hostile_pages_are_made_all_the_same() -> None:
    evil = "\x1b]0;x\x07<script>" + "a" * (1 << 20)
    page = {
        "taken_at_ns": 10**30,
        "in_flight": [{"command_id": evil, "thread": evil}],
        "components": [{"name": evil, "since_ns": 1, "beat_ns": evil, "limit_ns": 1}],
        "finished": [{"command_id": evil, "stage_ns": {}}],
    }
    one = crashed(recorder=page, log=evil, traceback=evil, trials=[trial("died", evil, command_id=evil)])
    assert "not_asked" not in found(replace(one, tape=busy()))


def test_a_number_that_a_trial_made_up_on_its_copy_is_not_told_as_the_transactions() -> None:
    one = crashed(trials=[trial("died", "letter-1", transaction_id="tx-made-up")])
    told = found(one)["poison_died"]
    assert "tx-made-up" not in (*told.transaction_ids, told.values["transaction"])
