"""Paths whose requests have killed a gateway twice while it read them: kept in a file, refused for a while.

One death in the middle of a line says little: many lines are being read at any moment. The same line in the hands of two
gateways that died is another matter, so the deaths of the last ten minutes are remembered beside what is refused, where
the next guard finds them too. A path is a hash here (`docs/wires.md` section 18). That each refusal ends by itself
is what makes it bearable to be wrong: who only happened to be there twice is served again after ten minutes.
"""

from datetime import UTC, datetime
from pathlib import Path

import msgspec

from hardcore.host import files

VERSION = 1
#: Two deaths within this time over the same path make it refused, for as long.
WINDOW_S = 600.0
REFUSED_MAX = 64
DEATHS_MAX = 16
#: Paths of one death: as many requests as a gateway's page has places for.
PATHS_MAX = 256
NAME_DIGITS = 16


class Deaths(msgspec.Struct, frozen=True):
    """What is known. Times are of the wall, in seconds: they have to outlive a boot."""

    refused: tuple[tuple[str, float], ...] = ()  # the path and until when
    deaths: tuple[tuple[float, frozenset[str]], ...] = ()  # when, and what was being parsed

    def after(self, parsing: frozenset[str], now_s: float) -> "Deaths":
        """Return what is known after one more death in which these paths were being parsed."""
        recent = tuple(one for one in self.deaths if abs(now_s - one[0]) <= WINDOW_S)
        again = {path for path in parsing for _, before in recent if path in before}
        standing = {path: until for path, until in self.refused if 0 < until - now_s <= WINDOW_S}
        newest = sorted(
            {**standing, **dict.fromkeys(again, now_s + WINDOW_S)}.items(), key=lambda one: one[1]
        )
        seen = (*recent, (now_s, frozenset(sorted(parsing)[:PATHS_MAX]))) if parsing else recent
        return Deaths(tuple(newest[-REFUSED_MAX:]), seen[-DEATHS_MAX:])

    def in_force(self, now_s: float) -> tuple[str, ...]:
        """Return the paths that are refused now."""
        return tuple(path for path, until in self.refused if 0 < until - now_s <= WINDOW_S)


def read(path: Path) -> Deaths:
    """Return what the file tells; what makes no sense is not there."""
    told = files.read_json(path)
    refused, deaths = told.get("refused"), told.get("deaths")
    found = [_refusal(one) for one in refused[:REFUSED_MAX]] if isinstance(refused, list) else []
    seen = [_death(one) for one in deaths[:DEATHS_MAX]] if isinstance(deaths, list) else []
    return Deaths(tuple(one for one in found if one), tuple(one for one in seen if one))


def write(path: Path, known: Deaths) -> None:
    """Keep what is known. Raises OSError as the file system gives it."""
    told = {
        "version": VERSION,
        "refused": [{"hash": name, "until": _wall(until)} for name, until in known.refused],
        "deaths": [{"at": _wall(at), "parsing": sorted(names)} for at, names in known.deaths],
    }
    files.write_json(path, told)


def _refusal(raw: object) -> tuple[str, float] | None:
    match raw:
        case {"hash": str(name), "until": str(until)} if (
            _is_name(name) and (at := _seconds(until)) is not None
        ):
            return name, at
        case _:
            return None


def _death(raw: object) -> tuple[float, frozenset[str]] | None:
    match raw:
        case {"at": str(at), "parsing": list(names)} if (when := _seconds(at)) is not None:
            return when, frozenset(name for name in names[:PATHS_MAX] if _is_name(name))
        case _:
            return None


def _is_name(name: object) -> bool:
    return isinstance(name, str) and len(name) == NAME_DIGITS and set(name) <= set("0123456789abcdef")


def _wall(at_s: float) -> str:
    return datetime.fromtimestamp(at_s, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def _seconds(text: str) -> float | None:
    try:
        return datetime.fromisoformat(text).timestamp()
    except (ValueError, OverflowError):
        return None
