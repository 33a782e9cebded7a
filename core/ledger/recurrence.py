"""Recurrence: the days on which something comes back, from a rule and the day it begins.

Every day of a rule is counted from its beginning and never from the day before, so that the end of January does not
become the 28th for good once February was met, and so that anybody can say at once what falls between two days without
walking there. A month that has no such day means its last one. The rules of calendars (RFC 5545) were not chosen: a
household needs four units and a number, and a page can say those in one sentence.
"""

import calendar
import datetime as dt
from collections.abc import Iterator
from enum import StrEnum
from typing import Final

import msgspec

EVERY_MAX: Final = 1_000
DAYS_OF_WEEK: Final = ("mon", "tue", "wed", "thu", "fri", "sat", "sun")
_WEEK: Final = 7
_YEAR: Final = 12


class Unit(StrEnum):
    """What a rule counts in."""

    DAY = "day"
    WEEK = "week"
    MONTH = "month"
    YEAR = "year"


class Rule(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Every so many days, weeks, months or years.

    `day`: of months and years, the day of the month, the last one where there is none such; absent: that of the
    beginning. `weekday`: of weeks, one of `DAYS_OF_WEEK`; absent: that of the beginning.
    """

    unit: str
    every: int = 1
    day: int | None = None
    weekday: str | None = None


def dates_between(
    rule: Rule, start: dt.date, end: dt.date | None, first: dt.date, last: dt.date
) -> Iterator[dt.date]:
    """Yield the days of a well-formed rule from `first` to `last`, both included, in order.

    Nothing falls before `start` or after `end`.
    """
    low, high = max(start, first), last if end is None else min(end, last)
    turn = max(0, _turn_before(rule, start, low))
    while (day := _day_of(rule, start, turn)) is not None and day <= high:
        if day >= low:
            yield day
        turn += 1


def _turn_before(rule: Rule, start: dt.date, day: dt.date) -> int:
    """Return a turn that falls on or before the first one not before `day`: where to begin looking."""
    if rule.unit in {Unit.DAY, Unit.WEEK}:
        length = rule.every * (_WEEK if rule.unit == Unit.WEEK else 1)
        return (day - start).days // length - 1
    length = rule.every * (_YEAR if rule.unit == Unit.YEAR else 1)
    return ((day.year - start.year) * _YEAR + day.month - start.month) // length - 1


def _day_of(rule: Rule, start: dt.date, turn: int) -> dt.date | None:
    """Return the day of a turn, None where the calendar ends before it."""
    if rule.unit in {Unit.DAY, Unit.WEEK}:
        length = rule.every * (_WEEK if rule.unit == Unit.WEEK else 1)
        try:
            return start + dt.timedelta(days=_days_to_weekday(rule, start) + turn * length)
        except OverflowError:
            return None
    length = rule.every * (_YEAR if rule.unit == Unit.YEAR else 1)
    year, month = divmod(start.year * _YEAR + start.month - 1 + turn * length, _YEAR)
    if year > dt.MAXYEAR:
        return None
    wanted = rule.day if rule.day is not None else start.day
    return dt.date(year, month + 1, min(wanted, calendar.monthrange(year, month + 1)[1]))


def _days_to_weekday(rule: Rule, start: dt.date) -> int:
    if rule.unit != Unit.WEEK or rule.weekday is None:
        return 0
    return (DAYS_OF_WEEK.index(rule.weekday) - start.weekday()) % _WEEK
