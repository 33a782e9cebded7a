"""A checkpoint: what is known of the whole book after one event, in a small file beside it. Pure.

It says the same as an attestation in the store (the number and hash of an event, a digest of all balances after it), as
often as once a minute and not after ten thousand events. So a proof that begins at one hashes what was booked in the
last minute. It holds no balances: a book is never restored from it, only held against it. Whether it may be used is
seen from itself (its length, its digest) and from the book (the event of this number has this hash), so a file that was
torn, cut, changed, or is of another book or of a later state of this one is passed over. Not chosen: to keep the balances in it
and to load them; they would be a second truth about somebody's money, and reading the store's own takes no longer.
"""

import datetime as dt
import re
from collections.abc import Mapping
from enum import StrEnum
from hashlib import sha256
from types import MappingProxyType
from typing import Final

import msgspec

from core.journal.attestation import Attestation
from core.ledger.moments import timestamp

VERSION: Final = 1
BYTES_MAX: Final = 1 << 16
FUTURE_NS_MAX: Final = 86_400 * 1_000_000_000  # a clock that was set right is no reason to distrust it
NO_DIGEST: Final = "0" * 64
_NAME: Final = re.compile(r"([0-9]{1,19})-([0-9]{1,19})\.json")


class State(StrEnum):
    """Where a checkpoint is in its life."""

    CREATING = "CREATING"  # being written, under a name that nobody reads
    COMPLETE = "COMPLETE"  # whole on the disk
    LOADED = "LOADED"  # a proof went by it
    EXPIRED = "EXPIRED"  # beyond the number or the age that is kept: removed


class Trigger(StrEnum):
    """What moves it on."""

    WRITTEN = "written"
    USED = "used"
    OLD = "old"  # or too many are newer
    LEFT = "left"  # whoever was writing it is gone


TABLE: Final[Mapping[tuple[State, Trigger], State]] = MappingProxyType(
    {
        (State.CREATING, Trigger.WRITTEN): State.COMPLETE,
        (State.CREATING, Trigger.LEFT): State.EXPIRED,
        (State.COMPLETE, Trigger.USED): State.LOADED,
        (State.COMPLETE, Trigger.OLD): State.EXPIRED,
        (State.LOADED, Trigger.USED): State.LOADED,
        (State.LOADED, Trigger.OLD): State.EXPIRED,
    }
)


def after(state: State, trigger: Trigger) -> State:
    """Return the state that follows; what the table does not name is a mistake of ours."""
    return TABLE[state, trigger]


class Checkpoint(msgspec.Struct, frozen=True):
    """What the file says (`docs/wires.md` section 22). `hash` and digests are hex; `size` is its own length in bytes."""

    version: int
    state: State
    seq: int
    epoch: int
    hash: str
    at: str
    events: int
    sums: dict[str, str]
    balances_sha256: str
    accounts: int
    size: int
    sha256: str

    @property
    def name(self) -> str:
        """The name of its file."""
        return name_of(self.seq, self.epoch)

    @property
    def attested(self) -> Attestation:
        """What a proof can begin at."""
        return Attestation(self.seq, bytes.fromhex(self.hash), bytes.fromhex(self.balances_sha256), "")


class Stand(msgspec.Struct, frozen=True):
    """What a book says of itself, to hold a checkpoint against. `hash`: that of the checkpoint's event; None: there is none."""

    head_seq: int
    epoch: int
    hash: bytes | None


def made(attested: Attestation, epoch: int, sums: Mapping[str, str], accounts: int, now_ns: int) -> bytes:
    """Return the bytes of a complete checkpoint. `now_ns` is wall time; `sums` are per currency, zero each."""
    checkpoint = Checkpoint(
        version=VERSION,
        state=State.COMPLETE,
        seq=attested.seq,
        epoch=epoch,
        hash=attested.hash.hex(),
        at=timestamp(now_ns),
        events=attested.seq,
        sums=dict(sums),
        balances_sha256=attested.balances.hex(),
        accounts=accounts,
        size=0,
        sha256=NO_DIGEST,
    )
    # Its length has as many digits as its length makes it have: two steps settle that.
    for _ in range(2):
        checkpoint = msgspec.structs.replace(checkpoint, size=len(_encoded(checkpoint)))
    return _encoded(msgspec.structs.replace(checkpoint, sha256=_digest(checkpoint)))


def name_of(seq: int, epoch: int) -> str:
    """Return the name of the file of a checkpoint."""
    return f"{seq}-{epoch}.json"


def seq_of(name: str) -> int | None:
    """Return the number of the last event that a file of this name tells of; None: it is no checkpoint."""
    found = _NAME.fullmatch(name)
    return int(found[1]) if found else None


def read(name: str, data: bytes) -> Checkpoint | str:
    """Return the checkpoint in these bytes, or why they are none that is whole."""
    if not data:
        return "it is empty"
    try:
        found = msgspec.json.decode(data, type=Checkpoint)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        return f"it can't be read ({error})"
    if found.version != VERSION:
        return f"it has version {found.version}"
    if found.state is not State.COMPLETE:
        return "it is not complete"
    if found.size != len(data):
        return f"it has {len(data)} bytes and says {found.size}"
    if found.sha256 != _digest(found) or data != _encoded(found):
        return "its digest is not that of what it says"
    if found.name != name:
        return "it has another's name"
    return found


def misfit(checkpoint: Checkpoint, stand: Stand, now_ns: int) -> str | None:
    """Return why a whole checkpoint is not one of this book, None if it is. `now_ns` is wall time."""
    if checkpoint.seq > stand.head_seq:
        return f"it tells of event {checkpoint.seq}, and the ledger ends at {stand.head_seq}"
    if checkpoint.epoch > stand.epoch:
        return f"it is of epoch {checkpoint.epoch}, and the ledger stands at {stand.epoch}"
    if stand.hash is None or stand.hash.hex() != checkpoint.hash:
        return f"event {checkpoint.seq} of the ledger is another one"
    if _ns_of(checkpoint.at) > now_ns + FUTURE_NS_MAX:
        return f"it says it was made at {checkpoint.at}, which is still to come"
    return None


def _ns_of(at: str) -> int:
    """Return a time in nanoseconds, to the second; one that can't be understood is in no future."""
    try:
        moment = dt.datetime.fromisoformat(at[:19] + "+00:00")
    except ValueError:
        return 0
    return int(moment.timestamp()) * 1_000_000_000


def _encoded(checkpoint: Checkpoint) -> bytes:
    return msgspec.json.encode(checkpoint, order="sorted") + b"\n"


def _digest(checkpoint: Checkpoint) -> str:
    return sha256(_encoded(msgspec.structs.replace(checkpoint, sha256=NO_DIGEST))).hexdigest()
