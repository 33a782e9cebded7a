"""A JSON object with the line of everything that stands in it, for whoever has to say where a fault is.

The values come from the standard parser, so what is taken here is what is taken everywhere; only where something is
wrong the text is gone through once more, token by token, to find the line of its path. A parser of our own that keeps
lines for all values was not chosen: two parsers would disagree some day about what is JSON.
"""

import json
import re
from collections.abc import Iterator

import msgspec

#: The way to a value: names in objects, numbers (from 0) in lists.
Path = tuple[str | int, ...]

#: No policy of ours is nested deeper than half of this.
DEPTH_MAX = 8

_TOKEN = re.compile(r'"(?:[^"\\]|\\.)*"|[{}\[\]:,]|[^\s{}\[\]:,"]+', re.DOTALL)


class Broken(msgspec.Struct, frozen=True):
    """A text that is no JSON object: where (line 0: the whole), at which name, and why."""

    line: int
    name: str
    reason: str


class Located(msgspec.Struct, frozen=True):
    """The object, and the text that it was read from."""

    values: dict[str, object]
    text: str

    def lines(self) -> dict[Path, int]:
        """Return the line of each name and of each item of a list, by its path."""
        found: dict[Path, int] = {}
        for path, line in _places(self.text):
            found.setdefault(path, line)
        return found


class _TwinError(ValueError):
    """A name stands twice in one object; the argument is the name."""


def parse(text: str) -> Located | Broken:
    """Return the object of `text`; a name that stands twice in one object is a fault, not the last one's luck."""
    if _depth(text) > DEPTH_MAX:  # the way to each value is kept: a deep file would fill the guard's memory
        return Broken(0, "", f"nested more than {DEPTH_MAX} deep")
    try:
        values = json.loads(text, object_pairs_hook=_no_twins)
    except json.JSONDecodeError as error:
        return Broken(error.lineno, "", f"not JSON: {error.msg} at column {error.colno}")
    except _TwinError as twin:
        return Broken(_second(text), str(twin), "stands there twice")
    except (ValueError, RecursionError) as error:
        return Broken(0, "", str(error))
    return Located(values, text) if isinstance(values, dict) else Broken(1, "", "must be a JSON object")


def _depth(text: str) -> int:
    """Return how deep the text is nested, whatever else is wrong with it."""
    deepest = depth = 0
    for token in _TOKEN.finditer(text):
        depth += {"{": 1, "[": 1, "}": -1, "]": -1}.get(token[0], 0)
        deepest = max(deepest, depth)
    return deepest


def nearest(lines: dict[Path, int], path: Path) -> int:
    """Return the line of `path`, or of the nearest thing around it that stands in the text; 0: nothing does."""
    for end in range(len(path), 0, -1):
        if path[:end] in lines:
            return lines[path[:end]]
    return 0


def _no_twins(pairs: list[tuple[str, object]]) -> dict[str, object]:
    seen: dict[str, object] = {}
    for name, value in pairs:
        if name in seen:
            raise _TwinError(name)
        seen[name] = value
    return seen


def _second(text: str) -> int:
    """Return the line of the first name that stands there for the second time."""
    seen: set[Path] = set()
    for path, line in _places(text):
        if path in seen:
            return line
        seen.add(path)
    return 0


def _places(text: str) -> Iterator[tuple[Path, int]]:
    """Go through a text that is JSON; give each name and each item of a list with its line."""
    path: list[str | int] = []
    name_next = False
    line, counted = 1, 0
    for token in _TOKEN.finditer(text):
        line, counted = line + text.count("\n", counted, token.start()), token.start()
        word = token.group()
        in_list = bool(path) and isinstance(path[-1], int)
        if word in {"}", "]"}:
            path.pop()
            name_next = False
        elif word == ",":
            name_next = not in_list
            if in_list:
                path[-1] = int(path[-1]) + 1
        elif name_next and word.startswith('"'):
            path[-1] = str(json.loads(word))
            name_next = False
            yield tuple(path), line
        elif word != ":":
            if in_list:
                yield tuple(path), line
            if word in {"{", "["}:
                path.append("" if word == "{" else 0)
                name_next = word == "{"
