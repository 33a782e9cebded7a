"""The drill that was ordered and has not shown its effect yet: the next death is its own, if it comes soon.

A drill that shows slowly (a leak, a part that stands still) would excuse whatever happens meanwhile, so it is held to
its name: only what it can lead to is its own, anything else is real.
"""

from collections.abc import Mapping

import msgspec

from hardcore.model.observations import DrillStarted
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.budget import NS_PER_S

#: A drill that has shown no effect after this was no drill: a later death is a real one.
DRILL_GRACE_NS = 15 * NS_PER_S
#: A leak may last so long, and shows a while later.
LEAK_S_MAX = 600
_SLOW_GRACE_NS = (LEAK_S_MAX + 60) * NS_PER_S
#: What comes of the slow ones, and of nothing else.
_LEADS_TO: Mapping[str, frozenset[Diagnosis]] = {
    "leak": frozenset({Diagnosis.LEAK, Diagnosis.MEMORY_PRESSURE, Diagnosis.OUT_OF_MEMORY}),
    "stall": frozenset({Diagnosis.COMPONENT_STALLED}),
}


def grace_ns(fault: str) -> int:
    """Return how long a drill is waited for."""
    return _SLOW_GRACE_NS if fault in _LEADS_TO else DRILL_GRACE_NS


class PendingDrill(msgspec.Struct):
    """Remembers what the core was told to do to itself, and when."""

    _started: DrillStarted | None = None

    def start(self, fact: DrillStarted) -> None:
        """A drill was ordered; an empty fault takes that back."""
        self._started = fact if fact.fault else None

    @property
    def since_ns(self) -> int | None:
        """When the drill was ordered that has shown no effect yet; None if there is none."""
        return self._started.at_ns if self._started else None

    def cancel(self) -> None:
        """It was told to nobody."""
        self._started = None

    def explains(self, diagnosis: Diagnosis, now_ns: int) -> bool:
        """Whether a diagnosis of this moment is due to the drill."""
        started = self._started
        if started is None or now_ns - started.at_ns > grace_ns(started.fault):
            return False
        return started.fault not in _LEADS_TO or diagnosis in _LEADS_TO[started.fault]

    def take(self, diagnosis: Diagnosis, now_ns: int) -> str | None:
        """Return the fault that a trouble of this moment is due to, once; None: it is a real one."""
        started = self._started
        if started is None:
            return None
        explained = self.explains(diagnosis, now_ns)
        if explained or started.fault not in _LEADS_TO:
            self._started = None
        return started.fault if explained else None
