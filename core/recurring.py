"""What comes back, as errands: each day of a recurring item that nothing is kept of is booked as an ordinary command.

A day is asked for by its key, so one that was missed while everything was off is made up for at the next round, and one
that was booked or refused is never asked for again, by whichever core. The day is that of the server's calendar, as it
is everywhere where people say "today".
"""

import datetime as dt
import os
from collections.abc import Sequence
from typing import Final

import msgspec
from sqlalchemy import Connection

from core.journal import planned
from core.ledger.ids import ENTROPY_BYTES, uuid7
from core.ledger.planning import key_of, occurrence
from core.ledger.plans import KnownRecurring
from core.ledger.reasons import Rejection
from core.rulings import Rulings
from core.scheduler import Errand, Source

KIND: Final = "recurring.book"
_ENTRIES: Final = "/api/ledger/entries"
_TRANSACTIONS: Final = "/api/ledger/transactions"


def recurring_source(rulings: Rulings) -> Source:
    """Return the question which days of recurring items are due; what is left out of every rebuild is not read."""

    def due(connection: Connection, now: dt.datetime, most: int) -> Sequence[Errand]:
        today = now.astimezone().date()
        found: list[Errand] = []
        for known in planned.going_on(connection, rulings.quarantine.rules.parked):
            for day in planned.unbooked(connection, known, today, most - len(found)):
                errand = _errand(known, day, now)
                if errand is not None:
                    found.append(errand)
            if len(found) >= most:
                break
        return found

    return due


def _errand(known: KnownRecurring, day: str, now: dt.datetime) -> Errand | None:
    plan = known.event.plan
    command_id = uuid7(int(now.timestamp() * 1000), os.urandom(ENTROPY_BYTES))
    command = occurrence(plan, day, command_id)
    if isinstance(command, Rejection):
        return None  # it was a command on its first day: what makes it none now is a newer rule of ours
    said = plan.entry if plan.entry is not None else plan.transaction
    body = msgspec.json.encode({"date": day, **msgspec.to_builtins(said)})
    path = _ENTRIES if plan.entry is not None else _TRANSACTIONS
    return Errand(key_of(known.event.id, day), KIND, command, path, body)
