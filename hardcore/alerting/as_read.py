"""The book of alerts as it is read: by type, so that one damaged line costs that line and silences nobody.

It lies on a disk between two versions of this program and whatever else writes there. Everything behind this page may
count on the shapes that it gives; what has another shape is not there.
"""

from typing import Any, Final

CHARACTERS_MAX: Final = 2_000
ENTRIES_MAX: Final = 200
INCIDENTS_MAX: Final = 200
ATTEMPTS_MAX: Final = 64
#: Channels that are remembered; who changes an address often leaves the old ones behind.
CHANNELS_MAX: Final = 32
MARKS_MAX: Final = 256
#: Beyond it numbers of one program are not those of another.
NUMBER_MAX: Final = 2**53


def said(value: object) -> str:
    """Return a text that can be written down anywhere; empty where it is none."""
    return value[:CHARACTERS_MAX].encode("utf-8", "replace").decode() if isinstance(value, str) else ""


def number_of(value: object) -> int | None:
    """Return a count or a time, or None."""
    known = isinstance(value, int) and not isinstance(value, bool) and 0 <= value < NUMBER_MAX
    return value if known and isinstance(value, int) else None


def bounded_number(value: object) -> float | None:
    """Return a length of time that was measured, or None: also of one that is none, like NaN."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return float(value) if 0 <= value < NUMBER_MAX else None


def book_of(value: dict[str, Any]) -> dict[str, Any]:
    """Return the book in its shape."""
    channels = (_channel(one) for one in _list(value.get("channels")))
    entries = (_entry(one) for one in _list(value.get("last"))[-ENTRIES_MAX:])
    remembered = list(_object(value.get("memory")).items())[-CHANNELS_MAX:]
    return {
        "version": value.get("version"),
        "serial": number_of(value.get("serial")) or 0,
        "channels": [one for one in channels if one is not None][-CHANNELS_MAX:],
        "last": [one for one in entries if one is not None],
        "told": _texts(value.get("told"), INCIDENTS_MAX),
        "untold": _texts(value.get("untold"), INCIDENTS_MAX),
        "memory": {said(name): _memory(_object(one)) for name, one in remembered},
    }


def _entry(value: object) -> dict[str, Any] | None:
    one = _object(value)
    if not isinstance(one.get("id"), str):
        return None
    tried = (_attempt(each) for each in _list(one.get("attempts"))[-ATTEMPTS_MAX:])
    return {
        **{name: said(one.get(name)) for name in ("id", "at", "stage", "diagnosis")},
        **{name: said(one.get(name)) or None for name in ("incident", "delivered_at", "held", "again_at")},
        "attempts": [each for each in tried if each is not None],
        "spared": _texts(one.get("spared"), CHANNELS_MAX),
    }


def _attempt(value: object) -> dict[str, Any] | None:
    one = _object(value)
    number = number_of(one.get("channel"))
    if number is None:
        return None
    return {"channel": number, **_came(one), "final": one.get("final") is True}


def _channel(value: object) -> dict[str, Any] | None:
    one = _object(value)
    number = number_of(one.get("number"))
    if number is None:
        return None
    return {
        "number": number,
        **{name: said(one.get(name)) for name in ("kind", "name", "place")},
        **_came(one),
        **{name: number_of(one.get(name)) or 0 for name in ("sent", "failed")},
    }


def _came(one: dict[str, Any]) -> dict[str, Any]:
    ok = one.get("ok")
    return {
        "at": said(one.get("at")),
        "ok": ok if isinstance(ok, bool) else None,
        "status": number_of(one.get("status")),
        "why": said(one.get("why")),
    }


def _memory(one: dict[str, Any]) -> dict[str, Any]:
    return {
        "told_ms": _numbers(one.get("told_ms")),
        "left_out": _numbers(one.get("left_out")),
        "incidents": [said(each) for each in _list(one.get("incidents"))[-MARKS_MAX:]],
    }


def _numbers(value: object) -> dict[str, int]:
    found = {said(name): number_of(one) for name, one in list(_object(value).items())[-MARKS_MAX:]}
    return {name: one for name, one in found.items() if one is not None}


def _texts(value: object, most: int) -> dict[str, str]:
    return {
        said(name): said(one) for name, one in list(_object(value).items())[-most:] if isinstance(one, str)
    }


def _list(value: object) -> list[Any]:
    return value if isinstance(value, list) else []


def _object(value: object) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}
