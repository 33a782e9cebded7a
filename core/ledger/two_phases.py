"""Two phases: a transaction is made pending, and later posted (whole or in part), voided, or it runs out.

Each ends once. What ends it releases all that it held: what is left of a part that was posted is free again, as at a
petrol pump. From its moment on a pending transaction can't be posted or voided any more, whether somebody has written
down yet that it has run out or not: the book must not depend on how punctual that is. A post of more than was pending was
not chosen: the reservation is what both sides have agreed upon, and for the rest there is a transaction.
"""

from typing import assert_never

from core.ledger.book import Book, KnownPending, PendingState
from core.ledger.commands import ExpirePending, Posting, PostPending, PostTransaction, VoidPending
from core.ledger.events import (
    Event,
    PendingExpired,
    PendingPosted,
    PendingVoided,
    expiry_of,
    lines_of,
    made_pending,
    postings_of,
)
from core.ledger.evolving import Accounts
from core.ledger.limits import amount_of_line, beyond, nothing_in_particular, unusable
from core.ledger.moments import SECOND_NS
from core.ledger.reasons import Fault, Reason, Rejection, Slug, reject

_Decision = tuple[Event, ...] | Rejection


def reserve(command: PostTransaction, accounts: Accounts, now_ns: int) -> _Decision:
    """Make a transaction pending whose accounts can take its lines."""
    timeout = command.timeout_s
    events = (made_pending(command, None if timeout is None else now_ns + timeout * SECOND_NS),)
    return beyond(events, accounts, command.postings, amount_of_line) or events


def post(command: PostPending, book: Book) -> _Decision:
    """Book what is pending, all of it or what the command says."""
    known = _open(command.pending, book)
    if isinstance(known, Rejection):
        return known
    held = postings_of(known.event)
    lines = held if command.postings is None else command.postings
    refused = _beyond_what_is_held(lines, held) or _closed(held, book.accounts)
    if refused is not None:
        return refused
    event = PendingPosted(
        command.id,
        command.pending,
        command.date or known.event.date,
        known.event.description,
        known.event.tags,
        lines_of(lines),
        known.event.postings,
    )
    pointer = nothing_in_particular if command.postings is None else amount_of_line
    return beyond((event,), book.accounts, lines, pointer) or (event,)


def void(command: VoidPending, book: Book) -> _Decision:
    """Give up what is pending. An account that was closed does not stand in the way: nothing is booked."""
    known = _open(command.pending, book)
    if isinstance(known, Rejection):
        return known
    return (PendingVoided(command.pending, known.event.postings),)


def expire(command: ExpirePending, book: Book) -> _Decision:
    """Free what a pending transaction holds that has run out."""
    known = book.pendings.get(command.pending)
    if known is None:
        return _unknown()
    if known.state is not PendingState.OPEN:
        return ended(known.state)
    if not _is_over(known, book.now_ns):
        return reject(Slug.NOT_YET_EXPIRED, "", Reason.NOT_DUE)
    return (PendingExpired(command.pending, known.event.postings),)


def ended(state: PendingState) -> Rejection:
    """Say that a pending transaction has ended already, and how; open: that it has not been booked yet."""
    match state:
        case PendingState.OPEN:
            return reject(Slug.TRANSACTION_PENDING, "", Reason.PENDING)
        case PendingState.POSTED:
            return reject(Slug.PENDING_POSTED, "", Reason.POSTED)
        case PendingState.VOIDED:
            return reject(Slug.PENDING_VOIDED, "", Reason.VOIDED)
        case PendingState.EXPIRED:
            return reject(Slug.PENDING_EXPIRED, "", Reason.EXPIRED)
        case _:
            assert_never(state)


def _open(pending: str, book: Book) -> KnownPending | Rejection:
    known = book.pendings.get(pending)
    if known is None:
        return _unknown()
    if known.state is not PendingState.OPEN:
        return ended(known.state)
    return ended(PendingState.EXPIRED) if _is_over(known, book.now_ns) else known


def _unknown() -> Rejection:
    return reject(Slug.PENDING_NOT_FOUND, "", Reason.UNKNOWN_TRANSACTION)


def _is_over(known: KnownPending, now_ns: int) -> bool:
    expires_ns = expiry_of(known.event)
    return expires_ns is not None and now_ns >= expires_ns


def _closed(lines: tuple[Posting, ...], accounts: Accounts) -> Rejection | None:
    refused = unusable(lines, accounts)
    return Rejection(refused.slug, (), refused.values) if refused is not None else None


def _beyond_what_is_held(lines: tuple[Posting, ...], held: tuple[Posting, ...]) -> Rejection | None:
    """Say which lines are not those of the pending transaction, on the same side and at most as large."""
    if len(lines) != len(held):
        return reject(
            Slug.PENDING_EXCEEDED, "/postings", Reason.TOO_MANY if len(lines) > len(held) else Reason.TOO_FEW
        )
    faults: list[Fault] = []
    for place, (line, most) in enumerate(zip(lines, held, strict=True)):
        if line.account != most.account:
            faults.append(Fault(f"/postings/{place}/account", Reason.EXCEEDS_PENDING))
        elif line.currency != most.currency:
            faults.append(Fault(f"/postings/{place}/currency", Reason.CURRENCY_DIFFERS))
        elif not min(0, most.amount) <= line.amount <= max(0, most.amount):
            faults.append(Fault(f"/postings/{place}/amount", Reason.EXCEEDS_PENDING))
    return Rejection(Slug.PENDING_EXCEEDED, tuple(faults)) if faults else None
