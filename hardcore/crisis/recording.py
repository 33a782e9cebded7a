"""The gateway's own page, from the side that writes it: beats, and a place for each request from its first byte on.

What is stored here is what a guard finds after a death that came in the middle of a line: which paths were being
parsed, and how long nothing had moved. A store is one word into mapped memory, so a request costs some microseconds
of it, and nothing here can fail or wait; where all places are taken a request has none, and is served all the same.
Noting only what goes wrong was not chosen: whatever kills a parser leaves no time to note it.
"""

import asyncio
import gc
import hashlib
import mmap
import os
import sys
import threading
import time
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from time import monotonic_ns

from hardcore.crisis.holding import Life
from hardcore.host import gateway_page as page
from hardcore.host.files import read_json
from hardcore.model.gateway import Stage

BEAT_S = 0.1
#: Names of paths that are remembered; beyond them all are worked out anew. A path that is longer than any of ours is
#: each time: its length is its client's choice.
NAMES_MAX, NAMED_BYTES_MAX = 1024, 256
#: Paths that may be refused at one time (`docs/wires.md` section 18).
REFUSED_MAX = 64

# Once for each request and more: what is looked up here is not looked up there.
_BEGUN, _OVER, _SINCE_NS, _PATH_HASH = page.BEGUN, page.OVER, page.SINCE_NS, page.PATH_HASH
_BYTES_READ, _CONNECTION = page.BYTES_READ, page.CONNECTION
_FREE, _PARSING, _HELD = int(Stage.FREE), int(Stage.PARSING), int(Stage.HELD)

#: Where a request stands in the gateway, by its life.
STAGES: Mapping[Life, int] = {
    Life.ARRIVED: int(Stage.PARSING),
    Life.HELD: int(Stage.HELD),
    Life.FORWARDED: int(Stage.FORWARDED),
    Life.ANSWERING: int(Stage.ANSWERING),
    Life.LOST: int(Stage.HELD),
    Life.ASKED: int(Stage.FORWARDED),
    Life.ON_TRIAL: int(Stage.HELD),
    Life.KEEPING: int(Stage.HELD),
    Life.KEEPING_LOST: int(Stage.HELD),
    Life.ANSWERED: int(Stage.ANSWERING),
    Life.GONE: int(Stage.ANSWERING),
}


class Place:
    """Where one request stands on the page. After `leave` nothing it is told reaches the page any more."""

    __slots__ = ("_book", "_first", "_open", "_words")

    def __init__(
        self, book: "Recording", words: "memoryview[int]", first: int, *, counts: bool = True
    ) -> None:
        self._book = book
        self._words = words
        self._first = first  # the first word of its slot; 0: it has none
        self._open = counts  # and has not left yet

    def named(self, path_hash: int) -> None:
        """Its path is known, so far."""
        if self._first:
            self._words[self._first + _PATH_HASH] = path_hash

    def heard(self, size_bytes: int) -> None:
        """So many bytes more have come that hold (a part of) it."""
        if self._first:
            self._words[self._first + _BYTES_READ] += size_bytes

    def stands(self, stage: int) -> None:
        """It has gone on, to one of `STAGES`."""
        first = self._first
        if first:
            self._words[first + _SINCE_NS] = monotonic_ns()
            self._words[first] = stage

    def passed_on(self) -> None:
        """It is whole and has been taken in: if it is not answered by now, somebody else has it."""
        if self._first and self._words[self._first] == _PARSING:
            self.stands(_HELD)

    def overdue(self) -> None:
        """Its core has not answered in time, and its client is told 504."""
        self._words[page.OVERDUE] += 1
        self._words[page.OVERDUE_NS] = monotonic_ns()

    def leave(self) -> None:
        """It is over, or its connection is. Saying it twice is no fault."""
        if self._open:
            first, self._open, self._first = self._first, False, 0
            self._book.left(first)


