"""The course of a year: what every month of it is told, from sums."""

from pathlib import Path

from core.journal.register import courses_of
from core.ledger.accounts import AccountType
from core.ledger.course import Course, Month, Moved, courses, months_until
from tests.unit.core.books import entering, opening, pen, reversing

MONTHS = ("2026-09", "2026-10", "2026-11")


def test_twelve_months_end_with_the_one_that_is_asked_for() -> None:
    assert months_until("2026-02") == (*(f"2025-{n:02d}" for n in range(3, 13)), "2026-01", "2026-02")


def test_no_month_lies_before_the_first_year() -> None:
    assert months_until("0001-02") == ("0001-01", "0001-02")


def test_what_was_owned_at_the_end_of_a_month_is_what_is_owned_now_less_what_moved_since() -> None:
    moved = [
        Moved("2026-10", AccountType.ASSET, "KRW", 70),
        Moved("2026-10", AccountType.INCOME, "KRW", -100),
        Moved("2026-10", AccountType.EXPENSE, "KRW", 30),
        Moved("2026-11", AccountType.LIABILITY, "KRW", -5),
        Moved("2026-11", AccountType.EXPENSE, "KRW", 5),
        Moved("2027-01", AccountType.ASSET, "KRW", -1_000),  # a day to come
    ]
    told = (
        Month("2026-09", "0", "0", "10"),
        Month("2026-10", "100", "30", "80"),
        Month("2026-11", "0", "5", "75"),
    )
    assert courses(MONTHS, {"KRW": -925}, moved) == (Course("KRW", told),)


def test_a_currency_in_which_nothing_was_earned_or_spent_is_left_out_and_the_busiest_stands_first() -> None:
    moved = [
        Moved("2026-09", AccountType.ASSET, "EUR", 1),
        Moved("2026-09", AccountType.EXPENSE, "KRW", 1),
        Moved("2026-09", AccountType.EXPENSE, "USD", 1),
        Moved("2026-10", AccountType.EXPENSE, "USD", 1),
    ]
    assert [one.currency for one in courses(MONTHS, {}, moved)] == ["USD", "KRW"]


def test_the_course_of_a_book_counts_what_stands(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        made.carry_out(opening("bank"))
        gone = entering("-7", date="2026-10-02")
        made.carry_out(
            entering("-300", date="2026-08-31"),
            entering("1000", date="2026-10-01"),
            gone,
            entering("-250", date="2026-11-30"),
        )
        made.carry_out(reversing(gone.id))
        (found,) = courses_of(made.connection, MONTHS)
    assert found.months == (
        Month("2026-09", "0", "0", "-300"),
        Month("2026-10", "1000", "0", "700"),
        Month("2026-11", "0", "250", "450"),
    )
