"""What a policy would have done on a diagnosis, as facts: when it is acted on, what is done, who is suspect.

Asked before it happens (`hardcore policy explain DEADLOCK`), so it is read off the same words and numbers that the
guard goes by. The sentences stand in the catalogue: what is told here is which of them are true, and their numbers.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from hardcore.model.verdicts import Diagnosis
from hardcore.recovery import plan
from hardcore.recovery.policy import EFFECT, LIVING, Policy, Word
from hardcore.recovery.safety import PASSING
from hardcore.recovery.trial import FROM_INSIDE


class Said(StrEnum):
    """The sentences that may be true of a diagnosis under a policy."""

    AT_ONCE = "at-once"
    CONCLUSIVE = "conclusive"
    HANG = "hang"
    COLLECTING = "collecting"
    OVER_TIME = "over-time"
    HELD_TWICE = "held-twice"
    SURVEYED_TWICE = "surveyed-twice"
    SLOW_WRITE = "slow-write"
    NOT_READY = "not-ready"
    BUDGET_SPENT = "budget-spent"
    NEVER_ACTED_ON = "never-acted-on"
    NOT_MADE = "not-made"
    NOTHING = "nothing"
    ALERT = "alert"
    EVIDENCE_FIRST = "evidence-first"
    EVIDENCE_BESIDE = "evidence-beside"
    EVIDENCE_LEFT = "evidence-left"
    READS_ONLY = "reads-only"
    TRIES_TO_WRITE = "tries-to-write"
    READS_UNTIL_RESUME = "reads-until-resume"
    GOES_ON = "goes-on"
    LEFT_ALONE = "left-alone"
    WAITS_FOR_LOCK = "waits-for-lock"
    READS_MEANWHILE = "reads-meanwhile"
    ENDED_AND_STARTED = "ended-and-started"
    STARTED_AGAIN = "started-again"
    ADOPTED = "adopted"
    SPARES_GIVEN_UP = "spares-given-up"
    SWITCH_GIVEN_UP = "switch-given-up"
    WAITS = "waits"
    LESS_THAN_ITS_NAME = "less-than-its-name"
    SUSPECTS_TOUCHED = "suspects-touched"
    SUSPECTS_GROWN = "suspects-grown"
    SUSPECTS_NOBODY = "suspects-nobody"


@dataclass(frozen=True, slots=True)
class Line:
    """One sentence that is true, and the settings that it names with their values."""

    said: Said
    numbers: tuple[tuple[str, int], ...] = ()


#: When each diagnosis is acted on, and the settings that say so. What is not listed is a fact at once.
_WHEN: Mapping[Diagnosis, tuple[tuple[Said, tuple[str, ...]], ...]] = {
    Diagnosis.FROZEN: ((Said.CONCLUSIVE, ("confirm_deadlock_ms",)),),
    Diagnosis.DEADLOCK: ((Said.CONCLUSIVE, ("confirm_deadlock_ms",)),),
    Diagnosis.LOOP_BLOCKED: (
        (Said.CONCLUSIVE, ("confirm_deadlock_ms",)),
        (Said.HANG, ("confirm_hang_ms",)),
    ),
    Diagnosis.GIL_HELD: (
        (Said.CONCLUSIVE, ("confirm_deadlock_ms",)),
        (Said.HANG, ("confirm_hang_ms",)),
        (Said.COLLECTING, ("gc_grace_ms",)),
    ),
    Diagnosis.SPINNING: ((Said.HANG, ("confirm_hang_ms",)),),
    Diagnosis.NO_PROGRESS: ((Said.HANG, ("confirm_hang_ms",)),),
    Diagnosis.TRANSACTION_TIMEOUT: ((Said.OVER_TIME, ("transaction_timeout_ms",)),),
    Diagnosis.DB_LOCKED: ((Said.HELD_TWICE, ("confirm_hang_ms",)),),
    Diagnosis.DISK_FULL: ((Said.SURVEYED_TWICE, ("survey_interval_ms", "disk_floor_mb")),),
    Diagnosis.DISK_READ_ONLY: ((Said.SURVEYED_TWICE, ("survey_interval_ms", "disk_floor_mb")),),
    Diagnosis.DISK_STALLED: ((Said.SLOW_WRITE, ("disk_slow_ms",)),),
    Diagnosis.STARTUP_FAILED: ((Said.NOT_READY, ("startup_timeout_ms",)),),
    Diagnosis.CRASH_LOOP: ((Said.BUDGET_SPENT, ("max_restart_count", "restart_window_sec")),),
    Diagnosis.STARVED: ((Said.NEVER_ACTED_ON, ()),),
    Diagnosis.SLEPT: ((Said.NEVER_ACTED_ON, ()),),
}
#: Diagnoses that a policy may already name and that nothing makes yet.
_NOT_MADE = frozenset(
    {
        Diagnosis.COMPONENT_STALLED,
        Diagnosis.MEMORY_PRESSURE,
        Diagnosis.LEAK,
        Diagnosis.FD_EXHAUSTION,
        Diagnosis.GATEWAY_LOST,
    }
)


#: What concerns no core that serves: only a person is told, and what goes on.
_BESIDE = {
    Diagnosis.SPARE_LOST: Said.SPARES_GIVEN_UP,
    Diagnosis.PLANNED_SWITCH: Said.SWITCH_GIVEN_UP,
}


def explain(policy: Policy, diagnosis: Diagnosis) -> tuple[Line, ...]:
    """Return all that is true of this diagnosis under this policy, in the order in which it would happen."""
    if diagnosis in _NOT_MADE:
        return (Line(Said.NOT_MADE),)
    if diagnosis in _BESIDE:
        alerts = (Line(Said.ALERT),) if policy.asks(diagnosis, Word.SEND_ALERT) else ()
        return (*alerts, Line(_BESIDE[diagnosis]))
    when = [_line(policy, said, *names) for said, names in _WHEN.get(diagnosis, ((Said.AT_ONCE, ()),))]
    if when[0].said is Said.NEVER_ACTED_ON:
        return tuple(when)
    return (*when, *_deeds(policy, diagnosis), _suspects(diagnosis))


def _deeds(policy: Policy, diagnosis: Diagnosis) -> list[Line]:
    lines = [Line(Said.ALERT)] if policy.asks(diagnosis, Word.SEND_ALERT) else []
    ended = policy.asks(diagnosis, Word.REBOOT_PROCESS)
    if policy.asks(diagnosis, Word.SNAPSHOT):
        lines.append(_evidence(policy, diagnosis, ended=ended))
    if policy.asks(diagnosis, Word.SAFE_MODE_ENTER):
        lines.append(Line(Said.READS_ONLY))
        tries = _line(policy, Said.TRIES_TO_WRITE, "safe_retry_ms")
        lines.append(tries if diagnosis in PASSING else Line(Said.READS_UNTIL_RESUME))
    elif diagnosis is Diagnosis.SENTINEL_LOST:
        lines.append(Line(Said.ADOPTED))
    elif ended:
        lines.append(Line(Said.ENDED_AND_STARTED if diagnosis in LIVING else Said.STARTED_AGAIN))
    elif diagnosis in LIVING and policy.words(diagnosis) != {Word.NONE}:
        lines.append(Line(Said.LEFT_ALONE if plan.left_alone(policy, diagnosis) else Said.GOES_ON))
    elif policy.words(diagnosis) != {Word.NONE}:
        lines.append(Line(Said.WAITS))
    if plan.passes(policy, diagnosis):
        lines.append(_line(policy, Said.WAITS_FOR_LOCK, "backoff_max_ms"))
        if plan.may_read(policy, diagnosis, tried=False):
            lines.append(Line(Said.READS_MEANWHILE))
    if any(word in EFFECT for word in policy.words(diagnosis)):
        lines.append(Line(Said.LESS_THAN_ITS_NAME))
    return lines or [Line(Said.NOTHING)]


def _evidence(policy: Policy, diagnosis: Diagnosis, *, ended: bool) -> Line:
    if diagnosis not in LIVING:
        return Line(Said.EVIDENCE_LEFT)
    return _line(policy, Said.EVIDENCE_FIRST, "snapshot_budget_ms") if ended else Line(Said.EVIDENCE_BESIDE)


def _suspects(diagnosis: Diagnosis) -> Line:
    if diagnosis is Diagnosis.OUT_OF_MEMORY:
        return Line(Said.SUSPECTS_GROWN)
    return Line(Said.SUSPECTS_TOUCHED if diagnosis in FROM_INSIDE else Said.SUSPECTS_NOBODY)


def _line(policy: Policy, said: Said, *names: str) -> Line:
    return Line(said, tuple((name, getattr(policy, name)) for name in names))
