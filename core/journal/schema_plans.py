"""The tables of plans: every budget and every recurring item that was ever said, each beside its event.

A line per event and none is ever changed: what counts in a month is the newest line said for it or for a month before
it, and what a recurring item is now is its newest line. So each belongs to one event and is proven by its number alone. A
table of what counts today was not chosen: last year's budget would be gone with the first change.
"""

from typing import Any, Final

from sqlalchemy import BigInteger, CheckConstraint, Column, ForeignKey, Index, Integer, MetaData, Table, Text

from core.ledger.money import parse_amount
from core.ledger.plans import BudgetSet, PlanEvent, RecurringEnded

TRIGGERS: Final = (
    """CREATE TRIGGER budget_is_never_changed BEFORE UPDATE ON budget
       BEGIN SELECT RAISE(ABORT, 'a budget is never changed, another is said'); END""",
    """CREATE TRIGGER budget_is_never_deleted BEFORE DELETE ON budget
       BEGIN SELECT RAISE(ABORT, 'a budget is never deleted'); END""",
    """CREATE TRIGGER recurring_is_never_changed BEFORE UPDATE ON recurring
       BEGIN SELECT RAISE(ABORT, 'what recurs is never changed, it is said anew'); END""",
    """CREATE TRIGGER recurring_is_never_deleted BEFORE DELETE ON recurring
       BEGIN SELECT RAISE(ABORT, 'what recurs is never deleted'); END""",
)


def budget_table(metadata: MetaData) -> Table:
    """Return the table of budgets, as a part of the ledger's."""
    return Table(
        "budget",
        metadata,
        Column("seq", ForeignKey("event.seq"), primary_key=True),
        Column("account_id", ForeignKey("account.id"), nullable=False),
        Column("month", Text, nullable=False),
        # NULL: nothing is meant any more
        Column("amount", BigInteger().with_variant(Integer, "sqlite"), CheckConstraint("amount >= 0")),
        Index("budget_by_account", "account_id", "month", "seq"),
        sqlite_strict=True,
    )


def recurring_table(metadata: MetaData) -> Table:
    """Return the table of recurring items, as a part of the ledger's."""
    return Table(
        "recurring",
        metadata,
        Column("seq", ForeignKey("event.seq"), primary_key=True),
        Column("id", Text, nullable=False),
        Column("ended", Integer, CheckConstraint("ended IN (0, 1)"), nullable=False),
        Index("recurring_by_id", "id", "seq"),
        sqlite_strict=True,
    )


def budget_row(event: BudgetSet, seq: int) -> dict[str, Any]:
    """Return what is listed for a budget."""
    amount = parse_amount(event.amount, event.currency) if event.amount is not None else None
    assert amount is None or isinstance(amount, int), "a budget was taken whose amount is none"
    return {"seq": seq, "account_id": event.account, "month": event.month, "amount": amount}


def listed_of(event: PlanEvent) -> tuple[Any, ...]:
    """Return what the tables of plans list for an event."""
    if isinstance(event, BudgetSet):
        return (event.account, event.month, budget_row(event, 0)["amount"])
    return (event.id, int(isinstance(event, RecurringEnded)))
