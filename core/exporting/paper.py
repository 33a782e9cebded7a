"""What a printer is given of a book, and the words that all printers share.

Pure. A text of a household may hold anything but control characters, and lines; in a plain-text ledger it has one line, and
what would end it there is escaped or replaced by the printer whose rule it is.
"""

import datetime as dt
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

import msgspec

from core.exporting.names import Names
from core.ledger.accounts import Account
from core.ledger.views import TransactionView

NO_DAY: Final = "1970-01-01"  # of a book in which nothing was booked
_LAST_DAY: Final = "9999-12-31"


class Paper(msgspec.Struct, frozen=True):
    """The book at one moment: its last event, its accounts by id, what they are called, and its first and last day."""

    seq: int
    accounts: Mapping[str, Account]
    names: Names
    first_day: str
    last_day: str
    pendings: Sequence[TransactionView] = ()

    @property
    def day_after(self) -> str | None:
        """The day on which all balances can be told; None where the calendar ends before."""
        if self.last_day == _LAST_DAY:
            return None
        return (dt.date.fromisoformat(self.last_day) + dt.timedelta(days=1)).isoformat()


def waiting(paper: Paper) -> Iterator[str]:
    """Give what is pending as comments, which both programs pass over: it is not booked, so it may not count."""
    if paper.pendings:
        yield "; Pending, and so in none of the balances:\n"
    for one in paper.pendings:
        until = f" until {one.expires_at[:10]}" if one.expires_at else ""
        yield f"; {one.date}{until} {one_line(one.description)}  id:{one.id}\n"
        for line in one.postings:
            yield f";     {paper.names.accounts[line.account]}  {line.amount} {paper.names.currencies[line.currency]}\n"


def one_line(text: str) -> str:
    """Return a text without line breaks and with single spaces."""
    return " ".join(text.split())
