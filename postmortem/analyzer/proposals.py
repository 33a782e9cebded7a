"""What would have prevented an incident, as data that a person accepts with one click.

A proposal comes from what was found and from nothing else: where no rule of the house would have helped, there is none,
because a list that always has three entries is read by nobody. Those that a machine can keep carry the rule in the form
of the wire (`docs/wires.md` section 13, without its id, which whoever enforces it gives); the others are a person's to do.
Convicted commands are set aside already and are no proposal.
"""

import hashlib
import json
from collections.abc import Iterator, Mapping
from typing import Any

import msgspec

from postmortem.analyzer.case import Case, Finding
from postmortem.incident import Command, deciding, mappings, number, text

PROPOSALS_MAX = 8
_NS_PER_MS = 1_000_000
#: Deadlines are whole seconds, within what a policy may say.
DEADLINE_MS_MIN, DEADLINE_MS_MAX = 1_000, 300_000
#: A body beyond it is large for a household's ledger; a limit below it would refuse ordinary entries.
BODY_BYTES_MIN = 16 << 10
#: So often in a minute is more than a person types, and less than what brought the core down.
PER_MINUTE = 30
#: A hang that was waited for this long was judged late.
LONG_HANG_MS = 5_000
#: What a person has to do, by diagnosis; the sentences stand in the catalogue.
FOR_A_PERSON: Mapping[str, str] = {
    "DISK_FULL": "free_the_disk",
    "DISK_READ_ONLY": "make_writable",
    "DISK_STALLED": "look_at_the_disk",
    "STORE_CORRUPT": "go_back_to_a_copy",
    "CONFIG_INVALID": "correct_the_setting",
    "STARVED": "ease_the_machine",
    "FROZEN": "who_stopped_it",
    "KILLED_FROM_OUTSIDE": "who_killed_it",
    "LEAK": "find_the_leak",
    "FD_EXHAUSTION": "find_the_open_files",
}


#: What a planned switch has only put off: what grows grows in the next core as well.
FORESTALLED = frozenset({"LEAK", "FD_EXHAUSTION", "MEMORY_PRESSURE"})
_ASKED_FOR = frozenset({"OPERATOR", "PLANNED_SWITCH"})


class Proposed(msgspec.Struct, frozen=True):
    """One proposal. `id` is the same whenever the report is made; `says` is a key of the catalogue with `values`."""

    id: str
    kind: str  # "fingerprint" | "limit" | "deadline" | "person"
    says: str
    values: Mapping[str, str]
    rule: Mapping[str, Any] | None = None


def proposals(case: Case, findings: tuple[Finding, ...]) -> tuple[Proposed, ...]:
    """Return what would have prevented it, the surest first, at most PROPOSALS_MAX. What was
    planned has none, but where it only put something off.
    """
    forestalled = case.incident.diagnosis in FORESTALLED
    if (case.incident.planned and not forestalled) or case.incident.diagnosis in _ASKED_FOR:
        return ()
    made: dict[str, Proposed] = {}
    for one in (*_fingerprints(case), *_limits(case), *_deadlines(case), *_persons(case, findings)):
        made.setdefault(one.id, one)
    return tuple(made.values())[:PROPOSALS_MAX]


def _fingerprints(case: Case) -> Iterator[Proposed]:
    """Held without proof, but the same wish under another key would be run: refuse the wish itself."""
    for trial in case.incident.trials:
        if trial.fingerprint and trial.letter and not trial.reproduced:
            rule = {"type": "fingerprint", "fingerprint": trial.fingerprint}
            yield _made(
                case, "fingerprint", "refuse_the_wish", rule, letter=trial.letter, kind=trial.kind or "?"
            )


