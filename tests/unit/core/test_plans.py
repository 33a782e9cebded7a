"""Plans: what is taken and refused, what a recurring item books, and that the proof holds their tables against the events."""

from pathlib import Path

import pytest

from core.ledger.accounts import Account, AccountType
from core.ledger.book import Book
from core.ledger.budgets import view_budget
from core.ledger.commands import Command, PostTransaction
from core.ledger.decider import decide
from core.ledger.entries import RecordEntry
from core.ledger.events import decode, encode
from core.ledger.planning import key_of, occurrence, set_recurring
from core.ledger.plans import (
    BudgetSet,
    EndRecurring,
    EntryTemplate,
    KnownRecurring,
    RecurringBody,
    RecurringEnded,
    RecurringSet,
    SetBudget,
    SetRecurring,
    TemplateLine,
    TransactionTemplate,
)
from core.ledger.reasons import Rejection, Slug
from core.ledger.recurrence import Rule
from core.web.pages_plans import bar_of
from tests.unit.core.books import opening, pen, tamper
from tests.unit.core.test_verify import verdict

DAY_NS = 86_400_000_000_000
RENT = RecurringBody("Rent", Rule("month"), "2026-01-31", None, EntryTemplate("-5", "KRW", "cash", "rent"))
ITEM = "0199a000-0000-7000-8000-00000000000b"


def book(*, now_ns: int = 0) -> Book:
    made = Book.of(
        [
            Account("cash", "Cash", AccountType.ASSET, "KRW", no_overdraft=False),
            Account("food", "Food", AccountType.EXPENSE, "KRW", no_overdraft=False),
            Account("old", "Old", AccountType.EXPENSE, "KRW", no_overdraft=False, closed=True),
        ]
    )
    made.now_ns = now_ns
    return made


@pytest.mark.parametrize(
    ("command", "slug"),
    [
        (SetBudget("nobody", "2026-01", "1"), Slug.UNKNOWN_ACCOUNT),
        (SetBudget("cash", "2026-01", "1"), Slug.NOT_A_CATEGORY),
        (SetBudget("old", "2026-01", "1"), Slug.ACCOUNT_CLOSED),
        (SetBudget("food", "2026-01", "1.5"), Slug.INVALID_BODY),
        (SetRecurring(ITEM, RENT, is_new=False), Slug.RECURRING_NOT_FOUND),
        (EndRecurring(ITEM), Slug.RECURRING_NOT_FOUND),
    ],
)
def test_a_plan_that_the_book_can_not_take_is_refused(command: Command, slug: Slug) -> None:
    refused = decide(command, book())
    assert isinstance(refused, Rejection)
    assert refused.slug is slug


def test_the_budget_of_a_closed_category_may_still_be_taken_away() -> None:
    assert decide(SetBudget("old", "2026-01", None), book()) == (BudgetSet("old", "2026-01", None, "KRW"),)


def test_a_new_item_makes_up_for_its_days_and_a_changed_one_for_none() -> None:
    assert decide(SetRecurring(ITEM, RENT, is_new=True), book()) == (RecurringSet(ITEM, "2026-01-31", RENT),)
    later = book(now_ns=365 * 60 * DAY_NS)  # 2029-12-17
    later.recurrings[ITEM] = KnownRecurring(1, RecurringSet(ITEM, "2026-01-31", RENT))
    assert decide(SetRecurring(ITEM, RENT, is_new=False), later) == (RecurringSet(ITEM, "2029-12-17", RENT),)
    later.recurrings[ITEM] = KnownRecurring(2, RecurringSet(ITEM, "2026-01-31", RENT), ended=True)
    assert isinstance(ended := decide(EndRecurring(ITEM), later), Rejection)
    assert ended.slug is Slug.RECURRING_ENDED


def test_a_day_is_booked_as_the_household_would_book_it() -> None:
    entry = occurrence(RENT, "2026-02-28", "id")
    assert isinstance(entry, RecordEntry)
    assert (entry.details.date, entry.details.amount, entry.id) == ("2026-02-28", "-5", "id")
    lines = (TemplateLine("cash", "1", "KRW"), TemplateLine("food", "-1", "KRW"))
    plan = RecurringBody("Move", Rule("day"), "2026-01-01", transaction=TransactionTemplate("moved", lines))
    assert isinstance(occurrence(plan, "2026-01-02", "id"), PostTransaction)
    assert key_of(ITEM, "2026-01-02") == f"recurring:{ITEM}:2026-01-02"


def test_a_template_that_does_not_balance_is_refused_with_its_place() -> None:
    lines = (TemplateLine("cash", "1", "KRW"), TemplateLine("food", "-2", "KRW"))
    plan = RecurringBody("Move", Rule("day"), "2026-01-01", transaction=TransactionTemplate("moved", lines))
    refused = set_recurring(plan, ITEM, is_new=True)
    assert isinstance(refused, Rejection)
    assert [fault.pointer for fault in refused.faults] == ["/transaction/postings"]


def test_plans_are_read_as_they_were_written_and_nonsense_is_not() -> None:
    for event in (
        BudgetSet("food", "2026-01", None, "KRW"),
        RecurringSet(ITEM, "2026-01-31", RENT),
        RecurringEnded(ITEM),
    ):
        assert decode(encode(event)) == event
    assert decode(encode(BudgetSet("food", "2026-01", "much", "KRW"))) is None
    assert decode(encode(RecurringSet(ITEM, "soon", RENT))) is None


@pytest.mark.parametrize(
    ("statement", "seq"),
    [
        ("UPDATE budget SET amount = 4", 2),
        ("UPDATE budget SET month = '2026-02'", 2),
        ("DELETE FROM budget", 2),
        ("UPDATE recurring SET id = 'other' WHERE ended = 0", 3),
        ("UPDATE recurring SET ended = 0", 4),
        ("DELETE FROM recurring WHERE ended = 1", 4),
        ("INSERT INTO budget (seq, account_id, month, amount) VALUES (1, 'food', '2026-01', 3)", 1),
        ("INSERT INTO recurring (seq, id, ended) VALUES (2, 'other', 0)", 2),
    ],
)
def test_a_line_of_a_plan_that_its_event_does_not_say_is_found(
    tmp_path: Path, statement: str, seq: int
) -> None:
    with pen(tmp_path) as made:
        made.carry_out(opening("food", AccountType.EXPENSE), SetBudget("food", "2026-01", "3"))
        made.carry_out(SetRecurring(ITEM, RENT, is_new=True), EndRecurring(ITEM))
    assert verdict(tmp_path).ok
    tamper(tmp_path, statement)
    assert verdict(tmp_path).first_bad_seq == seq


@pytest.mark.parametrize(
    ("meant", "moved", "bar"),
    [(0, 0, 0), (0, 5, 100), (0, -5, 0), (10, 0, 0), (10, 5, 50), (10, 15, 100), (10, -5, 0)],
)
def test_a_bar_is_as_long_as_what_was_spent_and_full_where_nothing_was_meant_and_something_spent(
    meant: int, moved: int, bar: int
) -> None:
    food = Account("food", "Food", AccountType.EXPENSE, "KRW", no_overdraft=False)
    assert bar_of(view_budget(food, "Food", meant, "2026-01", moved)) == bar
