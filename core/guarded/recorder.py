"""The flight recorder: what this core is doing, kept where a reader still finds it after any death.

Every command is noted in a shared memory page before it runs and its stage is stored at each step, so
that SIGKILL, the OOM killer and `os._exit` leave the same evidence as an exception would. The page is a
file that the guard made and only reads. Entries of several words are under a sequence lock and a CRC;
what changes often (beats, stages, counters) is one aligned 8-byte store each and needs neither. Not
chosen: `struct.pack_into`, which zeroes its target first and showed readers zeros that nobody wrote; a
log file, which costs a system call per line and is torn where it matters; a second class for a core
without a guard: the same one on private memory can't go out of step.
"""

import mmap
import os
import time
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from struct import Struct

import msgspec

from core.guarded import page
from core.guarded.commands import CommandTable, Stage
from core.guarded.components import Components
from core.guarded.locks import NamedLock
from core.guarded.pulse import LifeState, Pulse

__all__ = ["FlightRecorder", "LifeState", "NoRecorder", "Recorder", "RecorderUnusable", "Stage"]


class RecorderUnusable(msgspec.Struct, frozen=True):
    """The page can't be written to; `reason` is a sentence with the file's name in it."""

    reason: str


_EVENT_TEXTS = Struct("32s64s")
_LAST_WORDS_TEXTS = Struct("40s960s")
_TYPE = Struct("<48sQQ")