def _limits(case: Case) -> Iterator[Proposed]:
    """Memory that grew during a command: by a large body, bound its size; else how many of the kind there may be."""
    if case.incident.diagnosis != "OUT_OF_MEMORY":
        return
    slots = {text(one.get("command_id")): one for one in mappings(case.recorder.get("in_flight"))}
    suspects = [one for one in deciding(case.incident) if one.key_hash in case.incident.suspects and one.kind]
    for command in suspects[:1]:
        body_bytes = number(slots.get(command.command_id, {}).get("payload_bytes")) or 0
        if body_bytes > BODY_BYTES_MIN:
            most = max(BODY_BYTES_MIN, body_bytes // 2)
            rule = {"type": "limit", "kind": command.kind, "per_minute": None, "body_bytes_max": most}
            yield _made(case, "limit", "limit_the_size", rule, kind=command.kind, kib=str(most >> 10))
        else:
            rule = {"type": "limit", "kind": command.kind, "per_minute": PER_MINUTE, "body_bytes_max": None}
            yield _made(case, "limit", "limit_the_rate", rule, kind=command.kind, count=str(PER_MINUTE))


def _deadlines(case: Case) -> Iterator[Proposed]:
    """A kind that was slow but went on gets more time; one that hung and was judged late gets less."""
    if case.incident.diagnosis != "TRANSACTION_TIMEOUT":
        return
    slots = {text(one.get("command_id")): one for one in mappings(case.recorder.get("in_flight"))}
    for command in _over(case):
        slot = slots.get(command.command_id, {})
        limit_ms = (number(slot.get("limit_ns")) or 0) // _NS_PER_MS
        if limit_ms <= 0 or not command.kind:
            continue
        if _went_on(slot):
            rule = _deadline(command.kind, min(DEADLINE_MS_MAX, 2 * limit_ms))
            yield _made(case, "deadline", "more_time", rule, kind=command.kind, seconds=_seconds(rule))
        elif limit_ms >= LONG_HANG_MS:
            rule = _deadline(command.kind, max(DEADLINE_MS_MIN, limit_ms // 2))
            yield _made(case, "deadline", "less_time", rule, kind=command.kind, seconds=_seconds(rule))


def _over(case: Case) -> list[Command]:
    blamed = [one for one in case.incident.in_flight if one.command_id in case.incident.blamed]
    return (blamed or [one for one in case.incident.in_flight if one.stage == "DECIDING"])[:1]


def _went_on(slot: Mapping[str, Any]) -> bool:
    """Tell whether the command had reported progress since it began to be decided."""
    return (number(slot.get("progress_ns")) or 0) > (number(slot.get("stage_ns")) or 0) > 0


def _persons(case: Case, findings: tuple[Finding, ...]) -> Iterator[Proposed]:
    for finding in findings:
        if finding.rule == "locked_out_by":
            yield _made(case, "person", "off_the_lock", None, **finding.values)
    said = FOR_A_PERSON.get(case.incident.diagnosis) or FOR_A_PERSON.get(case.incident.waits_for or "")
    if said is not None and case.incident.drill is None:
        yield _made(case, "person", said, None)
    if (
        any(one.rule in {"uncaught", "deadlock", "crashed_at"} for one in findings)
        and not case.incident.drill
    ):
        first = next(one for one in findings if one.rule in {"uncaught", "deadlock", "crashed_at"})
        where = first.values.get("place") or first.values.get("ring") or "?"
        yield _made(case, "person", "mend_the_code", None, place=where)


def _deadline(kind: str, limit_ms: int) -> dict[str, Any]:
    return {"type": "deadline", "kind": kind, "limit_ms": limit_ms}


def _seconds(rule: Mapping[str, Any]) -> str:
    return f"{rule['limit_ms'] / 1000:g}"


def _made(case: Case, kind: str, says: str, rule: Mapping[str, Any] | None, /, **values: str) -> Proposed:
    what = json.dumps([case.incident.id, kind, says, rule, values], sort_keys=True)
    made = hashlib.sha256(what.encode("utf-8", "backslashreplace")).hexdigest()[:32]
    return Proposed(made, kind, says, values, rule)
