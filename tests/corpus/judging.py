"""Gives a trace to the prediction as the watch would, and says what was told of it, and when.

The numbers are those that the guard ships with; a test of the rules and the published rates go through here alike.
"""

from dataclasses import dataclass

from hardcore.recovery.policy import Policy
from hardcore.sentinel.trends import Track, tell
from tests.corpus.traces import STEP_S, Trace

S = 1_000_000_000
POLICY = Policy()


@dataclass(frozen=True, slots=True)
class Judged:
    """What came of one trace. `told_s`: when each forecast was told, after its beginning; `lead_s`: how long before
    the limit the one was told that stood then; None: it was not.
    """

    trace: Trace
    told_s: tuple[int, ...]
    lead_s: int | None


def judge(trace: Trace) -> Judged:
    """Return what the prediction says of this trace."""
    horizon_ns, confirm_ns = POLICY.forecast_horizon_sec * S, POLICY.forecast_confirm_sec * S
    track = Track(POLICY.forecast_interval_sec * S, POLICY.forecast_warmup_sec * S)
    told_s: list[int] = []
    done = 0
    for step, (value, load) in enumerate(zip(trace.values, trace.loads, strict=True)):
        at_s = step * STEP_S
        done += load
        if track.look(at_s * S, value, done, trace.limit, horizon_ns) and tell(track, at_s * S, confirm_ns):
            told_s.append(at_s)
    end_s = len(trace.values) * STEP_S
    stood = told_s and track.told
    return Judged(trace, tuple(told_s), end_s - told_s[-1] if stood else None)
