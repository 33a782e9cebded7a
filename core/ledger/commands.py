"""Commands: what somebody wishes, checked as far as it can be checked without looking at the book.

A body becomes a command or a rejection here, once, and never again: a `PostTransaction` in hand is balanced,
its amounts are whole minor units, its names are well formed. What depends on the book (does the account
exist, is there money) is the decider's. The line matters: a malformed wish is forgotten, a wish that the book
refused is remembered under its key. All faults of a body are told at once.
"""

from collections.abc import Iterator
from typing import Final, assert_never

import msgspec

from core.ledger import fields
from core.ledger.accounts import AccountType
from core.ledger.entries import EntryCommand, EntryDetails, RecordEntry, ReplaceEntry, ReverseEntry
from core.ledger.money import format_amount, is_currency, parse_amount, shortest
from core.ledger.reasons import Fault, Reason, Rejection, Slug, reject

POSTINGS_MIN: Final = 2
POSTINGS_MAX: Final = 500


class AccountBody(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The body that opens an account, as it comes over the wire."""

    id: str
    name: str
    type: str
    currency: str
    no_overdraft: bool = False


class PostingBody(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One line of a transaction's body."""

    account: str
    amount: str
    currency: str


class TransactionBody(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The body that posts a transaction, as it comes over the wire."""

    date: str
    description: str
    postings: list[PostingBody]
    state: str = "posted"
    tags: list[str] = []


class NoBody(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The body of a command that says everything in its path: nothing, or an empty object."""


class OpenAccount(msgspec.Struct, frozen=True):
    """The wish to open an account."""

    id: str
    name: str
    type: AccountType
    currency: str
    no_overdraft: bool


class CloseAccount(msgspec.Struct, frozen=True):
    """The wish that an account takes no more postings. Its balance stays where it is."""

    id: str


class Posting(msgspec.Struct, frozen=True):
    """One line of a transaction, in minor units, debit positive."""

    account: str
    amount: int
    currency: str


class PostTransaction(msgspec.Struct, frozen=True):
    """The wish to book a transaction. Its postings are balanced in every currency."""

    id: str
    date: str
    description: str
    tags: tuple[str, ...]
    postings: tuple[Posting, ...]


Command = OpenAccount | CloseAccount | PostTransaction | EntryCommand


def open_account(body: AccountBody) -> OpenAccount | Rejection:
    """Return the command in `body`, or everything that is wrong with it."""
    faults = [
        *fields.id_faults("/id", body.id),
        *fields.text_faults("/name", body.name, fields.NAME_CHARACTERS_MAX),
    ]
    if not body.name.strip():
        faults.append(Fault("/name", Reason.EMPTY))
    if body.type not in set(AccountType):
        faults.append(Fault("/type", Reason.UNKNOWN_VALUE))
    if not is_currency(body.currency):
        faults.append(Fault("/currency", Reason.MALFORMED))
    if faults:
        return Rejection(Slug.INVALID_BODY, tuple(faults))
    return OpenAccount(body.id, body.name, AccountType(body.type), body.currency, body.no_overdraft)


def close_account(account_id: str) -> CloseAccount:
    """Return the wish to close this account; the book knows whether there is one."""
    return CloseAccount(account_id)


def post_transaction(body: TransactionBody, transaction_id: str) -> PostTransaction | Rejection:
    """Return the command in `body` under the id it will have, or everything that is wrong with it."""
    postings, posting_faults = _postings(body.postings)
    faults = [*_head_faults(body), *posting_faults]
    if faults:
        return Rejection(Slug.INVALID_BODY, tuple(faults))
    unbalanced = _imbalance(postings)
    if unbalanced is not None:
        currency, off = unbalanced
        off_by = format_amount(off, currency)
        return reject(Slug.UNBALANCED, "/postings", Reason.NOT_ZERO_SUM, currency=currency, off_by=off_by)
    return PostTransaction(transaction_id, body.date, body.description, tuple(body.tags), tuple(postings))


def fingerprint_of(command: Command) -> bytes:
    """Return the bytes that two requests share exactly if they wish the same.

    Spelling is left out on purpose ("12" and "12.00" dollars, the order of the members, spaces), and so are
    the ids that the server gives: a client that builds its body anew for a retry must be recognised.
    """
    return msgspec.json.encode([type(command).__name__, _wish(command)])


def accounts_of(command: Command) -> tuple[str, ...]:
    """Return the accounts that the command names by their ids, each once, in its own order."""
    match command:
        case PostTransaction():
            return tuple(dict.fromkeys(posting.account for posting in command.postings))
        case OpenAccount() | CloseAccount():
            return (command.id,)
        case RecordEntry(details=details) | ReplaceEntry(details=details):
            return (details.account,) if details.account is not None else ()
        case ReverseEntry():
            return ()
        case _:
            assert_never(command)


def transaction_of(command: Command) -> str:
    """Return the transaction (of an entry that exists: the entry) by which evidence names the command."""
    match command:
        case PostTransaction() | RecordEntry():
            return command.id
        case ReplaceEntry() | ReverseEntry():
            return command.entry
        case OpenAccount() | CloseAccount():
            return ""
        case _:
            assert_never(command)


def _wish(command: Command) -> object:
    match command:
        case PostTransaction():
            return (command.date, command.description, command.tags, command.postings)
        case RecordEntry():
            return (_meant(command.details), command.origin, command.duplicates_wanted)
        # Only what is said: keys of wishes that came before a member could be said are still known.
        case ReplaceEntry(keeps_the_rest=True):
            return (command.entry, _meant(command.details), command.expected_seq, "the rest")
        case ReplaceEntry(expected_seq=None):
            return (command.entry, _meant(command.details))
        case ReplaceEntry():
            return (command.entry, _meant(command.details), command.expected_seq)
        case ReverseEntry():
            return command.entry if command.expected_seq is None else (command.entry, command.expected_seq)
        case OpenAccount() | CloseAccount():
            return command
        case _:
            assert_never(command)


def _meant(details: EntryDetails) -> EntryDetails:
    return msgspec.structs.replace(details, amount=shortest(details.amount))


def _head_faults(body: TransactionBody) -> Iterator[Fault]:
    yield from fields.date_faults("/date", body.date)
    yield from fields.description_faults("/description", body.description)
    if body.state == "pending":
        yield Fault("/state", Reason.NOT_SUPPORTED)
    elif body.state != "posted":
        yield Fault("/state", Reason.UNKNOWN_VALUE)
    yield from fields.tag_faults("/tags", body.tags)


def _postings(bodies: list[PostingBody]) -> tuple[list[Posting], list[Fault]]:
    if len(bodies) > POSTINGS_MAX:
        return [], [Fault("/postings", Reason.TOO_MANY)]
    postings: list[Posting] = []
    faults = [Fault("/postings", Reason.TOO_FEW)] if len(bodies) < POSTINGS_MIN else []
    for index, body in enumerate(bodies):
        here = f"/postings/{index}"
        faults.extend(fields.id_faults(f"{here}/account", body.account))
        if not is_currency(body.currency):
            faults.append(Fault(f"{here}/currency", Reason.MALFORMED))
            continue
        amount = parse_amount(body.amount, body.currency)
        if isinstance(amount, Reason):
            faults.append(Fault(f"{here}/amount", amount))
        else:
            postings.append(Posting(body.account, amount, body.currency))
    return postings, faults


def _imbalance(postings: list[Posting]) -> tuple[str, int] | None:
    sums: dict[str, int] = {}
    for posting in postings:
        sums[posting.currency] = sums.get(posting.currency, 0) + posting.amount
    return next(((currency, total) for currency, total in sums.items() if total != 0), None)
