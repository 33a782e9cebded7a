"""What falls due in a book: the sources that the scheduler asks, each a question that names errands.

Here, beside the scheduler and not in it, because what falls due is the ledger's business, and when it is asked is not.
"""

import datetime as dt
from collections.abc import Sequence
from typing import Final

from sqlalchemy import Connection

from core.journal.queries import due_pendings
from core.ledger.commands import ExpirePending
from core.scheduler import Errand, Source

_EPOCH: Final = dt.datetime(1970, 1, 1, tzinfo=dt.UTC)
_MICROSECOND: Final = dt.timedelta(microseconds=1)


def expiries(connection: Connection, now: dt.datetime, at_most: int) -> Sequence[Errand]:
    """Name the pending transactions that have run out: what they hold is to be freed."""
    now_ns = (now - _EPOCH) // _MICROSECOND * 1_000
    return [
        Errand(
            f"pending-expiry:{name}",
            "pending-expiry",
            ExpirePending(name),
            f"/api/ledger/transactions/{name}/expire",
        )
        for name in due_pendings(connection, now_ns, at_most)
    ]


SOURCES: Final[tuple[Source, ...]] = (expiries,)
