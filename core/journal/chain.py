"""The chain: every event carries a hash of everything before it.

    hash(n) = SHA-256( hash(n-1) || header(n) || body(n) ),   hash(0) = 32 zero bytes

    header  = seq        unsigned 64 bits, little-endian
           || epoch      unsigned 64 bits
           || booked_ns  unsigned 64 bits
           || kind, command_id, key: each as its length in bytes (unsigned 32 bits), then its UTF-8 bytes;
              an event without a key has the length 0xFFFFFFFF there and no bytes
    body    = the stored bytes, exactly; nothing is ever encoded again in order to be hashed

Every part but the last says how long it is, so no two events share one input. A plain chain shows accidents
and carelessness, and it binds each answer to all history before it; somebody who may write the file could
compute a new chain, and against him only a head that is kept elsewhere helps (the guard keeps one).
"""

from hashlib import sha256
from struct import Struct
from typing import Final

import msgspec

GENESIS: Final = bytes(32)
_NUMBERS: Final = Struct("<QQQ")
_LENGTH: Final = Struct("<I")
_NO_KEY: Final = _LENGTH.pack(0xFFFFFFFF)


class EventRow(msgspec.Struct, frozen=True):
    """An event as it stands in the store. `booked_ns` is wall time since 1970, `hash` 32 bytes."""

    seq: int
    epoch: int
    booked_ns: int
    kind: str
    command_id: str
    key: str | None
    body: bytes
    hash: bytes = GENESIS


class Broken(msgspec.Struct, frozen=True):
    """The first place where the book is not what it must be; `seq` is None where no event is to blame."""

    seq: int | None
    sentence: str


def hash_of(before: bytes, row: EventRow) -> bytes:
    """Return the hash of this event when the one before it has the hash `before`."""
    parts = (
        before,
        _NUMBERS.pack(row.seq, row.epoch, row.booked_ns),
        _sized(row.kind),
        _sized(row.command_id),
        _NO_KEY if row.key is None else _sized(row.key),
        row.body,
    )
    return sha256(b"".join(parts)).digest()


def check_link(before: EventRow | None, row: EventRow) -> Broken | None:
    """Say what is wrong between an event and the one before it (None: `row` is the first of all)."""
    seq, epoch, prior_hash = (before.seq, before.epoch, before.hash) if before else (0, 0, GENESIS)
    if row.seq != seq + 1:
        return Broken(seq + 1, f"event {seq + 1} is missing: the next one stored is {row.seq}")
    if row.epoch < epoch:
        return Broken(row.seq, f"event {row.seq} was booked in epoch {row.epoch}, after epoch {epoch}")
    if hash_of(prior_hash, row) != row.hash:
        return Broken(row.seq, f"the hash of event {row.seq} does not follow from what is stored")
    return None


def _sized(text: str) -> bytes:
    data = text.encode()
    return _LENGTH.pack(len(data)) + data
