"""What a guard may do in a mode that leaves things to people: only what a person asked for, until a core serves.

And in any mode: what the policy has shut down stays down until a person says otherwise. Where nobody came and the policy
has reads served then, they are served for what the core had ended of, whatever that was.

As every checker it goes by what happened and never asks the guard's own books.
"""

from hardcore.model import actions as orders
from hardcore.model import observations as seen
from hardcore.model.verdicts import Diagnosis
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
    """Remembers whether a person has asked for anything since a core served last; a guard that begins was asked to.

    `shut`: the policy has shut the service down.
    """

    def __init__(self) -> None:
        self._given = True
        self._asked_ns = 0
        self._wished = False
        self.shut = False
        self._ended_of: Diagnosis | None = None
        self._reads_for: set[Diagnosis | None] = set()

    def heard(self, fact: seen.OperatorAsked) -> None:
        """A person has asked for something."""
        self._given, self._asked_ns = True, fact.at_ns
        if fact.verb in _TAKES_BACK:
            self._wished, self.shut = True, False

    def moved(self, mode: str, move: Transition) -> None:
        """The guard changes its phase."""
        waited = NOBODY_CAME in move.reason
        self.shut = self.shut or move.trigger is Trigger.SHUTDOWN
        if move.trigger in _CHANGES:
            hold(mode == ACT or self._wished, f"mode {mode}, nobody asked, and {move}")
        if move.trigger in _ENDS:
            hold(mode == ACT or waited or self._asked_ns == move.at_ns, f"mode {mode}, and {move}")
        self._given = self._given or waited
        if waited and move.trigger is Trigger.READS_ONLY:
            self._reads_for.add(self._ended_of)

    def ordered(self, order: orders.Action) -> None:
        """The guard writes down whether the service is shut down, or tells what a core has ended of."""
        match order:
            case orders.KeepBudget():
                self.shut = self.shut or order.shut is not None
            case orders.CloseIncident(incident=told):
                self._ended_of = told.deaths[-1].diagnosis if told.deaths else told.diagnosis
            case _:
                pass

    def reads(self, reason: Diagnosis | None) -> bool:
        """Return whether reads are served for this because nobody has come."""
        return reason in self._reads_for

    def starts(self, mode: str) -> None:
        """A core is started."""
        hold(not self.shut, "the policy shut the service down, and a core is started")
        hold(mode == ACT or self._given, f"mode {mode}, and a core is started")

    def serves(self, *, again: bool) -> None:
        """A core serves: what was asked for is done. `again`: the same core; a wish for another one goes on."""
        self._given = False
        self._wished = self._wished and again
