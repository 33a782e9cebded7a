"""What the guard's flight recording tells of the machine: memory over time, late looks, the policy in force.

The recording is the guard's own format and made to be played back, not to be read; three numbers of it are worth
having in a report, so this looks for those and for nothing else, line by line, and passes over whatever it does not
know. To play it back here was not chosen: the investigators know none of the guard's code, and a recording of another
version still has its numbers.
"""

import json
import re
from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any

import msgspec

from postmortem.incident import mapping, number, optional_text

#: A longer line is passed over; a look under full load has some tens of KiB.
LINE_CHARS_MAX = 512 << 10
LINES_MAX = 20_000
#: Looks come every 100 ms; one that comes this much later was late.
LATE_NS = 200_000_000

#: The words under which the state keeps what memory did over time.
_TRACKED, _MEMORY = "foresight", "Resource.MEMORY"
#: Of a course so many points are kept.
POINTS_MAX = 300

_SAMPLED, _SPAWNED = '{"fact":{"Sampled":', '{"fact":{"CoreSpawned":'
#: What the guard allows a core, as the state at the beginning of the recording has it.
_ALLOWED = re.compile(r'"memory_bytes":(\d{1,18})\b')


class Look(msgspec.Struct, frozen=True):
    """One look at a core: monotonic ns, which life, and its resident memory in bytes."""

    at_ns: int
    life: int
    rss_bytes: int


class Tape(msgspec.Struct, frozen=True):
    """What was found. `late_ns`: how long each late look had been waited for; `lives`: which life had which pid.

    `course`: the memory of the hours before, (seconds before the recording began, lowest bytes of a stretch).
    """

    looks: tuple[Look, ...] = ()
    late_ns: tuple[int, ...] = ()
    policy_sha256: str | None = None
    memory_limit_bytes: int | None = None
    lives: Mapping[int, int] = msgspec.field(default_factory=dict)
    course: tuple[tuple[float, int], ...] = ()


def read_tape(recording: str) -> Tape:
    """Return what a recording tells, of whatever it holds."""
    lines = recording.splitlines()[:LINES_MAX]
    head = _parsed(lines[0]) if lines else {}
    looks = tuple(_looks(lines))
    ages = pairwise(looks)
    gaps = (after.at_ns - before.at_ns for before, after in ages if after.life == before.life)
    return Tape(
        looks=looks,
        late_ns=tuple(gap for gap in gaps if gap > LATE_NS),
        policy_sha256=optional_text(head.get("policy_sha256")),
        memory_limit_bytes=_memory_limit(lines[0]) if lines else None,
        lives=dict(_lives(lines)),
        course=_course(head),
    )


def curve(tape: Tape, pid: int | None) -> tuple[tuple[float, int], ...]:
    """Return the memory of the life with this pid: (seconds before its last look, bytes). Empty: nobody looked."""
    life = tape.lives.get(pid) if pid is not None else None
    alive = [
        look for look in tape.looks if look.life == life and look.rss_bytes > 0
    ]  # what has ended holds nothing
    return tuple(((look.at_ns - alive[-1].at_ns) / 1e9, look.rss_bytes) for look in alive)


def _looks(lines: list[str]) -> Iterator[Look]:
    for line in lines:
        if not line.startswith(_SAMPLED):
            continue
        sampled = mapping(mapping(_parsed(line).get("fact")).get("Sampled"))
        process = mapping(mapping(sampled.get("process")).get("ProcessSample"))
        at_ns, rss_bytes = number(sampled.get("at_ns")), number(process.get("rss_bytes"))
        if at_ns is not None and rss_bytes is not None:
            yield Look(at_ns, number(sampled.get("life")) or 0, rss_bytes)


def _lives(lines: list[str]) -> Iterator[tuple[int, int]]:
    for line in lines:
        if line.startswith(_SPAWNED):
            spawned = mapping(mapping(_parsed(line).get("fact")).get("CoreSpawned"))
            pid, life = number(spawned.get("pid")), number(spawned.get("life"))
            if pid is not None and life is not None:
                yield pid, life


def _course(head: Mapping[str, Any]) -> tuple[tuple[float, int], ...]:
    """Return what memory did before the recording, of the state at its beginning; empty: it tells nothing of that."""
    state = _map(head.get("state"))
    foresight = mapping(mapping(state.get(_TRACKED)).get("Foresight"))
    track = mapping(mapping(_map(foresight.get("tracks")).get(_MEMORY)).get("Track"))
    scales = track.get("scales")
    step_ns = number(track.get("step_ns")) or 0
    first = mapping(mapping(scales[0]).get("Scale")) if isinstance(scales, list) and scales else {}
    numbers, lows = (_row(mapping(first.get(name)).get("$deque")) for name in ("numbers", "lows"))
    if step_ns <= 0 or not numbers or len(numbers) != len(lows):
        return ()
    last = numbers[-1]
    return tuple(((at - last) * step_ns / 1e9, low) for at, low in zip(numbers, lows, strict=True))


def _map(value: object) -> Mapping[str, Any]:
    """Return a collection of the guard's codec by its keys: texts, or the names of its words."""
    found: dict[str, Any] = {}
    rows = mapping(value).get("$map")
    for row in rows if isinstance(rows, list) else []:
        if isinstance(row, list) and len(row) == 2:
            key = row[0] if isinstance(row[0], str) else mapping(row[0]).get("$enum")
            if isinstance(key, str):
                found[key] = row[1]
    return found


def _row(value: object) -> list[int]:
    row = value[-POINTS_MAX:] if isinstance(value, list) else []
    return [one for one in row if isinstance(one, int) and not isinstance(one, bool)]


def _memory_limit(head: str) -> int | None:
    allowed = _ALLOWED.search(head[:LINE_CHARS_MAX])
    return int(allowed[1]) or None if allowed else None


def _parsed(line: str) -> Mapping[str, Any]:
    if len(line) > LINE_CHARS_MAX:
        return {}
    try:
        return mapping(json.loads(line))
    except (ValueError, RecursionError):
        return {}
