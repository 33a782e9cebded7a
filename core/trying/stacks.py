"""Where a core was when it died or hung: one frame out of what faulthandler has written.

The text is ours up to the names in it, and it may be cut anywhere, because its writer was dying. One frame is named: of
the thread that died, or, where it only hangs, of one that is at work on the book; in it the innermost frame of our own code,
since the line in a library that waits for a lock says nothing of who has it. Pure, and total.
"""

import re
from typing import Final

FRAME_CHARACTERS_MAX: Final = 200
TEXT_CHARACTERS_MAX: Final = 256 << 10
_THREAD: Final = re.compile(r"^(?:Current thread|Thread) 0x")
_CURRENT: Final = "Current thread"
_FRAME: Final = re.compile(r'^ {2}File "(.*)", line (\d+) in (.*)$')
_OWN: Final = re.compile(r"(?:^|/)(core/[A-Za-z0-9_/]+[.]py)$")
_AT_THE_BOOK: Final = "core/journal/"
# Where threads of ours stand when they have nothing to do.
_IDLE: Final = frozenset({"_take", "live"})

_Frame = tuple[str, str, bool]  # function, file:line, ours


def frame_of(text: str, *, hangs: bool) -> str:
    """Return `function (file:line)`, empty where the text names none. `hangs`: nobody has died, all threads are there."""
    threads = _threads(text[:TEXT_CHARACTERS_MAX])
    if hangs:
        threads.sort(key=_rank)
    else:
        threads.sort(key=lambda thread: not thread[0])
    for _, frames in threads:
        if frames:
            function, place, _ = next((frame for frame in frames if frame[2]), frames[0])
            return f"{function} ({place})"[:FRAME_CHARACTERS_MAX]
    return ""


def _threads(text: str) -> list[tuple[bool, list[_Frame]]]:
    """Return the threads of the last dump, each with whether it was the current one, innermost frame first."""
    threads: list[tuple[bool, list[_Frame]]] = []
    for line in text.splitlines():
        if _THREAD.match(line):
            threads.append((line.startswith(_CURRENT), []))
        elif threads and (found := _FRAME.match(line)) is not None:
            threads[-1][1].append(_read(found[1], found[2], found[3]))
    return threads


def _read(path: str, line: str, function: str) -> _Frame:
    own = _OWN.search(path)
    shown = own[1] if own else path.rsplit("/", 1)[-1]  # nothing of where this machine keeps its programs
    printable = "".join(sign if sign.isprintable() else "?" for sign in function)
    return printable, f"{shown}:{line}", own is not None


def _rank(thread: tuple[bool, list[_Frame]]) -> int:
    """Who is likeliest the one that hangs: first whoever is at the book, last whoever waits for work."""
    ours = [(function, place) for function, place, own in thread[1] if own]
    if not ours or ours[0][0] in _IDLE:
        return 2
    return 0 if any(place.startswith(_AT_THE_BOOK) for _, place in ours) else 1
