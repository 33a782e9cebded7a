"""The rules, in the order in which their findings are told, and the time they may take.

An explicit list: a rule that finds itself by being in a folder is one that nobody decided on. A bundle is other
people's bytes, so a rule may meet one that makes it slow or that it falls over: then the report says which rule
could not be asked, and the rest of them stand.
"""

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from postmortem.analyzer import (
    at_work,
    blocked,
    component,
    crashed,
    deadlock,
    disk,
    exited,
    frozen,
    gateway_lost,
    gil_held,
    killed,
    leak,
    locked_out,
    near,
    no_progress,
    operator,
    out_of_memory,
    over_time,
    poison,
    sentinel_lost,
    startup,
    starved,
    store_away,
    uncaught,
)
from postmortem.analyzer.case import Case, Confidence, Finding, Rule

#: One rule and all of them together; whoever starts the analyzer ends it after 20 s.
RULE_S_MAX = 2.0
RULES_S_MAX = 8.0

RULES: tuple[Rule, ...] = (
    operator.examine,
    poison.examine,
    startup.examine,
    gateway_lost.examine,
    sentinel_lost.examine,
    crashed.examine,
    uncaught.examine,
    exited.examine,
    killed.examine,
    out_of_memory.examine,
    leak.examine,
    frozen.examine,
    blocked.examine,
    gil_held.examine,
    deadlock.examine,
    over_time.examine,
    locked_out.examine,
    store_away.examine,
    disk.examine,
    no_progress.examine,
    component.examine,
    at_work.examine,
    near.examine,
    starved.examine,
)
_ORDER = tuple(Confidence)


class OverTimeError(Exception):
    """A rule has taken longer than it may."""


def examine(
    case: Case, rules: tuple[Rule, ...] = RULES, clock: Callable[[], float] = time.monotonic
) -> tuple[Finding, ...]:
    """Return what the rules find in the case, the surest first. A rule that could not be asked is told as such."""
    give_up_at = clock() + RULES_S_MAX
    findings = []
    for rule in rules:
        left_s = min(RULE_S_MAX, give_up_at - clock())
        if left_s <= 0:
            findings.append(_cut(rule, "the time of all rules was over"))
            continue
        try:
            with _no_longer_than(left_s):
                findings += rule(case)
        except OverTimeError:
            findings.append(_cut(rule, f"it took longer than {left_s:.1f} s"))
        except Exception as error:  # noqa: BLE001  what one rule falls over must not cost the report of an incident
            findings.append(_cut(rule, f"it failed: {type(error).__name__}"))
    return tuple(sorted(findings, key=lambda finding: _ORDER.index(finding.confidence)))


def _cut(rule: Rule, why: str) -> Finding:
    name = rule.__module__.rpartition(".")[2]
    return Finding("not_asked", Confidence.UNKNOWN, {"rule": name}, (why,))


@contextmanager
def _no_longer_than(seconds: float) -> Iterator[None]:
    """Raise OverTimeError in what is done here after `seconds`. On another thread than the main one nothing rings:
    there the bound of all rules holds, which is asked between them.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def ring(_number: int, _frame: FrameType | None) -> None:
        raise OverTimeError

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
