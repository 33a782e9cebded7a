"""Diagnosis + history + policy: whether to try again, when, and how long each phase may last."""

from typing import assert_never

from hardcore.model.phases import SERVING, Phase
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.budget import NS_PER_MS, NS_PER_S, backoff_ns
from hardcore.recovery.court import Rules
from hardcore.recovery.policy import Policy, Word
from hardcore.recovery.safety import PASSING
from hardcore.sentinel.verdict import Patience

#: Evidence that overruns its budget is given this much longer to hand over what it has.
EVIDENCE_SLACK_MS = 250
#: A core that is drained is given this much longer to say so.
DRAIN_SLACK_MS = 500
#: A trial may take so many times as long as a transaction: slow is not guilty.
TRIAL_PATIENCE = 3
#: A core that did not die is killed again this often: what kept the kill from it may be over.
KILL_AGAIN_MS = 5_000

#: What stops no answer.
_BESIDE = frozenset({Diagnosis.COMPONENT_STALLED})


def patience(policy: Policy) -> Patience:
    """Return how long the witnesses bear each kind of silence."""
    return Patience(
        policy.health_check_interval_ms,
        policy.health_check_timeout_ms,
        policy.confirm_deadlock_ms,
        policy.confirm_hang_ms,
        gc_grace_ms=policy.gc_grace_ms,
        transaction_ms=policy.transaction_timeout_ms,
        memory_bytes=policy.memory_limit_mb << 20,
        disk_floor_bytes=policy.disk_floor_mb << 20,
        disk_slow_ms=policy.disk_slow_ms,
        survey_ms=policy.survey_interval_ms,
    )


def rules(policy: Policy) -> Rules:
    """Return the numbers that the court goes by."""
    return Rules(
        limit_ms=TRIAL_PATIENCE * policy.transaction_timeout_ms,
        memory_bytes=policy.memory_limit_mb << 20,
        begin_ms=policy.startup_timeout_ms,
        trial_limit=policy.trial_limit,
        max_convictions=policy.max_convictions,
        source_stop_ns=policy.source_stop_sec * NS_PER_S,
    )


def patience_max_ns(policy: Policy) -> int:
    """Return the longest time for which anything may look ill before it is a verdict or will never be one."""
    longest_ms = max(policy.confirm_hang_ms, policy.gc_grace_ms, policy.transaction_timeout_ms)
    return longest_ms * NS_PER_MS


def hopeless(policy: Policy, diagnosis: Diagnosis, *, spent: bool) -> Diagnosis | None:
    """Return why another try makes no sense after this death, or None if it does.

    `spent`: the budget holds more deaths than it allows.
    """
    if not policy.asks(diagnosis, Word.REBOOT_PROCESS):
        return diagnosis
    return Diagnosis.CRASH_LOOP if spent else None


def may_read(policy: Policy, reason: Diagnosis | None, *, tried: bool) -> bool:
    """Return whether a core is started to serve reads only, since for `reason` another try makes no sense.

    `tried`: such a core was the last one; what ended it would end its like.
    """
    if reason is None or tried:
        return False
    kept = reason is Diagnosis.DB_LOCKED and policy.asks(reason, Word.DEGRADE)  # whoever reads needs no lock
    return kept or policy.asks(reason, Word.SAFE_MODE_ENTER)


def passes(policy: Policy, reason: Diagnosis | None) -> bool:
    """Return whether `reason` keeps a core from beginning only for a while, so that it is tried again and again.

    A lock that another program holds ends with that program, and a database server comes back; no number of starts says
    that it never will.
    """
    if reason is Diagnosis.STORE_AWAY:
        return True
    return reason is Diagnosis.DB_LOCKED and not policy.asks(reason, Word.AWAIT_OPERATOR)


def ends(policy: Policy, diagnosis: Diagnosis) -> bool:
    """Return whether a living core that is judged so is ended. A part that stands still ends nobody."""
    return diagnosis not in _BESIDE and policy.asks(diagnosis, Word.REBOOT_PROCESS)


def left_alone(policy: Policy, diagnosis: Diagnosis) -> bool:
    """Return whether a living core with this diagnosis stays as it is until a person does something about it."""
    if any(
        policy.asks(diagnosis, word) for word in (Word.REBOOT_PROCESS, Word.SAFE_MODE_ENTER, Word.DEGRADE)
    ):
        return False
    return diagnosis not in _BESIDE | PASSING or policy.asks(diagnosis, Word.AWAIT_OPERATOR)


def waits_for(
    phase: Phase, reason: Diagnosis | None, safe: Diagnosis | None, alone: Diagnosis | None = None
) -> str | None:
    """Return what keeps the guard from going on by itself, or None while it does.

    `alone`: why a core that serves badly or not at all is left as it is.
    `safe`: why reads only are served. Room on a disk and the end of a lock are looked for by itself; anything else a
    person has to mend.
    """
    if phase is Phase.UNKILLABLE:
        return str(phase)
    if phase in SERVING:
        person = safe if safe is not None and safe not in PASSING else alone
        return str(person) if person is not None else None
    return str(reason) if phase is Phase.FATAL and reason else None


def pause_ns(policy: Policy, tries: int, jitter: float) -> int:
    """Return the pause before the next start. `tries`: cores in a row that proved nothing.

    Only the successor of such a core waits longer and longer; a proven core is replaced at once.
    """
    if tries:
        return backoff_ns(tries, policy.backoff_initial_ms, policy.backoff_max_ms, jitter)
    return policy.restart_delay_ms * NS_PER_MS


def limit_ns(
    policy: Policy, phase: Phase, pause: int, reason: Diagnosis | None, *, imaged: bool = False
) -> int | None:
    """Return how long `phase` may last, in ns, or None for as long as it takes.

    `pause` is BACKOFF's own length; `reason` is why FATAL was entered: only a spent budget comes back by
    itself, since time alone heals neither a bad configuration nor a damaged ledger. `imaged`: an image of the
    memory was ordered with the evidence.
    """
    match phase:
        case Phase.ADOPTING | Phase.KILLING:
            return policy.kill_timeout_ms * NS_PER_MS
        case Phase.STARTING | Phase.PROVING:
            return policy.startup_timeout_ms * NS_PER_MS
        case Phase.PROBATION:
            return policy.probation_ms * NS_PER_MS
        case Phase.SNAPSHOT_LIVE:
            image_ms = policy.memory_image_budget_ms if imaged else 0
            return (policy.snapshot_budget_ms + image_ms + EVIDENCE_SLACK_MS) * NS_PER_MS
        case Phase.DRAINING:
            return (policy.drain_timeout_ms + DRAIN_SLACK_MS) * NS_PER_MS
        case Phase.SWITCHING:
            return policy.promote_timeout_ms * NS_PER_MS
        case Phase.STOPPING:
            return policy.stop_timeout_ms * NS_PER_MS
        case Phase.BACKOFF:
            return pause
        case Phase.FATAL:
            again = reason is Diagnosis.CRASH_LOOP and policy.slow_retry_sec
            return policy.slow_retry_sec * NS_PER_S if again else None
        case Phase.UNKILLABLE:
            return KILL_AGAIN_MS * NS_PER_MS
        case Phase.STOPPED | Phase.RUNNING | Phase.SUSPECT:
            return None
        case _:
            assert_never(phase)
