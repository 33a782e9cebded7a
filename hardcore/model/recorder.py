"""What a reader finds on a recorder page: the last words of a core, as values.

The bytes are `docs/wires.md` section 3; `host/recorder.py` reads them. A torn entry (its writer died in
the middle of it) keeps what could be read and says so: half a name is better evidence than none.
"""

from enum import IntEnum

import msgspec


class SlotStage(IntEnum):
    """How far a command has come. DECIDING marks exactly one; from WRITING on the whole batch is in it."""

    FREE = 0
    QUEUED = 1
    DECIDING = 2
    WRITING = 3
    COMMITTED = 4
    ANSWERING = 5


class LifeState(IntEnum):
    """What the core says of itself."""

    STARTING = 0
    READY = 1
    DRAINING = 2
    STOPPING = 3
    SPARE = 4  # it waits to be promoted


class Beats(msgspec.Struct, frozen=True):
    """The beat block. Times are monotonic nanoseconds, 0 for never; counts only grow."""

    loop_ns: int = 0
    loop_count: int = 0
    thread_ns: int = 0
    thread_count: int = 0
    submitted: int = 0
    completed: int = 0
    completed_ns: int = 0
    in_store_since_ns: int = 0
    gc_since_ns: int = 0
    epoch: int = 0
    state: LifeState = LifeState.STARTING
    answered_seq: int = 0  # the highest sequence that an answer has claimed to be committed
    loop_lag_ns: int = 0  # how late the loop came to its beats lately

    @property
    def waiting(self) -> int:
        """Commands that have a slot and no answer yet."""
        return max(0, self.submitted - self.completed)


class Threads(msgspec.Struct, frozen=True):
    """The core's own thread ids, once it has written them (0: not yet)."""

    loop: int = 0
    writer: int = 0
    beat: int = 0


class Witness(msgspec.Struct, frozen=True):
    """The last commit somebody saw: sequence, epoch and the event's hash (hex)."""

    seq: int
    epoch: int
    hash: str
    at_ns: int = 0


class CommandNote(msgspec.Struct, frozen=True):
    """A command in flight or just finished. `payload` is cut at 512 bytes; `outcome` is an HTTP status.

    `limit_ns` is how long it may be DECIDING, 0 for as long as it takes; the time runs from `stage_ns`, or from
    `progress_ns` if it has reported progress later than that.
    """

    stage: SlotStage
    command_id: str
    key_hash: str
    kind: str
    transaction_id: str
    account_ids: tuple[str, ...]
    started_ns: int
    limit_ns: int = 0
    stage_ns: int = 0
    progress_ns: int = 0
    thread: int = 0
    ordinal: int = 0
    payload: bytes = b""
    payload_bytes: int = 0
    outcome: int = 0
    torn: bool = False


class RingEvent(msgspec.Struct, frozen=True):
    """One line of the ring of events."""

    at_ns: int
    index: int
    code: str
    text: str
    torn: bool = False


class LastWords(msgspec.Struct, frozen=True):
    """What the core wrote when it knew that it was leaving."""

    at_ns: int
    code: str
    text: str
    torn: bool = False


class ComponentBeat(msgspec.Struct, frozen=True):
    """The own beat of one part of the core. `since_ns` 0: it has nothing to do; `limit_ns`: how long it may be silent."""

    name: str
    beat_ns: int
    since_ns: int
    limit_ns: int
    done: int


class TypeCount(msgspec.Struct, frozen=True):
    """How many objects of one type the core held, and how many bytes they take by themselves (estimated)."""

    name: str
    count: int
    size_bytes: int


class Census(msgspec.Struct, frozen=True):
    """The largest types in the core's memory at one moment. `examined` of `objects` were looked at."""

    at_ns: int
    rss_bytes: int
    objects: int
    examined: int
    took_ns: int
    types: tuple[TypeCount, ...]
    torn: bool = False


class Page(msgspec.Struct, frozen=True):
    """A whole recorder page, read at one moment. `torn` counts the entries that were half written."""

    nonce: str
    boot_id: str
    pid: int
    start: int
    threads: Threads
    beats: Beats
    witness: Witness | None
    last_words: LastWords | None
    in_flight: tuple[CommandNote, ...]
    finished: tuple[CommandNote, ...]
    events: tuple[RingEvent, ...]
    torn: int = 0
    components: tuple[ComponentBeat, ...] = ()
    censuses: tuple[Census, ...] = ()  # the last two, the older first
