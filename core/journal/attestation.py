"""Attestations: what the writer says of the whole book after every ten thousandth event, kept for ever.

The chain binds the events to each other, and nothing binds the balances to the chain but a replay of all of it.
An attestation does: in the transaction of its event the writer stores that event's number and hash, and a digest of
all balances as they stand after exactly this event. From then on "the balances now, less what was posted since"
must give that digest again, so a proof before serving needs the events since the last attestation and no more, and
covers every balance; and the replay of the whole book, which comes to each of those places, compares them there with
balances of its own. `sums` say the same for a person: per currency what stands on the debit and on the credit side.
Before the writer attests, it makes that very sum itself, back to the attestation before: balances that somebody else
has moved would be certified for ever, and every later proof would go by them. Where it does not come out nothing is
attested and nothing is written.
It proves that the book is what its writer believed at that moment, not that the writer was right; that is what the
whole replay is for. Not chosen: to hash the ten thousand events again at that moment as well, which would hold the
store's lock ten times as long; the replay behind each start does so; and: a running total of each account beside it, which every batch would have to write, and a
digest of the accounts' names and rules too, which have events of their own.

Accounts that stand at zero are left out: one that was opened since then stood at nothing, which is the same.

What is pending stands beside the account as two balances of its own, the debit side and (negative) the credit side, so
every sum that holds for balances holds for both, and a book in which nothing is pending is attested as it always was.
"""

import json
from collections.abc import Iterable, Iterator, Mapping
from hashlib import sha256
from struct import Struct
from typing import Final

import msgspec

from core.journal.chain import GENESIS

#: So many events lie between two attestations, whoever books them.
EVENTS_BETWEEN: Final = 10_000
_LENGTH: Final = Struct("<I")

Balance = tuple[str, str, int]  # id, currency, minor units (debit positive)
Standing = Mapping[str, tuple[str, int]]  # by id: currency and minor units, never zero


_DEBIT: Final = "!pending-debit"  # no account's name has an exclamation mark
_CREDIT: Final = "!pending-credit"


class Attestation(msgspec.Struct, frozen=True):
    """What stood after event `seq`, whose hash is `hash`. `balances` is a digest; `sums` is for people."""

    seq: int
    hash: bytes
    balances: bytes
    sums: str


def is_due(seq: int) -> bool:
    """Whether the event of this number is one after which the book is attested."""
    return seq > 0 and seq % EVENTS_BETWEEN == 0


def due_between(head_seq: int, new_head_seq: int) -> range:
    """Return the numbers to be attested when the head moves on; as a rule there is none."""
    first = (head_seq // EVENTS_BETWEEN + 1) * EVENTS_BETWEEN
    return range(first, new_head_seq + 1, EVENTS_BETWEEN)


def attest(seq: int, event_hash: bytes, standing: Standing) -> Attestation:
    """Return the attestation of these balances after this event."""
    return Attestation(seq, event_hash, _digest(standing), _sums(standing))


def balances_of(name: str, currency: str, posted: int, debit: int, credit: int) -> Iterator[Balance]:
    """Return the balances of an account: what is posted, and what is pending on either side if something is."""
    yield name, currency, posted
    if debit:
        yield name + _DEBIT, currency, debit
    if credit:
        yield name + _CREDIT, currency, -credit


def pending_move(name: str, amount: int) -> tuple[str, int]:
    """Return which balance a line moves when it becomes pending, and by how much; by the opposite when it ends."""
    return name + (_DEBIT if amount > 0 else _CREDIT), amount


def is_of_account(name: str) -> bool:
    """Whether a balance is what is posted to an account, and not what is pending there."""
    return "!" not in name


def standing(balances: Iterable[Balance], moved_since: Mapping[str, int]) -> Standing:
    """Return how all accounts stood before what has `moved_since`, by account in minor units."""
    rest = dict(moved_since)
    stood = {name: (currency, now - rest.pop(name, 0)) for name, currency, now in balances}
    # What was posted to an account that is not there is left over, and must not be passed over.
    return {
        name: found
        for name, found in (
            stood | {name: (_currency(name, stood), -by) for name, by in rest.items()}
        ).items()
        if found[1]
    }


def _currency(name: str, stood: Standing) -> str:
    """Return the currency of what was moved and is not there any more; empty where there is no such account at all."""
    return stood.get(name.partition("!")[0], ("", 0))[0]


def _digest(stood: Standing) -> bytes:
    digest = sha256()
    for name in sorted(stood):
        currency, amount = stood[name]
        for part in (name, currency, str(amount)):
            data = part.encode()
            digest.update(_LENGTH.pack(len(data)) + data)
    return digest.digest()


def _sums(stood: Standing) -> str:
    sides: dict[str, list[int]] = {}
    for currency, amount in stood.values():
        sides.setdefault(currency, [0, 0])[amount < 0] += amount
    return json.dumps(
        {currency: [str(debit), str(credit)] for currency, (debit, credit) in sorted(sides.items())}
    )


#: Before the first event: no account, no balance.
NOTHING: Final = attest(0, GENESIS, {})


def attested_before(newest: Attestation | None, head_seq: int) -> Attestation | None:
    """Return what the balances of a book can be held against: the `newest` attestation, or that it began empty.

    None: a ledger that was brought up to attestations, and has more events before its first one than a sum should hold
    up a start or a batch for.
    """
    if newest is not None or head_seq > EVENTS_BETWEEN:
        return newest
    return NOTHING
