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


# Where the single words of an entry stand, in words of 8 bytes from its start.
_CRC = 1
_STARTED, _LIMIT, _LENGTH, _STAGE, _STAGE_SINCE, _THREAD, _ORDINAL, _PROGRESS = 2, 3, 4, 8, 9, 10, 11, 12
_FINISHED, _OUTCOME, _INDEX, _FINISHED_STARTED = 2, 3, 4, 5

_TEXTS = Struct("40s32s32s40s240s512s")
assert _TEXTS.size == page.SLOT_BYTES - page.TEXTS_AT, "a slot's texts fill it to its end"


def _key_hash(key: str | None) -> bytes:
    if key is None:
        return b""
    return sha256(key.encode("utf-8", "replace")).hexdigest()[:32].encode()


class CommandTable:
    """The commands in flight and just finished."""

    def __init__(self, view: memoryview, words: memoryview, clock: Callable[[], int]) -> None:
        """Keep the table on a whole page, given as bytes and as words; `clock` tells monotonic ns."""
        self._bytes = view
        self._words = words
        self._clock = clock
        self._free = list(range(page.SLOTS - 1, -1, -1))
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
    ) -> int | None:
        """Note a command as QUEUED and return its slot, or None when every slot is taken.

        No slot, no execution: a caller that gets None refuses the command. `limit_ns` is how long it may be
        DECIDING without progress, 0 for as long as it takes: a length and not a moment, because how long it
        stands in the line before is nobody's fault. `payload` is the request's body, never its headers. Loop
        thread only.
        """
        assert limit_ns >= 0, "a store that fails half way would leave the entry locked"
        if not self._free:
            return None
        slot = self._free.pop()
        at = page.SLOTS_AT + slot * page.SLOT_BYTES
        word = at >> 3
        now_ns = self._clock()
        texts = _TEXTS.pack(
            page.cut(command_id, page.ID_BYTES_MAX),
            _key_hash(key),
            page.cut(kind, page.KIND_BYTES_MAX),
            page.cut(transaction_id, page.ID_BYTES_MAX),
            page.join_ids(account_ids),
            payload[: page.PAYLOAD_BYTES_MAX],
        )
        words, view = self._words, self._bytes
        lock = words[word]
        words[word] = lock + 1
        words[word + _STARTED] = now_ns
        words[word + _LIMIT] = limit_ns
        words[word + _LENGTH] = len(payload)
        view[at + page.TEXTS_AT : at + page.SLOT_BYTES] = texts
        words[word + _CRC] = zlib.crc32(texts, zlib.crc32(view[at + 16 : at + 64]))
        words[word + _STAGE_SINCE] = now_ns
        words[word + _THREAD] = threading.get_native_id()
        words[word + _ORDINAL] = 0
        words[word + _PROGRESS] = 0
        words[word + _STAGE] = Stage.QUEUED
        words[word] = lock + 2
        self._submitted += 1
        words[page.SUBMITTED_AT >> 3] = self._submitted
        return slot

    def stage(self, slot: int, stage: Stage) -> None:
        """Say how far the command in `slot` has come, and that this thread has it. Any thread."""
        word = (page.SLOTS_AT + slot * page.SLOT_BYTES) >> 3
        words = self._words
        # The stage comes last: a reader must never see DECIDING with the time at which it was queued,
        # or a command that has only just begun would look overdue.
        words[word + _STAGE_SINCE] = self._clock()
        words[word + _THREAD] = threading.get_native_id()
        words[word + _STAGE] = stage

    def ordinal(self, slot: int, n: int) -> None:
        """Say which item of a batch command is being decided, counted by the caller: progress. Any thread."""
        self._words[((page.SLOTS_AT + slot * page.SLOT_BYTES) >> 3) + _ORDINAL] = n
        self.progress(slot)

    def progress(self, slot: int) -> None:
        """Say that the command in `slot` gets on: its limit runs anew from now. Any thread."""
        self._words[((page.SLOTS_AT + slot * page.SLOT_BYTES) >> 3) + _PROGRESS] = self._clock()

    def finish(self, slot: int, status: int) -> None:
        """Move the command to the finished ring with its HTTP status; free the slot. Loop thread only."""
        start = page.SLOTS_AT + slot * page.SLOT_BYTES
        words, view = self._words, self._bytes
        assert words[(start >> 3) + _STAGE] != Stage.FREE, f"slot {slot} is finished twice"
        at = page.FINISHED_AT + (self._completed % page.FINISHED) * page.FINISHED_BYTES
        word = at >> 3
        now_ns = self._clock()
        lock = words[word]
        words[word] = lock + 1
        words[word + _FINISHED] = now_ns
        words[word + _OUTCOME] = status
        words[word + _INDEX] = self._completed + 1
        words[word + _FINISHED_STARTED] = words[(start >> 3) + _STARTED]
        view[at + page.TEXTS_AT : at + page.FINISHED_BYTES] = view[
            start + page.TEXTS_AT : start + page.FINISHED_BYTES
        ]
        words[word + _CRC] = zlib.crc32(view[at + 16 : at + page.FINISHED_BYTES])
        words[word] = lock + 2
        # Freed only now: a death in between shows the command in both places, never in none.
        words[(start >> 3) + _STAGE] = Stage.FREE
        self._free.append(slot)
        self._completed += 1
        words[page.COMPLETED_NS_AT >> 3] = now_ns
        words[page.COMPLETED_AT >> 3] = self._completed
