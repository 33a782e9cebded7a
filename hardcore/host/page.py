"""What the bytes of a recorder page mean: pure functions from bytes to the values of `model.recorder`.

This is `docs/wires.md` section 3 from the guard's side; the core has its own numbers for the same page,
so that a wrong offset shows in the contract tests instead of agreeing with itself. The bytes come from a
process that may be broken or hostile: nothing in here raises, whatever they hold. An entry whose lock is
odd or whose CRC is wrong is torn; it is decoded all the same and marked, because the command that was
being written down when the process died may be the one that killed it.
"""

import zlib
from collections.abc import Collection
from struct import Struct

import msgspec

from hardcore.model.looks import LogCounts
from hardcore.model.recorder import (
    Beats,
    Census,
    CommandNote,
    ComponentBeat,
    LastWords,
    LifeState,
    Page,
    RingEvent,
    SlotStage,
    Threads,
    TypeCount,
    Witness,
)

MAGIC = b"HCREC001"
VERSION = 2
FILE_BYTES = 368_640
HEAD_BYTES = 512  # header and beats
LOOK_BYTES = 768  # and the witness behind them: all that a tick of the watch reads
MADE_BYTES = 128  # the part of the header that its maker wrote and nobody may change
PAYLOAD_BYTES_MAX = 512


class Shape(msgspec.Struct, frozen=True):
    """Where entries of one kind stand, how many, how long, and which of their bytes the CRC covers."""

    at: int
    count: int
    size_bytes: int
    covered: tuple[slice, ...]
    crc_at: int = 8


SLOTS = Shape(4096, 256, 1024, (slice(16, 64), slice(128, 1024)))
FINISHED = Shape(266_240, 64, 512, (slice(16, 512),))
EVENTS = Shape(299_008, 512, 128, (slice(16, 128),))
WITNESSES = Shape(512, 2, 128, (slice(8, 64),), crc_at=64)
LAST_WORDS = Shape(768, 1, 1024, (slice(16, 1024),))
CENSUSES = Shape(364_544, 2, 2048, (slice(16, 2048),))
SHAPES = (SLOTS, FINISHED, EVENTS, WITNESSES, LAST_WORDS, CENSUSES)

COMPONENTS_AT, COMPONENTS, COMPONENT_BYTES = 1792, 8, 64  # single words under no lock, so no Shape
CENSUS_TYPES = 20

_MADE = Struct("<8s8Q36s4x16s")
_OWNER = Struct("<6Q")
_BEATS = Struct("<11Q8xQ")
_WORD = Struct("<Q")
_LOGGED = Struct("<2Q")
_SLOT_NUMBERS = Struct("<3Q24x5Q")  # started, limit, payload length; stage, since, thread, ordinal, progress
_FINISHED_NUMBERS = Struct("<4Q")  # finished, outcome, index, started
_EVENT = Struct("<2Q32s64s")
_WITNESS = Struct("<3Q32s")
_LAST_WORDS = Struct("<Q40s960s")
_TEXTS = Struct("<40s32s32s40s240s")
_COMPONENT = Struct("<24s4Q")  # name; beat, has work since, limit, done
_CENSUS = Struct("<6Q")  # at, resident, objects, examined, took, how many types
_TYPE = Struct("<48s2Q")


class Made(msgspec.Struct, frozen=True):
    """What the page's maker wrote."""

    boot_id: str
    nonce: str


def new_page_head(nonce: str, boot_id: str) -> bytes:
    """Return the first bytes of a new page. `nonce`: at most 16 bytes of ASCII; `boot_id`: at most 36."""
    assert 0 < len(nonce) <= 16, "the page has 16 bytes for it"
    assert len(boot_id) <= 36, "the page has 36 bytes for it"
    head = _MADE.pack(
        MAGIC,
        VERSION,
        FILE_BYTES,
        SLOTS.count,
        SLOTS.size_bytes,
        FINISHED.count,
        FINISHED.size_bytes,
        EVENTS.count,
        EVENTS.size_bytes,
        boot_id.encode("ascii"),
        nonce.encode("ascii"),
    )
    assert len(head) == MADE_BYTES, "the nonce ends where the core's own part begins"
    return head


def made(raw: bytes) -> Made | None:
    """Return what the maker wrote, or None when this is not the head of a page of this version."""
    if len(raw) < MADE_BYTES:
        return None
    fields = _MADE.unpack_from(raw)
    boot_id, nonce = _text(fields[9]), _text(fields[10])
    if not nonce.isascii() or not boot_id.isascii() or not nonce:
        return None
    return Made(boot_id, nonce) if new_page_head(nonce, boot_id) == raw[:MADE_BYTES] else None


def identity(head: bytes) -> tuple[int, int] | None:
    """Return pid and start time (ticks since boot) of the page's owner, or None before it has one."""
    pid, start, _, _, _, owned = _OWNER.unpack_from(head, 128)
    return (pid, start) if owned == 1 and pid else None


