"""Planning: a plan's body checked, decided against the book, and its days turned into ordinary commands.

A template is checked by making the very command of its first day: what can't be booked then is refused now, with the
place of the fault in the body of the plan. Whether its accounts exist is asked on each day and not before, because they
may be opened or closed until then; a day that the book refuses keeps its reason under its key.
"""

import datetime as dt
from collections.abc import Iterator
from typing import Final

from core.ledger import fields
from core.ledger.book import Book
from core.ledger.commands import PostingBody, PostTransaction, TransactionBody, post_transaction
from core.ledger.entries import EntryBody, RecordEntry, record_entry
from core.ledger.household import CATEGORY_TYPES
from core.ledger.money import amount_fault, parse_amount
from core.ledger.plans import (
    BudgetBody,
    BudgetSet,
    EndRecurring,
    KnownRecurring,
    PlanCommand,
    PlanEvent,
    RecurringBody,
    RecurringEnded,
    RecurringSet,
    SetBudget,
    SetRecurring,
    faults_of,
)
from core.ledger.reasons import Fault, Reason, Rejection, Slug, reject, within
from core.ledger.recurrence import dates_between

DAY_NS: Final = 86_400_000_000_000
_EPOCH: Final = dt.date(1970, 1, 1)


def set_budget(body: BudgetBody, month: str) -> SetBudget | Rejection:
    """Return the wish in `body` for a well-formed month, or everything that is wrong with it."""
    faults = list(fields.id_faults("/account", body.account))
    if body.amount is not None:
        wrong = amount_fault(body.amount) or (Reason.OUT_OF_RANGE if body.amount.startswith("-") else None)
        faults.extend([Fault("/amount", wrong)] if wrong is not None else [])
    if faults:
        return Rejection(Slug.INVALID_BODY, tuple(faults))
    return SetBudget(body.account, month, body.amount)


def set_recurring(body: RecurringBody, item_id: str, *, is_new: bool) -> SetRecurring | Rejection:
    """Return the wish in `body` under its id, or everything that is wrong with it."""
    faults = tuple(faults_of(body))
    if faults:
        return Rejection(Slug.INVALID_BODY, faults)
    command = occurrence(body, body.start, item_id)
    if isinstance(command, Rejection):
        return within(command, "/entry" if body.entry is not None else "/transaction")
    return SetRecurring(item_id, body, is_new)


def occurrence(plan: RecurringBody, day: str, command_id: str) -> RecordEntry | PostTransaction | Rejection:
    """Return what a recurring item books on a day, under the id that the booking will have."""
    if plan.entry is not None:
        made = plan.entry
        entry = EntryBody(
            day,
            made.amount,
            made.currency,
            made.account,
            made.category,
            made.description,
            made.payment_method,
            list(made.tags),
        )
        return record_entry(entry, command_id)
    assert plan.transaction is not None, "a recurring item books an entry or a transaction"
    lines = [PostingBody(line.account, line.amount, line.currency) for line in plan.transaction.postings]
    body = TransactionBody(day, plan.transaction.description, lines, tags=list(plan.transaction.tags))
    return post_transaction(body, command_id)


def days_of(event: RecurringSet, first: dt.date, last: dt.date) -> Iterator[dt.date]:
    """Yield the days between two on which a recurring item comes, both included, in order."""
    plan = event.plan
    begin = max(first, dt.date.fromisoformat(event.since))
    end = dt.date.fromisoformat(plan.end) if plan.end is not None else None
    return dates_between(plan.rule, dt.date.fromisoformat(plan.start), end, begin, last)


def key_of(item_id: str, day: str) -> str:
    """Return the key under which a recurring item is booked on a day: once, whoever books it."""
    return f"recurring:{item_id}:{day}"


def decide_plan(command: PlanCommand, book: Book) -> tuple[PlanEvent, ...] | Rejection:
    """Return what happens if this plan is taken, or why the book refuses it."""
    match command:
        case SetBudget():
            return _budget(command, book)
        case SetRecurring(is_new=True):
            # The days from its beginning on are made up for, however long ago that is.
            return (RecurringSet(command.id, command.plan.start, command.plan),)
        case SetRecurring():
            known = _going_on(command.id, book)
            if isinstance(known, Rejection):
                return known
            # What has come by the old rule has come: a new one makes up for nothing.
            today = (_EPOCH + dt.timedelta(days=book.now_ns // DAY_NS)).isoformat()
            return (RecurringSet(command.id, max(command.plan.start, today), command.plan),)
        case EndRecurring():
            known = _going_on(command.id, book)
            return known if isinstance(known, Rejection) else (RecurringEnded(command.id),)


def _budget(command: SetBudget, book: Book) -> tuple[BudgetSet, ...] | Rejection:
    account = book.accounts.get(command.account)
    if account is None:
        return reject(Slug.UNKNOWN_ACCOUNT, "/account", Reason.UNKNOWN_ACCOUNT, account=command.account)
    if account.type not in CATEGORY_TYPES:
        return reject(Slug.NOT_A_CATEGORY, "/account", Reason.NOT_SUPPORTED, account=command.account)
    if account.closed and command.amount is not None:
        return reject(Slug.ACCOUNT_CLOSED, "/account", Reason.CLOSED, account=command.account)
    if command.amount is not None:
        minor = parse_amount(command.amount, account.currency)
        if isinstance(minor, Reason):
            return reject(Slug.INVALID_BODY, "/amount", minor)
    return (BudgetSet(command.account, command.month, command.amount, account.currency),)


def _going_on(item_id: str, book: Book) -> KnownRecurring | Rejection:
    known = book.recurrings.get(item_id)
    if known is None:
        return reject(Slug.RECURRING_NOT_FOUND, "", Reason.UNKNOWN_ENTRY)
    return reject(Slug.RECURRING_ENDED, "", Reason.CLOSED) if known.ended else known
