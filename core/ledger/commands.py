"""Commands: what somebody wishes, checked as far as it can be checked without looking at the book.

A body becomes a command or a rejection here, once, and never again: a `PostTransaction` in hand is balanced,
its amounts are whole minor units, its names are well formed. What depends on the book (does the account
exist, is there money) is the decider's. The line matters: a malformed wish is forgotten, a wish that the book
refused is remembered under its key. All faults of a body are told at once.
A command may say what it has seen: `expected_versions` are accounts with their versions, and the book refuses the
command where one of them has been touched since.
"""

from collections.abc import Iterable, Iterator, Sequence
from typing import Final, assert_never

import msgspec

from core.ledger import fields
from core.ledger.accounts import AccountType
from core.ledger.entries import EntryCommand, EntryDetails, RecordEntry, ReplaceEntry, ReverseEntry
from core.ledger.money import amount_fault, format_amount, is_currency, parse_amount, shortest
from core.ledger.plans import EndRecurring, PlanCommand, SetBudget, SetRecurring, wish_of_plan
from core.ledger.reasons import Fault, Reason, Rejection, Slug, reject, within
from core.ledger.seen import version_faults

POSTINGS_MIN: Final = 2
POSTINGS_MAX: Final = 500
BATCH_TRANSACTIONS_MAX: Final = 8_190
TIMEOUT_S_MAX: Final = 10 * 366 * 86_400  # ten years, whichever ones


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
    timeout_s: int | None = None
    expected_versions: dict[str, int] = {}


