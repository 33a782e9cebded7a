"""Days and months as people write them, in Korean and in English, from the ledger's YYYY-MM-DD.

Pure words: what day it is today is told by whoever asks. The year is left out where it is the reader's own, as
on any paper ledger. `strftime` was not chosen, because its names depend on the locale of the machine.
"""

import datetime as dt
from typing import Final

from frontend.render import Language

_WEEKDAYS: Final = {
    "ko": ("월", "화", "수", "목", "금", "토", "일"),
    "en": ("Mon", "Tue", "Wed", "Thu", "Fri", "Sat", "Sun"),
}
_MONTHS: Final = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")
_MONTHS_LONG: Final = (
    "January", "February", "March", "April", "May", "June",
    "July", "August", "September", "October", "November", "December",
)  # fmt: skip


def show_day(day: str, lang: Language, today: dt.date) -> str:
    """Return a day (YYYY-MM-DD) with its weekday; the year only where it is not this one."""
    at = dt.date.fromisoformat(day)
    weekday = _WEEKDAYS[lang][at.weekday()]
    if lang == "ko":
        year = "" if at.year == today.year else f"{at.year}년 "
        return f"{year}{at.month}월 {at.day}일 {weekday}요일"
    year = "" if at.year == today.year else f" {at.year}"
    return f"{weekday}, {_MONTHS[at.month - 1]} {at.day}{year}"


def show_month(month: str, lang: Language) -> str:
    """Return a month (YYYY-MM) with its year."""
    year, number = month.split("-")
    if lang == "ko":
        return f"{int(year)}년 {int(number)}월"
    return f"{_MONTHS_LONG[int(number) - 1]} {int(year)}"


def month_beside(month: str, step: int) -> str:
    """Return the month `step` months after this one (YYYY-MM); years stay within the calendar."""
    year, number = (int(part) for part in month.split("-"))
    at = min(max(year * 12 + number - 1 + step, 12), 9999 * 12 + 11)
    return f"{at // 12:04d}-{at % 12 + 1:02d}"
