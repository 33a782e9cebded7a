"""The table of commands on a recorder page: each in a slot while it runs, the last 64 in a ring after it.

A command is written down once, whole, before it is queued, and from then on only its stage moves, by
single words that any thread may store. So naming the command that was being decided when the process
died costs three stores per step and needs no help from the process. The slots are also the bound of the
queue: a command that could not be named is not executed. Not chosen: one slot table per thread, which
would make a hand-over from the loop to the writer two entries and a moment with none.
"""

import threading
import zlib
from collections.abc import Callable, Sequence
from enum import IntEnum
from functools import lru_cache
from hashlib import sha256
from struct import Struct

from core.guarded import page


class Stage(IntEnum):
    """How far a command has come. DECIDING marks exactly one; from WRITING on the whole batch is in it."""

    FREE = 0
    QUEUED = 1
    DECIDING = 2
    WRITING = 3
    COMMITTED = 4
    ANSWERING = 5


# Looked up once: a member of an enum costs as much as the store of it.
_FREE, _QUEUED = int(Stage.FREE), int(Stage.QUEUED)

# In words of 8 bytes: where the slots begin, how long one is, and where single words stand in it or in any entry.
_SLOTS, _SLOT = page.SLOTS_AT >> 3, page.SLOT_BYTES >> 3
_CRC = 1
_STAGE, _STAGE_SINCE, _THREAD, _ORDINAL, _PROGRESS = 8, 9, 10, 11, 12

# An entry is made elsewhere and copied into its place in one go. A slot's single words stand between the two
# parts that its CRC covers.
_SLOT_NUMBERS = Struct("<3Q24x5Q24x")  # started, limit, payload length; then the single words
_COVERED_BYTES = 48  # of these numbers: the CRC ends before the single words
_FINISHED_NUMBERS = Struct("<4Q80x")  # finished, outcome, index, started
_TEXTS = Struct("40s32s32s40s240s512s")
_TEXTS_KEPT_BYTES = page.FINISHED_BYTES - page.TEXTS_AT
assert _TEXTS.size == page.SLOT_BYTES - page.TEXTS_AT, "a slot's texts fill it to its end"


class _Own(threading.local):
    """The kernel's id of each thread, asked once: it is a system call."""

    def __init__(self) -> None:
        self.thread = threading.get_native_id()


_own = _Own()


@lru_cache(maxsize=64)
def _kind(kind: str) -> bytes:
    """Return the bytes of a kind: a program has a few, and says them with every command."""
    return page.cut(kind, page.KIND_BYTES_MAX)


def _key_hash(key: str | None) -> bytes:
    if key is None:
        return b""
    return sha256(key.encode("utf-8", "replace")).hexdigest().encode()  # its place takes the first half


class CommandTable:
    """The commands in flight and just finished."""

    def __init__(self, view: memoryview, words: memoryview, clock: Callable[[], int]) -> None:
        """Keep the table on a whole page, given as bytes and as words; `clock` tells monotonic ns."""
        self._bytes = view
        self._words = words
        self._clock = clock
        self._free = list(range(page.SLOTS - 1, -1, -1))
        # When each command began, and its texts but the payload: the ring gets them from here and not from the
        # page, where a stray store may have spoiled them.
        self._begun: list[tuple[int, bytes] | None] = [None] * page.SLOTS
        self._submitted = 0
        self._completed = 0

    def begin(
        self,
        command_id: str,
        key: str | None,
        kind: str,
        transaction_id: str,
        account_ids: Sequence[str],
        payload: bytes,
        limit_ns: int,
        name: str = "",
    ) -> int | None:
        """Note a command as QUEUED and return its slot, or None when every slot is taken.

        No slot, no execution: a caller that gets None refuses the command. `limit_ns` is how long it may be
        DECIDING without progress, 0 for as long as it takes: a length and not a moment, because how long it
        stands in the line before is nobody's fault. `payload` is the request's body, never its headers. `name`: what
        a command without a key is known by (32 hex). Loop thread only.
        """
        assert limit_ns >= 0, "a store that fails half way would leave the entry locked"
        if not self._free:
            return None
        slot = self._free.pop()
        now_ns = self._clock()
        texts = _TEXTS.pack(
            page.cut(command_id, page.ID_BYTES_MAX),
            name.encode("utf-8", "replace") if key is None else _key_hash(key),
            _kind(kind),
            page.cut(transaction_id, page.ID_BYTES_MAX),
            page.join_ids(account_ids),
            payload[: page.PAYLOAD_BYTES_MAX],
        )
        self._begun[slot] = now_ns, texts[:_TEXTS_KEPT_BYTES]
        numbers = _SLOT_NUMBERS.pack(now_ns, limit_ns, len(payload), _QUEUED, now_ns, _own.thread, 0, 0)
        crc = zlib.crc32(texts, zlib.crc32(numbers[:_COVERED_BYTES]))
        self._put(_SLOTS + slot * _SLOT, crc, numbers + texts)
        self._submitted += 1
        self._words[page.SUBMITTED_AT >> 3] = self._submitted
        return slot

    def stage(self, slot: int, stage: Stage) -> None:
        """Say how far the command in `slot` has come, and that this thread has it. Any thread."""
        words, word = self._words, _SLOTS + slot * _SLOT
        # The stage comes last: a reader must never see DECIDING with the time at which it was queued,
        # or a command that has only just begun would look overdue.
        words[word + _STAGE_SINCE] = self._clock()
        words[word + _THREAD] = _own.thread
        words[word + _STAGE] = stage

    def ordinal(self, slot: int, n: int) -> None:
        """Say which item of a batch command is being decided, counted by the caller: progress. Any thread."""
        self._words[_SLOTS + slot * _SLOT + _ORDINAL] = n
        self.progress(slot)

    def progress(self, slot: int) -> None:
        """Say that the command in `slot` gets on: its limit runs anew from now. Any thread."""
        self._words[_SLOTS + slot * _SLOT + _PROGRESS] = self._clock()

    def finish(self, slot: int, status: int) -> None:
        """Move the command to the finished ring with its HTTP status; free the slot. Loop thread only."""
        begun = self._begun[slot]
        assert begun is not None, f"slot {slot} is finished twice"
        self._begun[slot] = None
        now_ns = self._clock()
        started_ns, texts = begun
        entry = _FINISHED_NUMBERS.pack(now_ns, status, self._completed + 1, started_ns) + texts
        at = page.FINISHED_AT + (self._completed % page.FINISHED) * page.FINISHED_BYTES
        self._put(at >> 3, zlib.crc32(entry), entry)
        words = self._words
        # Freed only now: a death in between shows the command in both places, never in none.
        words[_SLOTS + slot * _SLOT + _STAGE] = _FREE
        self._free.append(slot)
        self._completed += 1
        words[page.COMPLETED_NS_AT >> 3] = now_ns
        words[page.COMPLETED_AT >> 3] = self._completed

    def _put(self, word: int, crc: int, entry: bytes) -> None:
        """Store lock, CRC and the rest of an entry, which begins at `word`."""
        words = self._words
        lock = words[word]
        words[word] = lock + 1
        at = (word << 3) + 16
        self._bytes[at : at + len(entry)] = entry
        words[word + _CRC] = crc
        words[word] = lock + 2
