"""The laws of the court: no innocent is convicted, no suspect is run before its trial, and everybody is told.

They know what the guard can't: which command is a poison.
"""

from collections import Counter
from typing import TYPE_CHECKING

from hardcore.model import trials
from hardcore.model.actions import Action
from hardcore.model.observations import Observation
from hardcore.model.trials import REPRODUCED as DONE_AGAIN
from hardcore.recovery.court import HELD_DEATHS, Court
from tests.simulation.harms import REPRODUCED
from tests.simulation.laws import hold

if TYPE_CHECKING:  # the world owns its checkers
    from tests.simulation.workload import Request
    from tests.simulation.world import World


class Judges:
    """Look at every order of the court."""

    def __init__(self, world: "World") -> None:
        self.world = world
        self.convicted: Counter[str] = Counter()
        self.letters: set[str] = set()
        self.sits = False

    def began(self) -> None:
        """Another guard: the court of the one before ended with it."""
        self.sits = False

    def heard(self, fact: Observation) -> None:
        """A court that is over has ended."""
        if isinstance(fact, trials.TrialsOver):
            self.sits = False

    def ordered(self, order: Action) -> None:
        """Each order is right at the moment it is given."""
        match order:
            case trials.Try() | trials.TryLog():
                hold(not self.sits or self.world.switches.court_hung, "one court at a time")
                self.sits = True
            case trials.SetAside(letter=letter):
                self._set_aside(letter)
            case trials.KeepCourt(memory=memory):
                hold(
                    all(one.letter for one in memory.suspects if one.ordeal in DONE_AGAIN),
                    "whoever did it again has a letter",
                )
            case _:
                pass

    def _set_aside(self, letter: trials.Letter) -> None:
        self.letters.add(letter.id)
        if letter.seq is not None:
            hold(letter.seq in self.world.store.lethal, f"event {letter.seq} is parked, and harms nobody")
            return
        guilty = any(x.harm in REPRODUCED for x in self.world.gateway.requests if x.key_hash == letter.name)
        if letter.held:
            hold(
                letter.deaths >= HELD_DEATHS,
                f"{letter.name} is left to a person after {letter.deaths} deaths",
            )
            return
        hold(guilty, f"{letter.name} is convicted, and is innocent")
        self.convicted[letter.name] += 1

    def rule_is_written_for(self, letter: str) -> bool:
        """Whether what is remembered as set aside is refused, unless a person took the rule away."""
        aside = self.world.aside
        return aside.rule(letter) is not None or letter in aside.released

    def forwarded(self, request: "Request") -> None:
        """The gateway sends a request to a core."""
        hold(request.key_hash not in self.world.set_aside, f"{request.key_hash} is set aside, and is run")

    def last_incident(self, ids: list[str]) -> str:
        """Return the incident that was opened last; a letter's number is none."""
        return next((name for name in reversed(ids) if name not in self.letters), "")

    def at_end(self) -> None:
        """In the quiet nobody is on trial any more."""
        court = self.world.guard.manager.state()["court"]
        assert isinstance(court, Court), "a manager remembers its court"
        if self.world.guard.works:
            for one in court.register:
                hold(not one.letter or self.rule_is_written_for(one.letter), f"{one.letter} keeps nobody out")
        if self.world.guard.works and court.served_ns is not None:
            hold(court.docket is None, "a court sits for ever")
            hold(not [x for x in court.register if x.open and x.filed], "a suspect is never tried")
