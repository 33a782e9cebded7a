"""The book as a command sees it: the accounts, entries and fingerprints that it may touch, and nothing else.

Whoever asks for a decision brings a book that holds everything the command could need; what is not in it does
not exist. Accounts are also found by name here, because a household names its categories and ways of paying
instead of numbering them. An account that is made on first use gets an id that follows from its type, name and
currency: the same ledger written again has the same ids, and a name without a single Latin letter has one too.
A counter was not chosen: it would depend on which category came first.
"""

import re
from collections.abc import Iterable, Mapping
from enum import StrEnum
from functools import lru_cache
from hashlib import sha256
from typing import Final

import msgspec

from core.ledger.accounts import Account, AccountType
from core.ledger.events import Booking, EntryPosted, TransactionPending
from core.ledger.fields import folded
from core.ledger.plans import KnownRecurring

UNCATEGORISED_NAME: Final = "미분류 · Uncategorised"

NAMES_KNOWN_MAX: Final = (
    512  # of accounts whose ids are remembered: a file of a bank says the same few again and again
)
_SLUG_CHARACTERS_MAX: Final = 40
_NOT_IN_A_SLUG: Final = re.compile(r"[^a-z0-9]+")
_NOT_IN_A_CODE: Final = re.compile(r"[^a-z0-9_-]")
# An underscore stands first, where no slug of a name has one.
_UNCATEGORISED_SLUG: Final = "_uncategorised"
_UNCATEGORISED: Final = re.compile(rf"(?:income|expense):{_UNCATEGORISED_SLUG}(?:-[0-9a-f]+)?:.+")


class KnownEntry(msgspec.Struct, frozen=True):
    """An entry as it stands: the number and the content of its newest event, and whether it was reversed."""

    seq: int
    event: EntryPosted
    reversed: bool = False


class KnownBooking(msgspec.Struct, frozen=True):
    """A booked transaction: the number and the content of its event, and whether it was reversed."""

    seq: int
    event: Booking
    reversed: bool = False


class PendingState(StrEnum):
    """Where a pending transaction is in its life; out of each but the first no way leads."""

    OPEN = "open"
    POSTED = "posted"
    VOIDED = "voided"
    EXPIRED = "expired"


class KnownPending(msgspec.Struct, frozen=True):
    """A transaction that was made pending: the number and the content of its event, and what became of it.

    `closed_seq`: the event that has ended it.
    """

    seq: int
    event: TransactionPending
    state: PendingState = PendingState.OPEN
    closed_seq: int | None = None


class Book(msgspec.Struct):
    """What exists of that which a command (or a batch of them) may touch, and the wall time at which it is asked.

    `fingerprints` are the rows of bank files that are known already. `dated`: what is posted to an account for a day and
    all days before it, of those that somebody asserts.
    """

    accounts: dict[str, Account] = {}
    entries: dict[str, KnownEntry] = {}
    fingerprints: set[str] = set()
    bookings: dict[str, KnownBooking] = {}
    pendings: dict[str, KnownPending] = {}
    dated: dict[tuple[str, str], int] = {}
    recurrings: dict[str, KnownRecurring] = {}
    now_ns: int = 0
    _named: dict[str, set[str]] = {}

    @classmethod
    def of(cls, accounts: Iterable[Account]) -> "Book":
        """Return a book with these accounts."""
        made = cls()
        for account in accounts:
            made.put(account)
        return made

    def put(self, account: Account) -> None:
        """Take an account in, or take it as it stands now."""
        if account.id not in self.accounts:
            self._named.setdefault(folded(account.name), set()).add(account.id)
        self.accounts[account.id] = account

    def update(self, changed: Mapping[str, Account]) -> None:
        """Take in accounts as they stand now."""
        for account in changed.values():
            self.put(account)

    def named(self, name: str, types: tuple[AccountType, ...], currency: str | None) -> list[Account]:
        """Return the accounts of this name, in any currency if `currency` is None.

        The first one is meant: open ones stand before closed ones, then by the order of `types`, then by id.
        """
        ids = self._named.get(folded(name), ())
        found = [self.accounts[one] for one in ids if self.accounts[one].type in types]
        fitting = [account for account in found if currency in {None, account.currency}]
        return sorted(fitting, key=lambda account: (account.closed, types.index(account.type), account.id))


@lru_cache(maxsize=NAMES_KNOWN_MAX)
def ids_for(name: str | None, kind: AccountType, currency: str) -> tuple[str, ...]:
    """Return the ids that an account made on first use may get, the best first.

    `name` None: the account of what has no category. A short hash stands in the id where letters would not
    tell two names apart; the longest form is only for somebody who has taken the others on purpose.
    """
    spelled = folded(name) if name is not None else _UNCATEGORISED_SLUG
    digest = sha256(f"{kind.value}\0{currency}\0{spelled}".encode()).hexdigest()
    code = _NOT_IN_A_CODE.sub("-", currency.lower())
    slug = spelled if name is None else _NOT_IN_A_SLUG.sub("-", spelled)[:_SLUG_CHARACTERS_MAX].strip("-")
    hashed = tuple(
        f"{kind.value}:{slug}-{mark}:{code}" if slug else f"{kind.value}:{mark}:{code}"
        for mark in (digest[:12], digest[:32])
    )
    return (f"{kind.value}:{slug}:{code}", *hashed) if slug == spelled.replace(" ", "-") else hashed


def is_uncategorised(account_id: str) -> bool:
    """Whether an account is the one for what has no category."""
    return _UNCATEGORISED.fullmatch(account_id) is not None