def threads(head: bytes) -> Threads:
    """Return the owner's thread ids, 0 where not written yet."""
    _, _, loop, writer, beat, _ = _OWNER.unpack_from(head, 128)
    return Threads(loop, writer, beat)


def beats(head: bytes) -> Beats | None:
    """Return the beat block, or None when it holds a life state that no core of this version writes."""
    words = _BEATS.unpack_from(head, 256)
    loop_ns, loop_count, thread_ns, thread_count, submitted, completed, completed_ns, *rest = words
    in_store_since_ns, gc_since_ns, epoch, state, answered_seq = rest
    if state > LifeState.SPARE:
        return None
    return Beats(
        loop_ns=loop_ns,
        loop_count=loop_count,
        thread_ns=thread_ns,
        thread_count=thread_count,
        submitted=submitted,
        completed=completed,
        completed_ns=completed_ns,
        in_store_since_ns=in_store_since_ns,
        gc_since_ns=gc_since_ns,
        epoch=epoch,
        state=LifeState(state),
        answered_seq=answered_seq,
        loop_lag_ns=_WORD.unpack_from(head, 376)[0],
    )


def log_counts(head: bytes) -> LogCounts:
    """Return what the owner has written to its log so far, by weight."""
    return LogCounts(*_LOGGED.unpack_from(head, 360))


def lock(entry: bytes) -> int:
    """Return an entry's sequence lock: 0 never used, odd while it is being written."""
    return int(_WORD.unpack_from(entry)[0])


def slot_in_use(entry: bytes) -> bool:
    """Say whether a slot holds a command, be it only half written."""
    return bool(lock(entry) % 2) or bool(lock(entry) and _WORD.unpack_from(entry, 64)[0])


def slots_in_use(slots: bytes) -> list[int]:
    """Return where in the table of slots the used ones begin; quick, because a tick asks for it."""
    words = memoryview(slots).cast("Q")
    step = SLOTS.size_bytes // 8
    return [8 * at for at in range(0, len(words), step) if words[at] % 2 or (words[at] and words[at + 8])]


def whole(shape: Shape, entry: bytes) -> bool:
    """Say whether an entry was written to its end and is what its CRC says."""
    if lock(entry) % 2:
        return False
    crc = 0
    for span in shape.covered:
        crc = zlib.crc32(entry[span], crc)
    return crc == int(_WORD.unpack_from(entry, shape.crc_at)[0])


def slot(entry: bytes, *, torn: bool) -> CommandNote:
    """Return the command in a slot."""
    started, limit, length, stage, since, thread, ordinal, progress = _SLOT_NUMBERS.unpack_from(entry, 16)
    command_id, key_hash, kind, transaction_id, accounts = _texts(entry)
    known = stage <= SlotStage.ANSWERING
    return CommandNote(
        stage=SlotStage(stage) if known else SlotStage.FREE,
        command_id=command_id,
        key_hash=key_hash,
        kind=kind,
        transaction_id=transaction_id,
        account_ids=tuple(accounts.split()),
        started_ns=started,
        limit_ns=limit,
        stage_ns=since,
        progress_ns=progress,
        thread=thread,
        ordinal=ordinal,
        payload=entry[512 : 512 + min(length, PAYLOAD_BYTES_MAX)],
        payload_bytes=length,
        torn=torn or not known,
    )


def finished(entry: bytes, *, torn: bool) -> tuple[int, CommandNote]:
    """Return a finished command with its index in the ring's order. `stage_ns` is when it finished."""
    finished_ns, outcome, index, started = _FINISHED_NUMBERS.unpack_from(entry, 16)
    command_id, key_hash, kind, transaction_id, accounts = _texts(entry)
    return index, CommandNote(
        stage=SlotStage.FREE,
        command_id=command_id,
        key_hash=key_hash,
        kind=kind,
        transaction_id=transaction_id,
        account_ids=tuple(accounts.split()),
        started_ns=started,
        stage_ns=finished_ns,
        outcome=outcome,
        torn=torn,
    )


def event(entry: bytes, *, torn: bool) -> RingEvent:
    """Return one line of the ring of events."""
    at_ns, index, code, text = _EVENT.unpack_from(entry, 16)
    return RingEvent(at_ns, index, _text(code), _text(text), torn=torn)


def witness(entry: bytes) -> Witness:
    """Return the commit in one of the witness's two places."""
    seq, epoch, at_ns, digest = _WITNESS.unpack_from(entry, 8)
    return Witness(seq, epoch, digest.hex(), at_ns)


