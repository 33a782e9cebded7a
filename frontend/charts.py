"""Drawings of a ledger's months: decimal strings become places on paper, nothing else.

Pure: months with their amounts in, numbers for an SVG out. The drawing is for the eye alone; every amount in it stands in
words in the table behind it, so heights may be rounded and amounts never are. Two drawings share the months below them:
what was owned at each month's end as a line between its lowest and its highest point, and what came in and was spent as
two columns from a common ground. A drawing library was not chosen: it would be the largest script of the page, or the
largest import of the core.
"""

from collections.abc import Sequence
from decimal import Decimal
from typing import Final, Protocol

import msgspec

WIDTH: Final = 640
LINE_TOP: Final = 24
LINE_HEIGHT: Final = 86
GROUND: Final = 212  # where the columns stand
COLUMN_HEIGHT: Final = 66
HEIGHT: Final = 240
_COLUMN_WIDTH: Final = 13
_GAP: Final = 3
_LEAST: Final = 2  # what is more than nothing can be seen


class Months(Protocol):
    """What a drawing asks of a month."""

    @property
    def month(self) -> str:
        """Which one, YYYY-MM."""
        ...

    @property
    def income(self) -> str:
        """What came in; below zero where more was given back."""
        ...

    @property
    def expense(self) -> str:
        """What was spent; below zero where more came back."""
        ...

    @property
    def worth(self) -> str:
        """What was owned at its end less what was owed."""
        ...


class Column(msgspec.Struct, frozen=True):
    """A month's pair of columns: the middle between them, their left edges and heights, and the number of the month."""

    middle: int
    income_x: int
    income_height: int
    expense_x: int
    expense_height: int
    width: int
    number: int


class Chart(msgspec.Struct, frozen=True):
    """A drawing: the line's points, the same with the ground beneath it, its last one, and the columns."""

    line: str
    area: str
    last_x: int
    last_y: int
    columns: tuple[Column, ...]


def chart(months: Sequence[Months]) -> Chart:
    """Return the drawing of these months, the oldest first; there is at least one."""
    assert months
    step = WIDTH / len(months)
    middles = [round(step * (at + 0.5)) for at in range(len(months))]
    heights = _between([Decimal(one.worth) for one in months])
    ys = [LINE_TOP + LINE_HEIGHT - height for height in heights]
    line = " ".join(f"{x},{y}" for x, y in zip(middles, ys, strict=True))
    ground = LINE_TOP + LINE_HEIGHT + 12
    return Chart(
        line=line,
        area=f"{middles[0]},{ground} {line} {middles[-1]},{ground}",
        last_x=middles[-1],
        last_y=ys[-1],
        columns=_columns(months, middles),
    )


def _columns(months: Sequence[Months], middles: Sequence[int]) -> tuple[Column, ...]:
    most = max((max(Decimal(one.income), Decimal(one.expense)) for one in months), default=Decimal(0))
    made: list[Column] = []
    for one, middle in zip(months, middles, strict=True):
        made.append(
            Column(
                middle=middle,
                income_x=middle - _COLUMN_WIDTH - _GAP // 2,
                income_height=_height(Decimal(one.income), most),
                expense_x=middle + _GAP - _GAP // 2,
                expense_height=_height(Decimal(one.expense), most),
                width=_COLUMN_WIDTH,
                number=int(one.month[-2:]),
            )
        )
    return tuple(made)


def _between(amounts: Sequence[Decimal]) -> list[int]:
    """Return how far each amount is up from the lowest to the highest; half way where all are the same."""
    least, most = min(amounts), max(amounts)
    if least == most:
        return [LINE_HEIGHT // 2] * len(amounts)
    return [round(LINE_HEIGHT * (one - least) / (most - least)) for one in amounts]


def _height(amount: Decimal, most: Decimal) -> int:
    """Return a column's height; what is below nothing (more came back than was spent) has none."""
    if amount <= 0:
        return 0
    return max(round(COLUMN_HEIGHT * amount / most), _LEAST)
