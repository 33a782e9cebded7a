"""Rebuilding: the one gate through which each event goes that anything is made of again, or proven to be whole.

Two things may be said of an event from outside: that it is parked (it kills whoever rebuilds from it, so it is left out)
and that a drill has poisoned it. Both are asked here and nowhere else, by the proof before serving, by a spare that walks
ahead, by the replay of the whole book and by a trial of the log; so a trial dies of an event exactly if a core would, and a
core that was told to leave it out can't meet it in another corner. Reading pages is not rebuilding: they show what the
commit wrote. Not chosen: to mark the event's row; nothing in the ledger is ever changed.
"""

from collections.abc import Iterable, Iterator

from core.guarded.poison import Armoury
from core.guarded.quarantine import Quarantine
from core.journal.chain import EventRow


class Rebuilding:
    """What is left out of the log, as its rules stand at this moment. Any thread."""

    def __init__(self, quarantine: Quarantine | None = None, armoury: Armoury | None = None) -> None:
        """Without anything given every event is taken."""
        self._quarantine = quarantine or Quarantine()
        self._armoury = armoury or Armoury()

    def takes(self, seq: int) -> bool:
        """Whether the event of this number is rebuilt; call it right before that is done. A drill strikes here."""
        if seq in self._quarantine.rules.parked:
            return False
        self._armoury.rebuild(seq)
        return True

    def over(self, rows: Iterable[EventRow]) -> Iterator[EventRow]:
        """Pass on every event, for a proof of the chain alone: a hash counts, whatever is left out."""
        for row in rows:
            self.takes(row.seq)
            yield row

    def accounts_of(self, seq: int) -> tuple[str, ...]:
        """Return the accounts that a parked event is known to book on."""
        parked = self._quarantine.rules.parked.get(seq)
        return () if parked is None else parked.account_ids
