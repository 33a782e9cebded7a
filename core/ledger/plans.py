"""Plans: what a household means to spend, and what comes back by itself, as wishes and as what has happened.

A budget is said for a category and a month and holds from that month until another is said: nobody writes the same
twelve numbers in January. A recurring item holds a template and a rule; on each of its days it is booked as an ordinary
command with a key that names the item and the day, so that it is booked exactly once, whoever books it and however often.
Plans book nothing themselves and change no balance; they are events all the same, so that what was planned last year
can be read and proven like anything else. A file of settings was not chosen: it would not be in the backup's chain.
"""

from collections.abc import Iterator
from typing import Final, assert_never

import msgspec

from core.ledger import fields
from core.ledger.money import parse_amount
from core.ledger.reasons import Fault, Reason
from core.ledger.recurrence import DAYS_OF_WEEK, EVERY_MAX, Rule, Unit

TITLE_CHARACTERS_MAX: Final = 200
LINES_MAX: Final = 100
_DAYS_OF_MONTH: Final = range(1, 32)


class BudgetBody(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The body that sets what is meant for a category from a month on; `amount` null: nothing any more.

    `account` is the id of an account of income or expense, `amount` is not negative and in its currency.
    """

    account: str
    amount: str | None


class EntryTemplate(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An entry of the household without its day; its members are those of an entry."""

    amount: str
    currency: str | None = None
    account: str | None = None
    category: str | None = None
    description: str = ""
    payment_method: str | None = None
    tags: tuple[str, ...] = ()


class TemplateLine(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A line of a transaction without its day."""

    account: str
    amount: str
    currency: str


class TransactionTemplate(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A transaction without its day."""

    description: str
    postings: tuple[TemplateLine, ...]
    tags: tuple[str, ...] = ()


class RecurringBody(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The body of a recurring item: what it is called, when it comes, and what is booked then.

    Exactly one of `entry` and `transaction` says what; `end` is the last day on which it may come.
    """

    title: str
    rule: Rule
    start: str
    end: str | None = None
    entry: EntryTemplate | None = None
    transaction: TransactionTemplate | None = None


class SetBudget(msgspec.Struct, frozen=True):
    """The wish to mean `amount` for a category from `month` (YYYY-MM) on; None: nothing any more."""

    account: str
    month: str
    amount: str | None


class SetRecurring(msgspec.Struct, frozen=True):
    """The wish that something comes back by a rule. `is_new`: under an id that nothing has yet."""

    id: str
    plan: RecurringBody
    is_new: bool


class EndRecurring(msgspec.Struct, frozen=True):
    """The wish that a recurring item comes back no more. What it has booked stays."""

    id: str


PlanCommand = SetBudget | SetRecurring | EndRecurring


class BudgetSet(msgspec.Struct, frozen=True, tag_field="kind", tag="budget.set"):
    """From `month` on, `amount` is meant for a category; None: nothing any more."""

    account: str
    month: str
    amount: str | None
    currency: str
    v: int = 1


class RecurringSet(msgspec.Struct, frozen=True, tag_field="kind", tag="recurring.set"):
    """A recurring item is this from now on. No day before `since` is booked by what stands here."""

    id: str
    since: str
    plan: RecurringBody
    v: int = 1


class RecurringEnded(msgspec.Struct, frozen=True, tag_field="kind", tag="recurring.ended"):
    """A recurring item comes back no more."""

    id: str
    v: int = 1


PlanEvent = BudgetSet | RecurringSet | RecurringEnded


class KnownRecurring(msgspec.Struct, frozen=True):
    """A recurring item as it stands: the number and the content of its newest event, and whether it has ended."""

    seq: int
    event: RecurringSet
    ended: bool = False


def wish_of_plan(command: PlanCommand) -> object:
    """Return what two of these commands share exactly if they wish the same."""
    if isinstance(command, SetRecurring) and command.is_new:
        return command.plan  # its id is the server's
    return msgspec.structs.astuple(command)


def is_readable(event: PlanEvent) -> bool:
    """Whether a stored plan holds what only a plan can hold."""
    match event:
        case RecurringEnded():
            return True
        case BudgetSet():
            amount = event.amount
            return amount is None or isinstance(parse_amount(amount, event.currency), int)
        case RecurringSet():
            return fields.is_date(event.since) and not any(faults_of(event.plan))
        case _:
            assert_never(event)


def faults_of(body: RecurringBody) -> Iterator[Fault]:
    """Say what is wrong with the head and the rule of a recurring item; its template is judged by who books it."""
    yield from _rule_faults(body.rule)
    yield from fields.text_faults("/title", body.title, TITLE_CHARACTERS_MAX)
    if not body.title.strip():
        yield Fault("/title", Reason.EMPTY)
    yield from fields.date_faults("/start", body.start)
    if body.end is not None:
        yield from fields.date_faults("/end", body.end)
        if body.end < body.start:
            yield Fault("/end", Reason.OUT_OF_RANGE)
    if body.entry is None and body.transaction is None:
        yield Fault("/entry", Reason.MISSING)
    if body.entry is not None and body.transaction is not None:
        yield Fault("/transaction", Reason.NOT_SUPPORTED)
    if body.transaction is not None and len(body.transaction.postings) > LINES_MAX:
        yield Fault("/transaction/postings", Reason.TOO_MANY)


def _rule_faults(rule: Rule) -> Iterator[Fault]:
    if rule.unit not in set(Unit):
        yield Fault("/rule/unit", Reason.UNKNOWN_VALUE)
        return
    if not 1 <= rule.every <= EVERY_MAX:
        yield Fault("/rule/every", Reason.OUT_OF_RANGE)
    if rule.day is not None:
        if rule.unit not in {Unit.MONTH, Unit.YEAR}:
            yield Fault("/rule/day", Reason.NOT_SUPPORTED)
        elif rule.day not in _DAYS_OF_MONTH:
            yield Fault("/rule/day", Reason.OUT_OF_RANGE)
    if rule.weekday is not None:
        if rule.unit != Unit.WEEK:
            yield Fault("/rule/weekday", Reason.NOT_SUPPORTED)
        elif rule.weekday not in DAYS_OF_WEEK:
            yield Fault("/rule/weekday", Reason.UNKNOWN_VALUE)