class PendingPostBody(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The body that posts a pending transaction; it may as well be empty.

    `postings`: what of it is posted, line by line; absent: all of it. `date`: its day; absent: that of the pending one.
    """

    postings: list[PostingBody] | None = None
    date: str | None = None
    expected_versions: dict[str, int] = {}


class BatchBody(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The body of many transactions. `atomic`: they are booked all together or not at all."""

    transactions: list[TransactionBody]
    atomic: bool = False
    expected_versions: dict[str, int] = {}


class AccountAssertionBody(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The body that says what the account of its path stood at by the end of a day, debit positive."""

    date: str
    amount: str
    expected_versions: dict[str, int] = {}


class AssertionBody(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The body that says what an account stood at by the end of a day, debit positive."""

    account: str
    date: str
    amount: str


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
    expected_versions: dict[str, int] = {}


class Posting(msgspec.Struct, frozen=True):
    """One line of a transaction, in minor units, debit positive."""

    account: str
    amount: int
    currency: str


class PostTransaction(msgspec.Struct, frozen=True):
    """The wish to book a transaction. Its postings are balanced in every currency.

    `pending`: it is only reserved, for `timeout_s` seconds (None: until somebody posts or voids it).
    """

    id: str
    date: str
    description: str
    tags: tuple[str, ...]
    postings: tuple[Posting, ...]
    pending: bool = False
    timeout_s: int | None = None
    expected_versions: dict[str, int] = {}


class PostPending(msgspec.Struct, frozen=True):
    """The wish to book what is pending, as the transaction `id`.

    `postings`: what of it, line by line; None: all of it. `date` None: on the day of the pending one.
    """

    id: str
    pending: str
    postings: tuple[Posting, ...] | None = None
    date: str | None = None
    expected_versions: dict[str, int] = {}


class VoidPending(msgspec.Struct, frozen=True):
    """The wish to give up what is pending: nothing is booked, and what it held is free."""

    pending: str
    expected_versions: dict[str, int] = {}


class ExpirePending(msgspec.Struct, frozen=True):
    """The wish to free what a pending transaction holds that has run out. The house's own, nobody sends it."""

    pending: str


class ReverseTransaction(msgspec.Struct, frozen=True):
    """The wish to take a booked transaction back by the opposite transaction `reversal`, on the same day."""

    id: str
    reversal: str
    expected_versions: dict[str, int] = {}


class AssertBalance(msgspec.Struct, frozen=True):
    """The wish to have written down what an account should stand at by the end of a day, and whether it does.

    `amount` becomes minor units once the account is known, whose currency it is in.
    """

    id: str
    account: str
    date: str
    amount: str
    expected_versions: dict[str, int] = {}


class AtomicBatch(msgspec.Struct, frozen=True):
    """The wish to book transactions one after the other, all of them or none."""

    commands: tuple[PostTransaction, ...]
    expected_versions: dict[str, int] = {}


Command = (
    OpenAccount
    | CloseAccount
    | PostTransaction
    | PostPending
    | VoidPending
    | ExpirePending
    | ReverseTransaction
    | AssertBalance
    | AtomicBatch
    | EntryCommand
    | PlanCommand
)


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


def close_account(account_id: str, expected_versions: dict[str, int] | None = None) -> CloseAccount:
    """Return the wish to close this account; the book knows whether there is one."""
    return CloseAccount(account_id, expected_versions or {})


def post_transaction(
    body: TransactionBody, transaction_id: str, expected_versions: dict[str, int] | None = None
) -> PostTransaction | Rejection:
    """Return the command in `body` under the id it will have, or everything that is wrong with it."""
    postings, posting_faults = _postings(body.postings)
    faults = [*_head_faults(body), *posting_faults, *version_faults(body.expected_versions)]
    if faults:
        return Rejection(Slug.INVALID_BODY, tuple(faults))
    return _unbalanced(postings) or PostTransaction(
        transaction_id,
        body.date,
        body.description,
        tuple(body.tags),
        tuple(postings),
        body.state == "pending",
        body.timeout_s,
        expected_versions or {},
    )


def post_pending(
    pending_id: str,
    body: PendingPostBody,
    transaction_id: str,
    expected_versions: dict[str, int] | None = None,
) -> PostPending | Rejection:
    """Return the wish to post what is pending, under the id that the booked transaction will have."""
    faults = list(version_faults(body.expected_versions))
    if body.date is not None:
        faults.extend(fields.date_faults("/date", body.date))
    if body.postings is None:
        if faults:
            return Rejection(Slug.INVALID_BODY, tuple(faults))
        return PostPending(transaction_id, pending_id, None, body.date, expected_versions or {})
    postings, posting_faults = _postings(body.postings)
    if faults or posting_faults:
        return Rejection(Slug.INVALID_BODY, (*faults, *posting_faults))
    return _unbalanced(postings) or PostPending(
        transaction_id, pending_id, tuple(postings), body.date, expected_versions or {}
    )


def assert_balance(
    body: AssertionBody, assertion_id: str, expected_versions: dict[str, int] | None = None
) -> AssertBalance | Rejection:
    """Return the wish to hold the book against a balance, or everything that is wrong with it."""
    faults = [*fields.id_faults("/account", body.account), *fields.date_faults("/date", body.date)]
    wrong = amount_fault(body.amount)
    if wrong is not None:
        faults.append(Fault("/amount", wrong))
    if faults:
        return Rejection(Slug.INVALID_BODY, tuple(faults))
    return AssertBalance(assertion_id, body.account, body.date, body.amount, expected_versions or {})


def post_batch(
    body: BatchBody, transaction_ids: Sequence[str], expected_versions: dict[str, int] | None = None
) -> AtomicBatch | Rejection:
    """Return the wish to book all of these or none, or what is wrong with the first that is malformed."""
    if not body.transactions:
        return reject(Slug.INVALID_BODY, "/transactions", Reason.TOO_FEW)
    if len(body.transactions) > BATCH_TRANSACTIONS_MAX:
        return reject(Slug.INVALID_BODY, "/transactions", Reason.TOO_MANY)
    faults = tuple(version_faults(body.expected_versions))
    if faults:
        return Rejection(Slug.INVALID_BODY, faults)
    commands = []
    for place, (one, transaction_id) in enumerate(zip(body.transactions, transaction_ids, strict=True)):
        if one.expected_versions:
            # Of the whole they can be said, of a part in the middle of it nobody could have seen them.
            here = f"/transactions/{place}/expected_versions"
            return reject(Slug.INVALID_BODY, here, Reason.NOT_SUPPORTED)
        command = post_transaction(one, transaction_id)
        if isinstance(command, Rejection):
            return within(command, f"/transactions/{place}")
        commands.append(command)
    return AtomicBatch(tuple(commands), expected_versions or {})


def fingerprint_of(command: Command) -> bytes:
    """Return the bytes that two requests share exactly if they wish the same.

    Spelling is left out on purpose ("12" and "12.00" dollars, the order of the members, spaces), and so are
    the ids that the server gives: a client that builds its body anew for a retry must be recognised.
    """
    return msgspec.json.encode([type(command).__name__, _wish(command)])


def accounts_of(command: Command) -> tuple[str, ...]:
    """Return the accounts that the command names by their ids, each once, in its own order.

    Those that it does not name (of what is pending, of what is reversed) are in the book that it is decided on.
    """
    return tuple(dict.fromkeys((*_accounts_of(command), *expected_versions_of(command))))


def _accounts_of(command: Command) -> Iterable[str]:
    match command:
        case PostTransaction():
            return (posting.account for posting in command.postings)
        case PostPending():
            return (posting.account for posting in command.postings or ())
        case AtomicBatch():
            return (posting.account for one in command.commands for posting in one.postings)
        case OpenAccount() | CloseAccount():
            return (command.id,)
        case AssertBalance() | SetBudget():
            return (command.account,)
        case RecordEntry(details=details) | ReplaceEntry(details=details):
            return (details.account,) if details.account is not None else ()
        case ReverseEntry() | VoidPending() | ExpirePending() | ReverseTransaction():
            return ()
        case SetRecurring() | EndRecurring():
            return ()
        case _:
            assert_never(command)


def expected_versions_of(command: Command) -> dict[str, int]:
    """Return the accounts that whoever sent the command has seen, with their versions."""
    if isinstance(command, OpenAccount | ExpirePending | EntryCommand | PlanCommand):
        return {}
    return command.expected_versions


def transaction_of(command: Command) -> str:
    """Return the transaction (of an entry that exists: the entry) by which evidence names the command."""
    match command:
        case PostTransaction() | RecordEntry() | AssertBalance():
            return command.id
        case ReplaceEntry() | ReverseEntry():
            return command.entry
        case PostPending() | VoidPending() | ExpirePending():
            return command.pending
        case ReverseTransaction():
            return command.id
        case AtomicBatch():
            return command.commands[0].id if command.commands else ""
        case SetRecurring() | EndRecurring():
            return command.id
        case OpenAccount() | CloseAccount() | SetBudget():
            return ""
        case _:
            assert_never(command)


def _wish(command: Command) -> object:
    # Only what is said: keys of wishes that came before a member could be said are still known.
    seen = expected_versions_of(command)
    said = (sorted(seen.items()),) if seen else ()
    match command:
        case PostTransaction():
            return (*_meant_by(command), *said)
        case PostPending():
            return (command.pending, command.postings, command.date, *said)
        case VoidPending() | ExpirePending():
            return (command.pending, *said)
        case ReverseTransaction():
            return (command.id, *said)
        case AssertBalance():
            return (command.account, command.date, shortest(command.amount), *said)
        case AtomicBatch():
            return ([_meant_by(one) for one in command.commands], *said)
        case CloseAccount():
            return ({"id": command.id}, *said) if said else {"id": command.id}
        case OpenAccount():
            return command
        case RecordEntry() | ReplaceEntry() | ReverseEntry():
            return _wish_of_entry(command)
        case SetBudget() | SetRecurring() | EndRecurring():
            return wish_of_plan(command)
        case _:
            assert_never(command)


def _meant_by(command: PostTransaction) -> tuple[object, ...]:
    booked = (command.date, command.description, command.tags, command.postings)
    return (*booked, "pending", command.timeout_s) if command.pending else booked


def _wish_of_entry(command: EntryCommand) -> object:
    match command:
        case RecordEntry():
            return (_meant(command.details), command.origin, command.duplicates_wanted)
        case ReplaceEntry(keeps_the_rest=True):
            return (command.entry, _meant(command.details), command.expected_seq, "the rest")
        case ReplaceEntry(expected_seq=None):
            return (command.entry, _meant(command.details))
        case ReplaceEntry():
            return (command.entry, _meant(command.details), command.expected_seq)
        case ReverseEntry():
            return command.entry if command.expected_seq is None else (command.entry, command.expected_seq)
        case _:
            assert_never(command)


def _meant(details: EntryDetails) -> EntryDetails:
    return msgspec.structs.replace(details, amount=shortest(details.amount))


def _head_faults(body: TransactionBody) -> Iterator[Fault]:
    yield from fields.date_faults("/date", body.date)
    yield from fields.description_faults("/description", body.description)
    if body.state not in {"posted", "pending"}:
        yield Fault("/state", Reason.UNKNOWN_VALUE)
    if body.timeout_s is not None:
        yield from _timeout_faults(body)
    yield from fields.tag_faults("/tags", body.tags)


def _timeout_faults(body: TransactionBody) -> Iterator[Fault]:
    assert body.timeout_s is not None
    if body.state == "posted":
        yield Fault("/timeout_s", Reason.NOT_SUPPORTED)  # what is booked does not run out
    elif not 1 <= body.timeout_s <= TIMEOUT_S_MAX:
        yield Fault("/timeout_s", Reason.OUT_OF_RANGE)


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


def _unbalanced(postings: list[Posting]) -> Rejection | None:
    unbalanced = _imbalance(postings)
    if unbalanced is None:
        return None
    currency, off = unbalanced
    off_by = format_amount(off, currency)
    return reject(Slug.UNBALANCED, "/postings", Reason.NOT_ZERO_SUM, currency=currency, off_by=off_by)


def _imbalance(postings: list[Posting]) -> tuple[str, int] | None:
    sums: dict[str, int] = {}
    for posting in postings:
        sums[posting.currency] = sums.get(posting.currency, 0) + posting.amount
    return next(((currency, total) for currency, total in sums.items() if total != 0), None)
