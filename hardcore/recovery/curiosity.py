"""What the judge would like to know, asked of the hands once at a time.

A look at the stacks is free for the core and not for the machine; one that hangs must not call for a second. So a
question is out until it is answered or its time is over; what became of it then nobody waits for.
"""

import msgspec

from hardcore.model.verdicts import Wish
from hardcore.recovery.budget import NS_PER_S

#: A question that was not answered within this may be asked again.
ANSWER_NS = 2 * NS_PER_S


class Curiosity(msgspec.Struct):
    """The questions that are out, by the moment each was asked. Times are monotonic."""

    _asked_ns: dict[Wish, int] = msgspec.field(default_factory=dict)

    def ask(self, wishes: frozenset[Wish], now_ns: int) -> tuple[Wish, ...]:
        """Return which of these are to be asked now."""
        due = tuple(wish for wish in sorted(wishes) if self._is_free(wish, now_ns))
        self._asked_ns.update(dict.fromkeys(due, now_ns))
        return due

    def answered(self, wish: Wish) -> None:
        """An answer has come."""
        self._asked_ns.pop(wish, None)

    def _is_free(self, wish: Wish, now_ns: int) -> bool:
        asked_ns = self._asked_ns.get(wish)
        return asked_ns is None or now_ns - asked_ns >= ANSWER_NS
