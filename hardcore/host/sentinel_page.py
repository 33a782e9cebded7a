"""The sentinel's own beat, for whoever watches it: one small page in the run folder.

Two beats as in a core's page, for the same reason: the loop's comes from the loop that decides, the thread's from a
thread that needs nothing but the interpreter, and only the pair tells a guard that may not run from one that hangs in
one place. Each word is stored in one go through a mapping of eight-byte words, so that a reader never meets half of one.
The page carries who beats: a reader compares that with whom it means. Not chosen: a heartbeat over a socket, which would
need the reader's patience for the writer's, and leaves nothing for a successor to read.
"""

import mmap
import os
import struct
import threading
from pathlib import Path

import msgspec

from hardcore.host import clock, files

MAGIC = b"HCSENT01"
SIZE = 256
NONCE_BYTES_MAX = 32
#: The last words of a guard that ends itself for a drill, in the run folder.
LAST_WORDS = "sentinel-drill.json"
#: How often the thread beats; the loop beats with each look at the core, ten times a second.
THREAD_BEAT_S = 0.1

_HEAD = struct.Struct("<8s7Q32s")
_LOOP_NS, _LOOP_COUNT, _THREAD_NS = 40 >> 3, 48 >> 3, 56 >> 3


class SentinelBeat(msgspec.Struct, frozen=True):
    """What a page says. Times are monotonic; 0: never yet."""

    generation: int
    pid: int
    start: int
    began_ns: int
    loop_ns: int
    loop_count: int
    thread_ns: int
    nonce: str

    @property
    def last_ns(self) -> int:
        """When it was last seen alive."""
        return max(self.began_ns, self.loop_ns, self.thread_ns)


def read_page(path: Path) -> SentinelBeat | None:
    """Return what the page at `path` says; None: there is none, or it is none of ours."""
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD.size)
    except OSError:
        return None
    if len(head) < _HEAD.size:
        return None
    magic, generation, pid, start, began_ns, loop_ns, loop_count, thread_ns, nonce = _HEAD.unpack(head)
    if magic != MAGIC:
        return None
    name = nonce.rstrip(b"\0").decode("ascii", "replace")
    return SentinelBeat(generation, pid, start, began_ns, loop_ns, loop_count, thread_ns, name)


class SentinelPage:
    """The page of this process. A run folder that takes none leaves it without: then it beats into memory alone."""

    def __init__(self, path: Path, generation: int, start: int, nonce: str) -> None:
        self.fault = ""
        head = _HEAD.pack(
            MAGIC, generation, os.getpid(), start, clock.now_ns(), 0, 0, 0,
            nonce.encode("ascii")[:NONCE_BYTES_MAX],
        )  # fmt: skip
        self._memory = mmap.mmap(-1, SIZE)
        try:
            files.write_whole(path, head.ljust(SIZE, b"\0"), durable=False)
            with path.open("r+b") as file:
                self._memory = mmap.mmap(file.fileno(), SIZE)
        except OSError as error:
            self.fault = error.strerror or "it can't be written"
        self._words = memoryview(self._memory).cast("Q")
        self._count = 0
        threading.Thread(target=self._beat_on, name="beat", daemon=True).start()

    def beat(self) -> None:
        """Say that the loop decides. Loop thread only."""
        self._count += 1
        self._words[_LOOP_NS] = clock.now_ns()
        self._words[_LOOP_COUNT] = self._count

    def _beat_on(self) -> None:
        pause = threading.Event()
        while True:
            self._words[_THREAD_NS] = clock.now_ns()
            pause.wait(THREAD_BEAT_S)
