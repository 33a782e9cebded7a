"""What the guard may do by itself: the policy in force, its mode, and what a person has asked for.

A mode holds from the next thing on. What was begun is carried through in any mode: a start until the core serves, a
switch, a kill of a core that was stopped for it and could not go on. And what a person asks for is done in any mode:
the first start, a restart, a resume, a stop. So one value decides, `consent`: whether a person asked for what comes
next. Not chosen: a second manager that only watches. Two would have to agree on what they see.

A policy that was read anew holds at once: what waits keeps the time that it was given, and what begins gets the new one.
"""

import dataclasses

from msgspec import structs

from hardcore.model.observations import PolicyRead
from hardcore.model.phases import Phase
from hardcore.recovery import plan
from hardcore.recovery.budget import NS_PER_MS, NS_PER_S, Budget
from hardcore.recovery.course import Course
from hardcore.recovery.policy import Policy, read_policy
from hardcore.recovery.safety import safety
from hardcore.recovery.spare import spare
from hardcore.sentinel.witnesses.own_stall import LATE_INTERVALS

ACT = "act"
OBSERVE = "observe"


def watches_only(c: Course) -> bool:
    """Return whether nothing is done by itself for a core that serves."""
    return c.policy.mode != ACT


def is_mute(c: Course) -> bool:
    """Return whether nobody is told anything."""
    return c.policy.mode == OBSERVE


def withheld(c: Course) -> bool:
    """Return whether a core that is gone is left to a person."""
    return watches_only(c) and not c.consent


def adopt(c: Course, fact: PolicyRead) -> None:
    """Let this policy hold from now on. Its text was found right by whoever read it."""
    policy = read_policy(fact.text)
    assert isinstance(policy, Policy), f"a policy that was told of is right: {policy}"
    policy = dataclasses.replace(
        policy, alerts=c.policy.alerts
    )  # no fact carries an address; nothing here needs one
    c.given = structs.replace(c.given, policy=policy)
    c.budget = Budget(policy.max_restart_count, policy.restart_window_sec * NS_PER_S, c.budget.deaths_ns)
    c.deadline.late_ns = int(policy.health_check_interval_ms * NS_PER_MS * LATE_INTERVALS)
    c.bench.adopt(plan.patience(policy))
    c.worry.after_ms, c.worry.clean_ms = policy.degraded_after_ms, policy.clean_after_ms
    c.troubles.clean_ns = policy.clean_after_ms * NS_PER_MS
    c.court.rules = plan.rules(policy)
    numbers = safety(policy.safe_retry_ms, policy.disk_floor_mb, policy.disk_slow_ms, policy.slow_retry_sec)
    c.safety.retry_ns, c.safety.floor_bytes = numbers.retry_ns, numbers.floor_bytes
    c.safety.slow_ns, c.safety.slow_try_ns_max = numbers.slow_ns, numbers.slow_try_ns_max
    wants = spare(policy)
    c.spare.wanted, c.spare.floor_bytes = wants.wanted, wants.floor_bytes
    c.spare.startup_ns, c.spare.late_ns = wants.startup_ns, wants.late_ns
    if c.phase is Phase.FATAL and c.left and not (watches_only(c) or c.shut):
        c.deadline.due_ns = fact.at_ns  # it was left alone because of the mode, and the mode is another