class Recorder(CommandTable, Components, Pulse):
    """The recorder of this process: commands, components, pulse and all that is said once, on one page."""

    def __init__(self, memory: mmap.mmap, clock: Callable[[], int] = time.monotonic_ns) -> None:
        """Take the page over, on the thread of the event loop. `Recorder.open` maps one."""
        assert len(memory) == page.FILE_BYTES, "open() lets no other size through"
        self._memory = memory
        view = memoryview(memory)
        words = view.cast("Q")
        CommandTable.__init__(self, view, words, clock)
        Components.__init__(self, view, words, clock)
        Pulse.__init__(self, words, clock)
        self._witnessed = 0
        self._events = 0
        self._censuses = 0
        self._spoken = False
        self._closed = False
        self._ring_lock = NamedLock("recorder.ring")

    @classmethod
    def open(cls, path: Path, clock: Callable[[], int] = time.monotonic_ns) -> "Recorder | RecorderUnusable":
        """Map the page at `path`, or say why not. Never creates, truncates or resizes it."""
        try:
            fd = os.open(path, os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW)
        except OSError as error:
            return RecorderUnusable(f"The recorder page {path} could not be opened: {error.strerror}.")
        try:
            if os.fstat(fd).st_size != page.FILE_BYTES:
                return RecorderUnusable(f"The recorder page {path} is not {page.FILE_BYTES} bytes long.")
            memory = mmap.mmap(fd, page.FILE_BYTES)
        except OSError as error:
            return RecorderUnusable(f"The recorder page {path} could not be mapped: {error.strerror}.")
        finally:
            os.close(fd)
        if (fault := _fault(memory)) is not None:
            memory.close()
            return RecorderUnusable(f"The recorder page {path} {fault}.")
        return cls(memory, clock)

    def witness(self, seq: int, epoch: int, hash: bytes) -> None:  # noqa: A002  the wire's own word
        """Keep the last commit (32 bytes of hash): after COMMIT, before the first answer. Writer thread only."""
        assert len(hash) == page.HASH_BYTES, "the ledger's hashes are SHA-256"
        # Two places in turn: a death in the middle of this store leaves the one before it whole.
        at = page.WITNESS_AT + (self._witnessed % 2) * page.WITNESS_BYTES
        word = at >> 3
        words, view = self._words, self._bytes
        lock = words[word]
        words[word] = lock + 1
        words[word + 1] = seq
        words[word + 2] = epoch
        words[word + 3] = self._clock()
        view[at + 32 : at + 64] = hash
        words[word + 8] = zlib.crc32(view[at + 8 : at + 64])
        words[word] = lock + 2
        self._witnessed += 1

    def event(self, code: str, text: str) -> None:
        """Add a line to the ring of events: 32 bytes of code, 64 of text. Any thread, not in a signal handler."""
        texts = _EVENT_TEXTS.pack(
            page.cut(code, page.EVENT_CODE_BYTES_MAX), page.cut(text, page.EVENT_TEXT_BYTES_MAX)
        )
        with self._ring_lock:
            if self._closed:
                return
            at = page.EVENTS_AT + (self._events % page.EVENTS) * page.EVENT_BYTES
            self._events += 1
            self._store(at, at + page.EVENT_BYTES, (self._clock(), self._events), texts)

    def last_words(self, code: str, text: str) -> None:
        """Say why this process is about to leave: 40 bytes of code, 960 of text.

        The first to speak names the cause and is kept; who speaks later tells of consequences, which
        stand in the ring of events alone. Any thread.
        """
        self.event(code, text)
        texts = _LAST_WORDS_TEXTS.pack(
            page.cut(code, page.CODE_BYTES_MAX), page.cut(text, page.WORDS_TEXT_BYTES_MAX)
        )
        with self._ring_lock:
            if self._spoken or self._closed:
                return
            self._spoken = True
            self._store(page.WORDS_AT, page.WORDS_AT + page.WORDS_BYTES, (self._clock(),), texts)

    def census(
        self,
        rss_bytes: int,
        objects: int,
        examined: int,
        took_ns: int,
        types: Sequence[tuple[str, int, int]],
    ) -> None:
        """Keep a census beside the one before it: `types` are name, count and bytes, the largest 20 of them.

        `examined` of `objects` were looked at, and the numbers of `types` are scaled accordingly. Any thread.
        """
        largest = types[: page.CENSUS_TYPES]
        texts = b"".join(
            _TYPE.pack(page.cut(name, page.TYPE_NAME_BYTES_MAX), count, size_bytes)
            for name, count, size_bytes in largest
        ).ljust(page.CENSUS_TYPES * page.CENSUS_TYPE_BYTES, b"\0")
        with self._ring_lock:
            if self._closed:
                return
            at = page.CENSUS_AT + (self._censuses % page.CENSUSES) * page.CENSUS_BYTES
            self._censuses += 1
            numbers = (self._clock(), rss_bytes, objects, examined, took_ns, len(largest))
            self._store(at, at + page.CENSUS_BYTES, numbers, texts)

    def _store(self, at: int, end: int, numbers: Sequence[int], texts: bytes) -> None:
        """Store one entry from `at` to `end` under its lock: lock, CRC, `numbers`, `texts`."""
        words, view = self._words, self._bytes
        word = at >> 3
        lock = words[word]
        words[word] = lock + 1
        for offset, number in enumerate(numbers):
            words[word + 2 + offset] = number
        text_at = at + 16 + 8 * len(numbers)
        view[text_at : text_at + len(texts)] = texts
        words[word + 1] = zlib.crc32(view[at + 16 : end])
        words[word] = lock + 2

    def close(self) -> None:
        """Let go of the page, after everything that beats or stages has ended."""
        with self._ring_lock:
            if self._closed:
                return
            self._closed = True
        self._words.release()
        self._bytes.release()
        self._memory.close()


def _fault(memory: mmap.mmap) -> str | None:
    """Return what is wrong with a freshly mapped page, or None."""
    if memory[: len(page.MAGIC)] != page.MAGIC:
        return "does not begin with the recorder's magic"
    version = int.from_bytes(memory[page.VERSION_AT : page.VERSION_AT + 8], "little")
    if version != page.VERSION:
        return f"has version {version}, not {page.VERSION}"
    pid = int.from_bytes(memory[page.PID_AT : page.PID_AT + 8], "little")
    if pid:
        # A page is one life's evidence; two lives on it would make it nobody's.
        return f"already belongs to process {pid}"
    return None


class NoRecorder(Recorder):
    """The recorder of a core that runs alone: private memory that nobody reads, and the same bounds."""

    def __init__(self) -> None:
        """Take memory instead of a page."""
        super().__init__(mmap.mmap(-1, page.FILE_BYTES))


#: What the rest of the core is given: it need not know whether anybody reads along.
FlightRecorder = Recorder
