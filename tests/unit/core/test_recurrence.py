"""Recurrence: which days a rule means."""

import datetime as dt

import pytest

from core.ledger.recurrence import Rule, dates_between


def days(rule: Rule, start: str, first: str, last: str, end: str | None = None) -> list[str]:
    """Return the days of a rule between two days, as texts."""
    day = dt.date.fromisoformat
    until = day(end) if end is not None else None
    return [found.isoformat() for found in dates_between(rule, day(start), until, day(first), day(last))]


@pytest.mark.parametrize(
    ("rule", "start", "first", "last", "expected"),
    [
        (Rule("day", 3), "2026-01-01", "2026-01-03", "2026-01-10", ["2026-01-04", "2026-01-07", "2026-01-10"]),
        (Rule("week"), "2026-11-23", "2026-11-24", "2026-12-07", ["2026-11-30", "2026-12-07"]),
        (Rule("week", 2, weekday="fri"), "2026-11-23", "2026-01-01", "2026-12-12", ["2026-11-27", "2026-12-11"]),
        (Rule("week", weekday="mon"), "2026-11-23", "2026-11-23", "2026-11-23", ["2026-11-23"]),
        (Rule("month", 3, day=15), "2026-01-20", "2026-01-01", "2026-08-01", ["2026-04-15", "2026-07-15"]),
        (Rule("year"), "2024-02-29", "2025-01-01", "2028-12-31",
         ["2025-02-28", "2026-02-28", "2027-02-28", "2028-02-29"]),
        (Rule("day", 1000), "9999-01-01", "9999-01-01", "9999-12-31", ["9999-01-01"]),
        (Rule("year", 1000), "9000-01-01", "9999-01-01", "9999-12-31", []),
    ],
)  # fmt: skip
def test_a_rule_means_the_days_counted_from_its_beginning(
    rule: Rule, start: str, first: str, last: str, expected: list[str]
) -> None:
    assert days(rule, start, first, last) == expected


def test_day_31_is_the_last_day_of_a_month_that_has_none_and_comes_back_after_it() -> None:
    found = days(Rule("month"), "2026-01-31", "2026-01-01", "2026-05-31")
    assert found == ["2026-01-31", "2026-02-28", "2026-03-31", "2026-04-30", "2026-05-31"]


def test_nothing_comes_before_the_beginning_or_after_the_end() -> None:
    assert days(Rule("month", day=1), "2026-03-02", "2026-01-01", "2026-12-31", "2026-05-01") == [
        "2026-04-01",
        "2026-05-01",
    ]


def test_any_window_shows_what_the_whole_shows_there() -> None:
    for rule in (Rule("day", 9), Rule("week", 3, weekday="sun"), Rule("month", 5, day=31), Rule("year", 2)):
        whole = days(rule, "2020-02-29", "2020-01-01", "2031-12-31")
        for year in range(2020, 2032):
            first, last = f"{year}-02-28", f"{year}-11-30"
            assert days(rule, "2020-02-29", first, last) == [day for day in whole if first <= day <= last]