def newest_witness(look: bytes) -> Witness | None:
    """Return the last commit in the first `LOOK_BYTES` of a page, or None before the first.

    Half a commit is no commit: of the two places one is whole whenever the other is being written.
    """
    places = [at for at in used_entries(WITNESSES, look) if whole(WITNESSES, entry_at(WITNESSES, look, at))]
    found = (witness(entry_at(WITNESSES, look, at)) for at in places)
    return max(found, key=lambda one: one.seq, default=None)


def components(raw: bytes) -> tuple[ComponentBeat, ...]:
    """Return what the components say of themselves, in the order in which they were made known."""
    places = range(COMPONENTS_AT, COMPONENTS_AT + COMPONENTS * COMPONENT_BYTES, COMPONENT_BYTES)
    found = (_COMPONENT.unpack_from(raw, at) for at in places)
    return tuple(ComponentBeat(_text(name), *words) for name, *words in found if name.strip(b"\0"))


def census(entry: bytes, *, torn: bool) -> Census:
    """Return one census. A torn one may mix two of them, and says so."""
    at_ns, rss_bytes, objects, examined, took_ns, types = _CENSUS.unpack_from(entry, 16)
    places = range(64, 64 + min(types, CENSUS_TYPES) * _TYPE.size, _TYPE.size)
    counted = (_TYPE.unpack_from(entry, at) for at in places)
    largest = tuple(TypeCount(_text(name), count, size_bytes) for name, count, size_bytes in counted)
    return Census(at_ns, rss_bytes, objects, examined, took_ns, largest, torn=torn)


def decode(raw: bytes, unsettled: Collection[int] = ()) -> Page | None:
    """Return the whole page in `raw`, or None when it is not a page of this version.

    `unsettled`: offsets of entries that changed while they were being read, so that they count as torn
    even if their CRC happens to fit.
    """
    if len(raw) != FILE_BYTES or (maker := made(raw)) is None or (pulse := beats(raw)) is None:
        return None
    owner = identity(raw) or (0, 0)
    in_flight = [slot(e, torn=t) for e, t in _used(SLOTS, raw, unsettled) if slot_in_use(e)]
    done = [finished(e, torn=t) for e, t in _used(FINISHED, raw, unsettled)]
    ring = [event(e, torn=t) for e, t in _used(EVENTS, raw, unsettled)]
    seen = _used(WITNESSES, raw, unsettled)
    witnesses = [witness(e) for e, t in seen if not t]
    counted = [census(e, torn=t) for e, t in _used(CENSUSES, raw, unsettled)]
    words = [_last_words(e, torn=t) for e, t in _used(LAST_WORDS, raw, unsettled)]
    return Page(
        nonce=maker.nonce,
        boot_id=maker.boot_id,
        pid=owner[0],
        start=owner[1],
        threads=threads(raw),
        beats=pulse,
        witness=max(witnesses, key=lambda w: w.seq, default=None),
        last_words=words[0] if words else None,
        in_flight=tuple(in_flight),
        finished=tuple(note for _, note in sorted(done, key=lambda pair: pair[0])),
        events=tuple(sorted(ring, key=lambda line: line.index)),
        torn=sum(
            [
                *(note.torn for note in in_flight),
                *(note.torn for _, note in done),
                *(line.torn for line in ring),
                *(line.torn for line in words),
                *(one.torn for one in counted),
                *(half for _, half in seen),
            ]
        ),
        components=components(raw),
        censuses=tuple(sorted(counted, key=lambda one: one.at_ns)),
    )


def _last_words(entry: bytes, *, torn: bool) -> LastWords:
    at_ns, code, text = _LAST_WORDS.unpack_from(entry, 16)
    return LastWords(at_ns, _text(code), _text(text), torn=torn)


def used_entries(shape: Shape, raw: bytes | bytearray) -> list[int]:
    """Return the offsets of all entries of this shape that were ever begun."""
    last = shape.at + shape.count * shape.size_bytes
    return [at for at in range(shape.at, last, shape.size_bytes) if _WORD.unpack_from(raw, at)[0]]


def entry_at(shape: Shape, raw: bytes, at: int) -> bytes:
    """Return the entry of this shape that begins at offset `at`."""
    return raw[at : at + shape.size_bytes]


def _used(shape: Shape, raw: bytes, unsettled: Collection[int]) -> list[tuple[bytes, bool]]:
    """Return (entry, torn) for all entries of this shape that were ever begun."""
    entries = ((at, entry_at(shape, raw, at)) for at in used_entries(shape, raw))
    return [(entry, at in unsettled or not whole(shape, entry)) for at, entry in entries]


def _texts(entry: bytes) -> tuple[str, str, str, str, str]:
    command_id, key_hash, kind, transaction_id, accounts = _TEXTS.unpack_from(entry, 128)
    return _text(command_id), _text(key_hash), _text(kind), _text(transaction_id), _text(accounts)


def _text(field: bytes) -> str:
    return field.rstrip(b"\0").decode("utf-8", "replace")
