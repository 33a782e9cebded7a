"""What grows, and what will run out: the guard's word about it, as a curve, as sentences, and as rows of a table.

Nothing is reckoned here. Where the guard says of a resource that it does not grow, it is not shown as growing by a
hair; and where no guard answers there is no curve, because the archive keeps none.
"""

from collections.abc import Mapping
from typing import Any, Final

import msgspec

from frontend.admin_paper import moment
from frontend.render import Language
from postmortem.incident import mappings, number, optional_text, text
from postmortem.reports.drawings import Drawing, draw_course

#: Points of one resource: an hour of minutes, six hours of fives, two days of half hours.
POINTS_MAX: Final = 300
FORECASTS_MAX: Final = 6
#: The resources that are bytes, and all that have a name.
_BYTES: Final = frozenset({"memory", "disk"})
_NAMED: Final = frozenset({"memory", "fds", "threads", "queue", "disk", "errors"})


class Growing(msgspec.Struct, frozen=True):
    """A resource that grows, in words. `due`: when it reaches its limit; None: later than anybody can tell."""

    name: str
    level: str
    limit: str
    rate: str
    due: str | None


def memory_curve(answer: Mapping[str, Any] | None, lang: Language) -> Drawing | None:
    """Return the curve of the core's memory with its limit; None: too little is known."""
    for one in mappings((answer or {}).get("resources")):
        if one.get("resource") == "memory":
            points = [at for at in map(_point, _list(one.get("points"))[-POINTS_MAX:]) if at is not None]
            limit = _amount(one.get("limit"))
            return draw_course(points, None if limit is None else int(limit), lang)
    return None


def forecasts(words: Any, status: Mapping[str, Any], lang: Language) -> list[str]:
    """Return a sentence for each thing that will run out, the soonest first."""
    told = []
    for one in mappings(status.get("forecasts"))[:FORECASTS_MAX]:
        kind, rate = text(one.get("resource")), _amount(one.get("per_hour"))
        if kind not in _NAMED or rate is None:
            continue
        name = words(f"resource_{kind}")
        if rate <= 0:
            told.append(str(words("forecast_much", resource=name)))
            continue
        at = moment(optional_text(one.get("due")), lang=lang)
        told.append(str(words("forecast_due", resource=name, at=at, rate=_told(kind, rate))))
    return told


def growing(words: Any, answer: Mapping[str, Any] | None) -> list[Growing] | None:
    """Return what grows; empty: nothing does; None: no guard answers."""
    if answer is None:
        return None
    found = []
    for one in mappings(answer.get("resources")):
        kind, rate = text(one.get("resource")), _amount(one.get("per_hour"))
        level, limit = _amount(one.get("level")), _amount(one.get("limit"))
        if kind in _NAMED and rate is not None and level is not None and limit is not None:
            row = (words(f"resource_{kind}"), _told(kind, level), _told(kind, limit), _told(kind, rate))
            found.append(Growing(*row, due=optional_text(one.get("due"))))
    return found


def _told(kind: str, amount: float) -> str:
    if kind in _BYTES:
        return f"{amount / (1 << 20):.1f} MiB" if amount < 10 << 20 else f"{amount / (1 << 20):.0f} MiB"
    return f"{amount:.1f}" if amount < 10 and amount % 1 else f"{amount:.0f}"


def _amount(value: object) -> float | None:
    whole = isinstance(value, int | float) and not isinstance(value, bool) and value - value == 0
    return float(value) if whole and isinstance(value, int | float) else None


def _point(value: object) -> tuple[float, int] | None:
    row = _list(value)
    if len(row) != 3:
        return None
    at_s, low = _amount(row[0]), number(row[1])
    return None if at_s is None or low is None else (at_s, low)


def _list(value: object) -> list[Any]:
    return value if isinstance(value, list) else []
