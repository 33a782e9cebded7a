"""What a policy would have done on a diagnosis, as facts: when it is acted on, what is done, who is suspect.

Asked before it happens (`hardcore policy explain DEADLOCK`), so it is read off the same words and numbers that the
guard goes by. The sentences stand in the catalogue: what is told here is which of them are true, and their numbers.
"""

from collections.abc import Mapping
from enum import StrEnum

import msgspec

from hardcore.model.verdicts import Diagnosis
from hardcore.recovery import plan
from hardcore.recovery.policy import FORECAST, LIVING, NEVER_REBOOT, Policy, Word
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
    PART_SILENT = "part-silent"
    OVER_LIMIT = "over-limit"
    FORESEEN = "foreseen"
    SENTINEL_GONE = "sentinel-gone"
    GATEWAY_GONE = "gateway-gone"
    ONLY_RECORDED = "only-recorded"
    WAITS_FOR_WORD = "waits-for-word"
    NOTHING = "nothing"
    ALERT = "alert"
    EVIDENCE_FIRST = "evidence-first"
    EVIDENCE_BESIDE = "evidence-beside"
    EVIDENCE_LEFT = "evidence-left"
    READS_ONLY = "reads-only"
    TRIES_TO_WRITE = "tries-to-write"
    TRIES_SLOWLY = "tries-slowly"
    READS_UNTIL_RESUME = "reads-until-resume"
    GOES_ON = "goes-on"
    LEFT_ALONE = "left-alone"
    WAITS_FOR_LOCK = "waits-for-lock"
    WAITS_FOR_SERVER = "waits-for-server"
    READS_MEANWHILE = "reads-meanwhile"
    ENDED_AND_STARTED = "ended-and-started"
    STARTED_AGAIN = "started-again"
    ADOPTED = "adopted"
    SPARES_GIVEN_UP = "spares-given-up"
    SWITCH_GIVEN_UP = "switch-given-up"
    WAITS = "waits"
    SHUT_DOWN = "shut-down"
    PART_STARTED = "part-started"
    SWITCHED_IN_QUIET = "switched-in-quiet"
    GATEWAY_STARTED = "gateway-started"
    GATEWAY_LEFT = "gateway-left"
    AGENTS_START = "agents-start"
    AGENTS_REST = "agents-rest"
    OVERDUE = "overdue"
    OVERDUE_RESTART = "overdue-restart"
    OVERDUE_READS = "overdue-reads"
    OVERDUE_STOP = "overdue-stop"
    SUSPECTS_TOUCHED = "suspects-touched"
    SUSPECTS_GROWN = "suspects-grown"
    SUSPECTS_NOBODY = "suspects-nobody"


class Line(msgspec.Struct, frozen=True):
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
    Diagnosis.COMPONENT_STALLED: ((Said.PART_SILENT, ()),),
    Diagnosis.MEMORY_PRESSURE: ((Said.OVER_LIMIT, ("memory_limit_mb",)),),
    Diagnosis.LEAK: ((Said.FORESEEN, ("forecast_horizon_sec", "forecast_confirm_sec")),),
    Diagnosis.FD_EXHAUSTION: ((Said.FORESEEN, ("forecast_horizon_sec", "forecast_confirm_sec")),),
    Diagnosis.SENTINEL_LOST: ((Said.SENTINEL_GONE, ()),),
    Diagnosis.GATEWAY_LOST: ((Said.GATEWAY_GONE, ("confirm_hang_ms",)),),
    Diagnosis.STARVED: ((Said.NEVER_ACTED_ON, ()),),
    Diagnosis.SLEPT: ((Said.NEVER_ACTED_ON, ()),),
}
#: What concerns no core that serves: only a person is told, and what goes on.
_BESIDE = {
    Diagnosis.SPARE_LOST: Said.SPARES_GIVEN_UP,
    Diagnosis.PLANNED_SWITCH: Said.SWITCH_GIVEN_UP,
}
#: What each word means once nobody has come in time.
_OVERDUE = {
    Word.SEND_ALERT: Said.OVERDUE,
    Word.REBOOT_PROCESS: Said.OVERDUE_RESTART,
    Word.SAFE_MODE_ENTER: Said.OVERDUE_READS,
    Word.SHUTDOWN: Said.OVERDUE_STOP,
}
#: Deeds after which a person is waited for.
_WAITING = frozenset({Said.WAITS, Said.LEFT_ALONE, Said.TRIES_SLOWLY, Said.READS_UNTIL_RESUME})


def explain(policy: Policy, diagnosis: Diagnosis) -> tuple[Line, ...]:
    """Return all that is true of this diagnosis under this policy, in the order in which it would happen."""
    if diagnosis in _BESIDE:
        alerts = (Line(Said.ALERT),) if _tells(policy, diagnosis) else ()
        return (*alerts, Line(_BESIDE[diagnosis]))
    when = [_line(policy, said, *names) for said, names in _WHEN.get(diagnosis, ((Said.AT_ONCE, ()),))]
    if when[0].said is Said.NEVER_ACTED_ON:
        return tuple(when)
    if diagnosis in {Diagnosis.SENTINEL_LOST, Diagnosis.GATEWAY_LOST}:
        return (*when, *_of_the_guard(policy, diagnosis))
    deeds = _deeds(policy, diagnosis)
    suspects = () if diagnosis in FORECAST | {Diagnosis.COMPONENT_STALLED} else (_suspects(diagnosis),)
    return (*when, *_held_back(policy), *deeds, *_late(policy, deeds), *suspects)


