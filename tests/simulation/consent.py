"""What a guard may do in a mode that leaves things to people: only what a person asked for, until a core serves.

As every checker it goes by what happened and never asks the guard's own books.
"""

from hardcore.model import observations as seen
from hardcore.recovery.reading import Transition
from hardcore.recovery.transitions import Trigger
from tests.simulation.laws import hold

ACT = "act"
#: What a policy has done when nobody came says so.
NOBODY_CAME = "nobody has come"
#: What ends a core that serves, or makes it room for another.
_ENDS = frozenset({Trigger.LOST, Trigger.RENEW})


class Consent:
    """Remembers whether a person has asked for anything since a core served last; a guard that begins was asked to."""

    def __init__(self) -> None:
        self._given = True
        self._asked_ns = 0

    def heard(self, fact: seen.OperatorAsked) -> None:
        """A person has asked for something."""
        self._given, self._asked_ns = True, fact.at_ns

    def moved(self, mode: str, move: Transition) -> None:
        """The guard changes its phase."""
        waited = NOBODY_CAME in move.reason
        if move.trigger in _ENDS:
            hold(mode == ACT or waited or self._asked_ns == move.at_ns, f"mode {mode}, and {move}")
        self._given = self._given or waited

    def starts(self, mode: str) -> None:
        """A core is started."""
        hold(mode == ACT or self._given, f"mode {mode}, and a core is started")

    def serves(self) -> None:
        """A core serves: what was asked for is done."""
        self._given = False
