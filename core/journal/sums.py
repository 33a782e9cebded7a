"""Sums of amounts in SQL, exact whatever the store: in two halves of 32 bits, because a sum would overflow at 64.

A server shifts a number of 64 bits by one of 32 alone, and adds up in decimals; a file does neither.
"""

from typing import Any, Final

from sqlalchemy import Integer, func, literal

_BITS: Final = 32
_MASK: Final = 0xFFFF_FFFF


def halves(amount: Any) -> tuple[Any, Any]:
    """Return the sums of the high and of the low halves of an amount, as columns of these names."""
    high, low = amount.op(">>")(literal(_BITS, Integer)), amount.op("&")(_MASK)
    return func.sum(high).label("high"), func.sum(low).label("low")


def whole(row: Any) -> int:
    """Return the sum that a row tells in halves; of no amounts it is 0."""
    return (int(row.high or 0) << _BITS) + int(row.low or 0)
