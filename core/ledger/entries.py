"""Entries: what a household writes down ("12,000 won for lunch, by card"), as commands.

Somebody who keeps a household's book thinks in one amount, one account and one category. Beneath it stays
double entry: the decider turns a command of this room into accounts that are made on first use and one balanced
transaction. A second kind of book for households was not chosen: two truths would have to be kept in step.
A minus was spent, a plus came in. Nothing is ever deleted: to replace or reverse an entry books the opposite.

Everything here is made from plain values, so that an import builds its commands exactly as a request does:

    body = EntryBody(date="2026-11-21", amount="-12000", account="assets:bank", category="식비")
    command = record_entry(body, new_id, Origin(import_id, row, fingerprint))   # or a Rejection
"""

import re
from collections.abc import Iterator
from typing import Annotated, Final

import msgspec

from core.ledger import fields
from core.ledger.money import amount_fault, is_currency, is_zero, parse_amount
from core.ledger.reasons import Fault, Reason, Rejection, Slug

IMPORT_CHARACTERS_MAX: Final = 64
SEQ_MAX: Final = (1 << 53) - 1  # what a browser's numbers hold exactly
_FINGERPRINT: Final = re.compile(r"[0-9a-f]{32}")


class EntryBody(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The body of an entry, as it comes over the wire.

    `amount` is a decimal string, minus for what was spent; `account` is the id of an account that exists.
    Without it the money moves on the account named `payment_method`, made on first use. A blank `category` or
    `payment_method` is none. `currency` may be left out where the account has one.
    """

    date: str
    amount: str
    currency: str | None = None
    account: str | None = None
    category: str | None = None
    description: str = ""
    payment_method: str | None = None
    tags: list[str] = []


SeqSeen = Annotated[int, msgspec.Meta(ge=1, le=SEQ_MAX)]


class EntryChangeBody(EntryBody, frozen=True, forbid_unknown_fields=True):
    """The body that changes an entry; `expected_seq`: the `seq` that whoever changes it has seen."""

    expected_seq: SeqSeen | None = None


class EntryReversalBody(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The body that reverses an entry; it may as well be empty."""

    expected_seq: SeqSeen | None = None


class Origin(msgspec.Struct, frozen=True, rename={"import_id": "import"}):
    """The row of a bank's file that an entry comes from; `fingerprint` (32 hex digits) knows it again."""

    import_id: str
    row: int
    fingerprint: str


class EntryDetails(msgspec.Struct, frozen=True):
    """A well-formed entry. Names are trimmed; `amount` becomes minor units once its currency is known."""

    date: str
    amount: str
    currency: str | None
    account: str | None
    category: str | None
    description: str
    payment_method: str | None
    tags: tuple[str, ...]


class RecordEntry(msgspec.Struct, frozen=True):
    """The wish to write an entry down. `id` names the entry and the transaction that it becomes.

    The book refuses an `origin` whose fingerprint it has seen before, unless `duplicates_wanted`.
    """

    id: str
    details: EntryDetails
    origin: Origin | None = None
    duplicates_wanted: bool = False


class ReplaceEntry(msgspec.Struct, frozen=True):
    """The wish that an entry says something else: what stands is reversed, `details` are booked instead.

    `expected_seq`: only if what stands is still this; None: whatever stands. `keeps_the_rest`: payment method and
    tags stay what they are in the book at that moment; who shows neither can't say them.
    """

    entry: str
    details: EntryDetails
    transaction: str
    reversal: str
    expected_seq: int | None = None
    keeps_the_rest: bool = False


class ReverseEntry(msgspec.Struct, frozen=True):
    """The wish that an entry stands no longer: it is reversed by the transaction `reversal`.

    `expected_seq`: only if what stands is still this; None: whatever stands.
    """

    entry: str
    reversal: str
    expected_seq: int | None = None


EntryCommand = RecordEntry | ReplaceEntry | ReverseEntry


def record_entry(
    body: EntryBody, entry_id: str, origin: Origin | None = None, *, duplicates_wanted: bool = False
) -> RecordEntry | Rejection:
    """Return the command in `body` under the id it will have, or everything that is wrong with it.

    `origin` is where an import found the row; a malformed one is our own bug.
    """
    assert origin is None or _is_origin(origin), f"{origin} is no row of an import"
    details = _details(body)
    if isinstance(details, Rejection):
        return details
    return RecordEntry(entry_id, details, origin, duplicates_wanted)


def replace_entry(
    entry_id: str,
    body: EntryBody,
    transaction_id: str,
    reversal_id: str,
    *,
    expected_seq: int | None = None,
    keeps_the_rest: bool = False,
) -> ReplaceEntry | Rejection:
    """Return the wish to replace an entry by `body`; the book knows whether there is one.

    The ids are those of the two transactions it takes. `keeps_the_rest`: `body` says neither payment method nor
    tags, and they stay what they are.
    """
    assert not keeps_the_rest or (body.payment_method is None and not body.tags), "said and kept at once"
    details = _details(body)
    if isinstance(details, Rejection):
        return details
    return ReplaceEntry(entry_id, details, transaction_id, reversal_id, expected_seq, keeps_the_rest)


def reverse_entry(entry_id: str, reversal_id: str, expected_seq: int | None = None) -> ReverseEntry:
    """Return the wish to reverse an entry; the book knows whether there is one."""
    return ReverseEntry(entry_id, reversal_id, expected_seq)


def _details(body: EntryBody) -> EntryDetails | Rejection:
    faults = tuple(_faults(body))
    if faults:
        return Rejection(Slug.INVALID_BODY, faults)
    return EntryDetails(
        body.date,
        body.amount,
        body.currency,
        body.account,
        _named(body.category),
        body.description,
        _named(body.payment_method),
        tuple(body.tags),
    )


def _faults(body: EntryBody) -> Iterator[Fault]:
    yield from fields.date_faults("/date", body.date)
    yield from _amount_faults(body)
    if body.account is not None:
        yield from fields.id_faults("/account", body.account)
    elif _named(body.payment_method) is None:
        yield Fault("/account", Reason.MISSING)
    for pointer, name in (("/category", body.category), ("/payment_method", body.payment_method)):
        if name is not None:
            yield from fields.text_faults(pointer, name.strip(), fields.NAME_CHARACTERS_MAX)
    yield from fields.description_faults("/description", body.description)
    yield from fields.tag_faults("/tags", body.tags)


def _amount_faults(body: EntryBody) -> Iterator[Fault]:
    known = body.currency is not None and is_currency(body.currency)
    if body.currency is not None and not known:
        yield Fault("/currency", Reason.MALFORMED)
    wrong = amount_fault(body.amount)
    if wrong is None and known:
        assert body.currency is not None
        minor = parse_amount(body.amount, body.currency)
        wrong = minor if isinstance(minor, Reason) else None
    if wrong is None and is_zero(body.amount):
        wrong = Reason.ZERO
    if wrong is not None:
        yield Fault("/amount", wrong)


def _named(name: str | None) -> str | None:
    return (name.strip() or None) if name is not None else None


def _is_origin(origin: Origin) -> bool:
    named = 0 < len(origin.import_id) <= IMPORT_CHARACTERS_MAX and origin.row >= 0
    return named and _FINGERPRINT.fullmatch(origin.fingerprint) is not None