def _tells(policy: Policy, diagnosis: Diagnosis) -> bool:
    return policy.asks(diagnosis, Word.SEND_ALERT) and policy.mode != "observe"


def _held_back(policy: Policy) -> list[Line]:
    """Say what the mode makes of what follows."""
    match policy.mode:
        case "observe":
            return [Line(Said.ONLY_RECORDED)]
        case "assist":
            return [Line(Said.WAITS_FOR_WORD)]
        case _:
            return []


def _late(policy: Policy, deeds: list[Line]) -> list[Line]:
    """Say what is done when nobody comes, where somebody is waited for."""
    waits = policy.mode == "assist" or any(line.said in _WAITING for line in deeds)
    if policy.mode == "observe" or not waits:
        return []
    words = [word for word in _OVERDUE if word in policy.on_await_timeout]
    return [_line(policy, _OVERDUE[word], "await_operator_sec") for word in words]


def _of_the_guard(policy: Policy, diagnosis: Diagnosis) -> list[Line]:
    """Say what becomes of the guard itself, which no policy leaves dead, or of its gateway."""
    lines = [Line(Said.ALERT)] if _tells(policy, diagnosis) else []
    started = policy.asks(diagnosis, Word.REBOOT_PROCESS)
    if diagnosis is Diagnosis.SENTINEL_LOST:
        lines.append(Line(Said.ADOPTED))
    else:
        acts = started and policy.mode == "act"
        lines.append(Line(Said.GATEWAY_STARTED if acts else Said.GATEWAY_LEFT))
    return [*lines, Line(Said.AGENTS_START if started else Said.AGENTS_REST)]


def _deeds(policy: Policy, diagnosis: Diagnosis) -> list[Line]:
    lines = [Line(Said.ALERT)] if _tells(policy, diagnosis) else []
    ended = policy.asks(diagnosis, Word.REBOOT_PROCESS)
    if policy.asks(diagnosis, Word.SNAPSHOT):
        lines.append(_evidence(policy, diagnosis, ended=ended))
    if policy.asks(diagnosis, Word.SAFE_MODE_ENTER):
        lines.append(Line(Said.READS_ONLY))
        lines.append(_tries(policy, diagnosis))
    elif policy.asks(diagnosis, Word.SHUTDOWN):
        lines.append(Line(Said.SHUT_DOWN))
    elif ended and diagnosis is not Diagnosis.COMPONENT_STALLED:
        lines.append(Line(Said.ENDED_AND_STARTED if diagnosis in LIVING else Said.STARTED_AGAIN))
    elif diagnosis in FORECAST | {Diagnosis.COMPONENT_STALLED}:
        lines += _of_a_part(policy, diagnosis)
    elif diagnosis in LIVING and policy.words(diagnosis) != {Word.NONE}:
        lines.append(Line(Said.LEFT_ALONE if plan.left_alone(policy, diagnosis) else Said.GOES_ON))
    elif policy.words(diagnosis) != {Word.NONE} and not plan.passes(policy, diagnosis):
        lines.append(Line(Said.WAITS))
    if plan.passes(policy, diagnosis):
        away = diagnosis is Diagnosis.STORE_AWAY
        lines.append(_line(policy, Said.WAITS_FOR_SERVER if away else Said.WAITS_FOR_LOCK, "backoff_max_ms"))
        if plan.may_read(policy, diagnosis, tried=False):
            lines.append(Line(Said.READS_MEANWHILE))
    return lines or [Line(Said.NOTHING)]


def _of_a_part(policy: Policy, diagnosis: Diagnosis) -> list[Line]:
    """Say what is done while the core answers: one part of it, or another core in a quiet moment."""
    lines = [Line(Said.PART_STARTED)] if policy.asks(diagnosis, Word.RESTART_COMPONENT) else []
    if policy.asks(diagnosis, Word.PLANNED_SWITCH):
        lines.append(Line(Said.SWITCHED_IN_QUIET))
    return lines


def _evidence(policy: Policy, diagnosis: Diagnosis, *, ended: bool) -> Line:
    if diagnosis not in LIVING:
        return Line(Said.EVIDENCE_LEFT)
    return _line(policy, Said.EVIDENCE_FIRST, "snapshot_budget_ms") if ended else Line(Said.EVIDENCE_BESIDE)


def _suspects(diagnosis: Diagnosis) -> Line:
    if diagnosis is Diagnosis.OUT_OF_MEMORY:
        return Line(Said.SUSPECTS_GROWN)
    return Line(Said.SUSPECTS_TOUCHED if diagnosis in FROM_INSIDE else Said.SUSPECTS_NOBODY)


def _tries(policy: Policy, diagnosis: Diagnosis) -> Line:
    """Say when a core that reads only tries to write again."""
    if diagnosis in PASSING:
        return _line(policy, Said.TRIES_TO_WRITE, "safe_retry_ms")
    if diagnosis in NEVER_REBOOT or not policy.slow_retry_sec:
        return Line(Said.READS_UNTIL_RESUME)
    return _line(policy, Said.TRIES_SLOWLY, "slow_retry_sec")


def _line(policy: Policy, said: Said, *names: str) -> Line:
    return Line(said, tuple((name, getattr(policy, name)) for name in names))