class Recording:
    """Writes the page. All but the thread's beat is done on the loop's thread."""

    def __init__(self, words: "memoryview[int]", refused: Mapping[int, int] | None = None) -> None:
        #: Paths that are refused, with the monotonic time until then.
        self.refused: Mapping[int, int] = refused or {}
        #: Of a connection on which nothing has come yet.
        self.no_place = Place(self, words, 0, counts=False)
        self._words = words
        self._free = [page.FIRST_SLOT + page.SLOT_WORDS * slot for slot in reversed(range(page.SLOTS))]
        self._names: dict[bytes, int] = {}
        self._begun = self._over = self._connections = 0
        self._beats = 0

    def begin(self, loop: asyncio.AbstractEventLoop) -> None:
        """Say who we are, and beat from now on: on the loop, and on a thread beside it."""
        words, pid = self._words, os.getpid()
        words[page.LOOP_THREAD] = threading.get_native_id()
        words[page.START] = _own_start()
        words[page.THREAD_NS] = monotonic_ns()
        self._beat(loop)
        words[page.PID] = pid  # last: from here on the page is ours
        gc.callbacks.append(self._collects)
        threading.Thread(target=self._beat_on, name="gateway-beat", daemon=True).start()

    def _collects(self, phase: str, _info: Mapping[str, int]) -> None:
        self._words[page.GC_SINCE_NS] = monotonic_ns() if phase == "start" else 0

    def _beat(self, loop: asyncio.AbstractEventLoop) -> None:
        self._beats += 1
        self._words[page.LOOP_NS] = monotonic_ns()
        self._words[page.LOOP_COUNT] = self._beats
        loop.call_later(BEAT_S, self._beat, loop)

    def _beat_on(self) -> None:
        self._words[page.BEAT_THREAD] = threading.get_native_id()
        while True:
            time.sleep(BEAT_S)
            self._words[page.THREAD_NS] = monotonic_ns()

    # -- requests --------------------------------------------------------------------------------------

    def connection(self) -> int:
        """Return the number of a new connection."""
        self._connections += 1
        return self._connections

    def take(self, connection: int) -> Place:
        """Return a place for a request whose first byte is being parsed."""
        self._begun += 1
        words = self._words
        words[_BEGUN] = self._begun
        if not self._free:
            return Place(self, words, 0)
        first = self._free.pop()
        words[first + _SINCE_NS] = monotonic_ns()
        words[first + _PATH_HASH] = 0
        words[first + _BYTES_READ] = 0
        words[first + _CONNECTION] = connection
        words[first] = _PARSING
        return Place(self, words, first)

    def left(self, first: int) -> None:
        """The request that stood at word `first` is over; 0: it had no place."""
        self._over += 1
        self._words[_OVER] = self._over
        if first:
            self._words[first] = _FREE
            self._free.append(first)

    def name_of(self, method: bytes, target: bytes) -> int:
        """Return the word by which the path of a request goes: of its method and its target without the query."""
        path = target.partition(b"?")[0]
        said = method + b" " + path
        name = self._names.get(said)
        if name is None:
            if len(self._names) >= NAMES_MAX:
                self._names.clear()
            name = word_of(hashlib.sha256(said).digest()[:8])
            if len(said) <= NAMED_BYTES_MAX:
                self._names[said] = name
        return name

    def refuses(self, name: int) -> bool:
        """Whether a path is refused now; one that is counts."""
        if self.refused.get(name, 0) <= monotonic_ns():
            return False
        self._words[page.REFUSED] += 1
        return True


def _own_start() -> int:
    """Return when this process started, as the kernel counts it: field 22 of its `stat`."""
    return int(Path("/proc/self/stat").read_text("utf-8", "replace").rpartition(")")[2].split()[19])


def word_of(name: bytes) -> int:
    """Return eight bytes as the word that stores them in their order."""
    return int.from_bytes(name, sys.byteorder)


def blank() -> Recording:
    """Return a recording that nobody reads."""
    return Recording(memoryview(bytearray(page.FILE_BYTES)).cast("Q"))


#: For whoever is given none.
NOBODYS = blank()


def record_on(path: Path | None, refused: Path | None) -> Recording:
    """Return the recording on the page at `path`, with the paths that the file `refused` names.

    Raises OSError when there is a path and no page.
    """
    if path is None:
        return blank()
    fd = os.open(path, os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW)
    try:
        if os.fstat(fd).st_size != page.FILE_BYTES:
            raise OSError("it is not a page of this version")
        mapped = mmap.mmap(fd, page.FILE_BYTES)
    finally:
        os.close(fd)
    words = memoryview(mapped).cast("Q")
    if words[page.PID]:
        raise OSError("it belongs to another process")
    return Recording(words, _read_refused(refused) if refused else {})


def _read_refused(path: Path) -> dict[int, int]:
    """Return the refused paths with the monotonic time until then. What makes no sense refuses nobody."""
    told = read_json(path).get("refused")
    found: dict[int, int] = {}
    for one in told[:REFUSED_MAX] if isinstance(told, list) else ():
        match one:
            case {"hash": str(name), "until": str(until)}:
                try:
                    left_ns = int((datetime.fromisoformat(until).timestamp() - time.time()) * 1e9)
                    found[word_of(bytes.fromhex(name))] = monotonic_ns() + left_ns
                except (ValueError, OverflowError):
                    continue
            case _:
                continue
    return found
