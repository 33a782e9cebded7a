"""What is counted over the lives of the guard: restarts, incidents, how long things took, time spent in each state.

A count grows by facts alone: an incident by its end, a restart by the first answer of a process that had not served
before. A restart that was ordered is none yet; a guard that counted its own orders would call a core restarted that never
came back. Times go into fixed buckets, because sums of buckets can be compared between machines and percentiles can't.
What is counted is kept in `state/counters.json`; a file that can't be read begins anew at zero, which monitors know.
"""

from collections import Counter
from collections.abc import Mapping
from itertools import pairwise
from typing import Any, Final

import msgspec

from hardcore.model.actions import Incident
from hardcore.model.phases import HAState, Phase
from hardcore.model.verdicts import Diagnosis

VERSION: Final = 1
#: Upper bounds of the buckets; beyond the last is one more.
BOUNDS_MS: Final = (10, 25, 50, 100, 250, 500, 1_000, 2_500, 5_000, 10_000, 30_000, 60_000, 300_000)
#: The line of an outage; a stage is named by the step that ends it. The rest happens beside it.
LINE: Final = ("fault", "detected", "killed", "spawned", "promoted", "fenced", "ready", "serving")
#: Outcomes that are counted by name: what a file says may not make numbers without end.
OUTCOMES: Final = frozenset({"recovered", "manual", "safe_mode", "assist", "open"})
COUNT_MAX: Final = 2**53
_NS_PER_MS: Final = 1_000_000

#: A process, as nobody else is it: number and start time.
Who = tuple[int, int]


class Histogram(msgspec.Struct):
    """How long something took, in milliseconds: one count for each bucket of BOUNDS_MS and one beyond."""

    counts: list[int] = msgspec.field(default_factory=lambda: [0] * (len(BOUNDS_MS) + 1))
    sum_ms: int = 0

    def add(self, took_ms: int) -> None:
        """One more."""
        self.counts[sum(bound < took_ms for bound in BOUNDS_MS)] += 1
        self.sum_ms += took_ms

    def told(self) -> dict[str, object]:
        """Return it as the wire has it."""
        return {
            "bounds": list(BOUNDS_MS),
            "counts": list(self.counts),
            "sum": self.sum_ms,
            "count": sum(self.counts),
        }


