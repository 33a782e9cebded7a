"""The drill that was ordered and has not shown its effect yet: the next death is its own, if it comes soon."""

from dataclasses import dataclass

from hardcore.model.observations import DrillStarted
from hardcore.recovery.budget import NS_PER_S

#: A drill that has shown no effect after this was no drill: a later death is a real one.
DRILL_GRACE_NS = 15 * NS_PER_S


@dataclass(slots=True)
class PendingDrill:
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

    def take(self, now_ns: int) -> str | None:
        """Return the fault that a death at this moment is due to, once; None: it is a real one."""
        started, self._started = self._started, None
        return started.fault if started and now_ns - started.at_ns <= DRILL_GRACE_NS else None
