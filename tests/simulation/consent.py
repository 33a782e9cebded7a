"""What a guard may do in a mode that leaves things to people: only what a person asked for, until a core serves.

And in any mode: what the policy has shut down stays down until a person says otherwise.

As every checker it goes by what happened and never asks the guard's own books.
"""

from hardcore.model import actions as orders
from hardcore.model import observations as seen
from hardcore.recovery.reading import Transition
from hardcore.recovery.transitions import Trigger
from tests.simulation.laws import hold

ACT = "act"
#: What a policy has done when nobody came says so.
NOBODY_CAME = "nobody has come"
#: What ends a core that serves, or makes it room for another.
_ENDS = frozenset({Trigger.LOST, Trigger.RENEW})
#: The same, where a person's word may have waited for its moment.
_CHANGES = frozenset({Trigger.SWITCH, Trigger.RESTART})
#: What takes back that the policy has shut the service down.
_TAKES_BACK = frozenset({seen.Verb.RESUME, seen.Verb.RESTART, seen.Verb.RESTART_HARD, seen.Verb.STOP})


class Consent:
    """Remembers whether a person has asked for anything since a core served last; a guard that begins was asked to."""

    def __init__(self) -> None:
        self._given = True
        self._asked_ns = 0
        self._wished = False
        self._shut = False

    def heard(self, fact: seen.OperatorAsked) -> None:
        """A person has asked for something."""
        self._given, self._asked_ns = True, fact.at_ns
        if fact.verb in _TAKES_BACK:
            self._wished, self._shut = True, False

    def moved(self, mode: str, move: Transition) -> None:
        """The guard changes its phase."""
        waited = NOBODY_CAME in move.reason
        self._shut = self._shut or move.trigger is Trigger.SHUTDOWN
        if move.trigger in _CHANGES:
            hold(mode == ACT or self._wished, f"mode {mode}, nobody asked, and {move}")
        if move.trigger in _ENDS:
            hold(mode == ACT or waited or self._asked_ns == move.at_ns, f"mode {mode}, and {move}")
        self._given = self._given or waited

    def kept(self, order: orders.KeepBudget) -> None:
        """The guard writes down whether the service is shut down."""
        self._shut = self._shut or order.shut is not None

    def starts(self, mode: str) -> None:
        """A core is started."""
        hold(not self._shut, "the policy shut the service down, and a core is started")
        hold(mode == ACT or self._given, f"mode {mode}, and a core is started")

    def serves(self, *, again: bool) -> None:
        """A core serves: what was asked for is done. `again`: the same core; a wish for another one goes on."""
        self._given = False
        self._wished = self._wished and again