class Counts(msgspec.Struct):
    """Everything that is counted. Times that are given are monotonic nanoseconds of this guard."""

    restarts: Counter[str] = msgspec.field(default_factory=Counter)
    incidents: dict[str, Counter[str]] = msgspec.field(default_factory=dict)
    detection: Histogram = msgspec.field(default_factory=Histogram)
    recovery: Histogram = msgspec.field(default_factory=Histogram)
    stages: dict[str, Histogram] = msgspec.field(default_factory=dict)
    state_ms: Counter[str] = msgspec.field(default_factory=Counter)
    late_ticks: int = 0
    false_suspicions: int = 0
    snapshot_bytes: int | None = None
    _served: Who | None = None  # who gave the last first answer
    _told_late: int = 0  # late ticks of this guard that are counted already
    _state: tuple[HAState, int] | None = None  # the present state, and up to when its time is counted
    _closed: tuple[int, Diagnosis] | None = None  # the epoch that the last incident ended with

    def close(self, incident: Incident) -> None:
        """An incident is over."""
        outcome = incident.outcome if incident.outcome in OUTCOMES else "other"
        self.incidents.setdefault(str(incident.diagnosis), Counter())[outcome] += 1
        if incident.next_epoch is not None:
            self._closed = (incident.next_epoch, incident.diagnosis)
        steps = dict(incident.timeline)
        if incident.planned or "fault" not in steps:
            return
        if "detected" in steps:
            self.detection.add(_ms(steps["fault"], steps["detected"]))
        if "serving" in steps:
            self.recovery.add(_ms(steps["fault"], steps["serving"]))
            self._add_stages(steps)

    def _add_stages(self, steps: Mapping[str, int]) -> None:
        line = [(name, steps[name]) for name in LINE if name in steps]
        for (_, before_ns), (name, at_ns) in pairwise(line):
            self.stages.setdefault(name, Histogram()).add(_ms(before_ns, at_ns))

    def serve(self, who: Who, epoch: int, incident: Diagnosis | None) -> bool:
        """The first answer of `epoch` came from `who`, while this incident was open; True: a restart that worked.

        An answer that comes when the incident is closed already belongs to it all the same, if the epoch is its own.
        """
        new, self._served = who != self._served, who
        if incident is None and self._closed is not None and self._closed[0] == epoch:
            incident = self._closed[1]
        if not new or incident is None:
            return False
        self.restarts[str(incident)] += 1
        return True

    def adopt(self, who: Who) -> None:
        """This one served before we began to count."""
        self._served = self._served or who

    def change(self, before: Phase, after: Phase) -> None:
        """The phase changed: a suspicion that goes back to running was none."""
        self.false_suspicions += before is Phase.SUSPECT and after is Phase.RUNNING

    def pass_time(self, state: HAState, late_ticks: int, now_ns: int) -> None:
        """It is `now_ns`; `late_ticks`: of this guard so far."""
        if self._state is not None:
            was, since_ns = self._state
            passed_ms = _ms(since_ns, now_ns)
            self.state_ms[str(was)] += passed_ms
            now_ns = since_ns + passed_ms * _NS_PER_MS  # what is left of a millisecond counts the next time
        self._state = (state, now_ns)
        self.late_ticks += max(0, late_ticks - self._told_late)
        self._told_late = late_ticks

    def told(self) -> dict[str, object]:
        """Return it as the wire and the file have it."""
        return {
            "version": VERSION,
            "restarts": dict(self.restarts),
            "incidents": {name: dict(outcomes) for name, outcomes in self.incidents.items()},
            "detection_ms": self.detection.told(),
            "recovery_ms": self.recovery.told(),
            "stage_ms": {name: one.told() for name, one in self.stages.items()},
            "late_ticks": self.late_ticks,
            "false_suspicions": self.false_suspicions,
            "state_ms": dict(self.state_ms),
            "snapshot_bytes": self.snapshot_bytes,
        }


def read_counts(said: Mapping[str, Any]) -> Counts:
    """Return the counts that a file says, without what makes no sense there."""
    if said.get("version") != VERSION:
        return Counts()
    names = frozenset(map(str, Diagnosis))
    incidents = {
        name: Counter(_counts(outcomes, OUTCOMES | {"other"}))
        for name, outcomes in _object(said.get("incidents")).items()
        if name in names
    }
    stages = {n: _histogram(one) for n, one in _object(said.get("stage_ms")).items() if n in LINE}
    return Counts(
        restarts=Counter(_counts(said.get("restarts"), names)),
        incidents=incidents,
        detection=_histogram(said.get("detection_ms")),
        recovery=_histogram(said.get("recovery_ms")),
        stages=stages,
        state_ms=Counter(_counts(said.get("state_ms"), frozenset(map(str, HAState)))),
        late_ticks=_count(said.get("late_ticks")) or 0,
        false_suspicions=_count(said.get("false_suspicions")) or 0,
        snapshot_bytes=_count(said.get("snapshot_bytes")),
    )


def _ms(from_ns: int, to_ns: int) -> int:
    return max(0, to_ns - from_ns) // _NS_PER_MS


def _object(value: object) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}


def _count(value: object) -> int | None:
    sound = isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= COUNT_MAX
    return int(str(value)) if sound else None


def _counts(value: object, names: frozenset[str]) -> dict[str, int]:
    found = {name: _count(each) for name, each in _object(value).items() if name in names}
    return {name: each for name, each in found.items() if each is not None}


def _histogram(value: object) -> Histogram:
    """Return a histogram; one of other bounds, or of none, begins anew: its buckets would say something else."""
    said = _object(value)
    counts, total = said.get("counts"), _count(said.get("sum"))
    if said.get("bounds") != list(BOUNDS_MS) or not isinstance(counts, list) or total is None:
        return Histogram()
    found = [_count(one) for one in counts]
    if len(found) != len(BOUNDS_MS) + 1 or None in found:
        return Histogram()
    return Histogram([one or 0 for one in found], total)
