"""The ledger read from outside: everything it shows, page by page through its API.

Balances, transactions and events are three readings of the same book; whoever wants to catch it lying needs all
three, because something missing in one of them may stand in another.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from decimal import Decimal
from typing import Any

from examples.line import Answer, Line

PAGE = 500
PAGES_MAX = 10_000


class UnreadableError(Exception):
    """The ledger did not show its books; the sentence says what it said instead."""


@dataclass(frozen=True, slots=True)
class Books:
    """Everything the ledger shows: balances by account, transactions by id, and the events in their order."""

    balances: dict[str, Decimal]
    transactions: tuple[dict[str, Any], ...]
    events: tuple[dict[str, Any], ...]

    @property
    def transaction_of(self) -> dict[str, str]:
        """The id of the transaction that each key has booked."""
        return {event["key"]: event["body"]["id"] for event in self.events}


def read_ledger(line: Line) -> Books:
    """Read everything. Raises UnreadableError."""
    return Books(
        {each["id"]: Decimal(each["balances"]["posted"]) for each in _all(line, "accounts", "cursor")},
        tuple(_all(line, "transactions", "cursor")),
        tuple(_all(line, "events", "after")),
    )


def _all(line: Line, what: str, parameter: str) -> Iterator[dict[str, Any]]:
    cursor = ""
    for _page in range(PAGES_MAX):
        answer = line.get(f"/api/ledger/{what}?limit={PAGE}{cursor}")
        if not isinstance(answer, Answer) or not answer.good:
            raise UnreadableError(f"The {what} can't be read: {answer}")
        yield from answer.body["items"]
        if answer.body["next_cursor"] is None:
            return
        cursor = f"&{parameter}={answer.body['next_cursor']}"
    raise UnreadableError(f"The {what} have no end.")
