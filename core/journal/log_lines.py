"""The whole log as lines of JSON: what each line says, and how it is read back.

Pure. A head, then each event in its order, then each key, then a foot that says how many of both there were: a file that was cut
off is told from a whole one. The body of an event and the answer under a key are JSON themselves and stand in their line as the
very bytes that are stored, so the hash of an event can be computed again from its line alone by anybody, in any language
(`docs/wires.md` section 24). What the tables hold beside these is not in it: it follows from the events.
"""

from typing import Final

import msgspec
from msgspec import Raw

from core.journal.answers import KeyRow
from core.journal.chain import EventRow

FORMAT: Final = "fieldstack-log"
VERSION: Final = 1
LINE_BYTES_MAX: Final = 64 << 20  # more than the largest answer of a batch


class Head(msgspec.Struct, frozen=True):
    """The first line. `epoch`, `seq` and `head` are of the last event in it; `head` is a hash in hex."""

    format: str
    version: int
    epoch: int
    seq: int
    head: str


class EventLine(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An event, with its body as it is stored."""

    seq: int
    epoch: int
    booked_ns: int
    kind: str
    command_id: str
    key: str | None
    hash: str
    body: Raw


class KeyLine(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A key and what is answered to it; `seq` null: the book refused it. Hashes are hex."""

    key: str
    fingerprint: str
    seq: int | None
    status: int
    digest: str
    reply: Raw


class Foot(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The last line: how much there was."""

    events: int
    keys: int


class Line(msgspec.Struct, frozen=True, omit_defaults=True, forbid_unknown_fields=True):
    """One line behind the head: one of the three."""

    event: EventLine | None = None
    key: KeyLine | None = None
    end: Foot | None = None


_HEAD: Final = msgspec.json.Decoder(Head)
_LINE: Final = msgspec.json.Decoder(Line)


def event_line(row: EventRow) -> bytes:
    """Return an event as a line."""
    told = EventLine(
        row.seq, row.epoch, row.booked_ns, row.kind, row.command_id, row.key, row.hash.hex(), Raw(row.body)
    )
    return msgspec.json.encode(Line(event=told)) + b"\n"


def key_line(key: str, row: KeyRow) -> bytes:
    """Return a key as a line."""
    told = KeyLine(key, row.fingerprint.hex(), row.seq, row.status, row.digest.hex(), Raw(row.reply))
    return msgspec.json.encode(Line(key=told)) + b"\n"


def read_head(line: bytes) -> Head | str:
    """Return what the first line says, or why this is no log that can be read here."""
    try:
        head = _HEAD.decode(line)
    except (msgspec.DecodeError, UnicodeDecodeError):
        return "it is no log of a ledger"
    if head.format != FORMAT:
        return "it is no log of a ledger"
    if head.version != VERSION:
        return f"it is a log of version {head.version}, and this program reads version {VERSION}"
    return head


def read_line(line: bytes) -> EventRow | tuple[str, KeyRow] | Foot | str:
    """Return what a line behind the head says, or what is wrong with it."""
    try:
        read = _LINE.decode(line)
        if read.event is not None:
            one = read.event
            return EventRow(
                one.seq,
                one.epoch,
                one.booked_ns,
                one.kind,
                one.command_id,
                one.key,
                bytes(one.body),
                bytes.fromhex(one.hash),
            )
        if read.key is not None:
            kept = read.key
            digests = bytes.fromhex(kept.fingerprint), bytes.fromhex(kept.digest)
            return kept.key, KeyRow(digests[0], kept.seq, kept.status, bytes(kept.reply), digests[1])
    except (ValueError, RecursionError) as error:  # msgspec's own and UnicodeDecodeError are ValueErrors too
        return f"it can't be read ({error})"
    return read.end if read.end is not None else "it says nothing"
