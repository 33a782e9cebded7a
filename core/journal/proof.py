"""Proof A: before a core serves, the tail of the book is shown to be whole, in bounded time.

Pure: a function over rows that somebody read at one moment. The tail begins at the witness, the last commit
that the predecessor told somebody about; without one (nobody saw it, or the machine was started anew) it is
the last thousand events, and the proof says that it rests on the chain alone. A head *behind* the witness
means that an acknowledged event is gone; a head ahead of it is normal, because the predecessor can die
between its COMMIT and its last note (136 of 300 kills).
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum

from core.journal.chain import Broken, EventRow, check_link


@dataclass(frozen=True, slots=True)
class Witness:
    """The last commit that somebody saw: its number, its epoch and its hash (32 bytes)."""

    seq: int
    epoch: int
    hash: bytes


@dataclass(frozen=True, slots=True)
class Tail:
    """What is read for the proof, at one moment.

    `head_*` is what the store says of itself; `rows` are the events from `first_seq` to the last one stored,
    in order; `before` is the event just before them; `balances` are the sums of all accounts per currency in
    minor units; `keys` are the rows of keys whose event lies in the tail, by that event's number.
    """

    head_seq: int
    head_hash: bytes
    epoch: int
    first_seq: int
    before: EventRow | None
    rows: Iterable[EventRow]
    balances: Mapping[str, int]
    keys: Mapping[int, str]


class ProofKind(StrEnum):
    """What a proof rests on."""

    WITNESS = "witness"
    CHAIN = "chain"


@dataclass(frozen=True, slots=True)
class Proven:
    """The tail is whole: what the proof rests on, how many events were hashed again, and the head."""

    kind: ProofKind
    tail: int
    head_seq: int
    head_hash: bytes


def tail_start(head_seq: int, witness: Witness | None, tail_events: int) -> int:
    """Return the number of the first event of the tail: the witness's own, or that many before the head."""
    if witness is not None and witness.seq > 0:
        return witness.seq
    return max(1, head_seq - tail_events + 1)


def prove(tail: Tail, witness: Witness | None) -> Proven | Broken:
    """Return the proof, or the exact place where it fails."""
    if witness is not None and tail.head_seq < witness.seq:
        sentence = f"the ledger ends at event {tail.head_seq}, but event {witness.seq} had been committed"
        return Broken(tail.head_seq + 1, sentence)
    if tail.before is None and tail.first_seq > 1:
        return Broken(tail.first_seq - 1, f"event {tail.first_seq - 1} is missing")
    checked = 0
    last = tail.before
    keys = dict(tail.keys)
    for row in tail.rows:
        broken = check_link(last, row) or _check_witness(row, witness) or check_key(row, keys)
        if broken is not None:
            return broken
        checked += 1
        last = row
    return _check_end(tail, last, keys) or Proven(
        ProofKind.WITNESS if witness else ProofKind.CHAIN, checked, tail.head_seq, tail.head_hash
    )


def check_key(row: EventRow, keys: dict[int, str]) -> Broken | None:
    """Say whether the event and the row of its key name each other; takes that row out of `keys`."""
    kept = keys.pop(row.seq, None)
    if kept == row.key:
        return None
    return Broken(row.seq, f"event {row.seq} and the row of its key do not name each other")


def check_sums(balances: Mapping[str, int]) -> Broken | None:
    """Say which currency's accounts do not add up to zero."""
    for currency, total in sorted(balances.items()):
        if total != 0:
            return Broken(None, f"the accounts in {currency} add up to {total} minor units instead of zero")
    return None


def _check_witness(row: EventRow, witness: Witness | None) -> Broken | None:
    if witness is None or row.seq != witness.seq:
        return None
    # The hash covers the event's epoch. The witness's own may be a later core's, which proved this event and
    # died without committing another: to compare it called a whole ledger damaged.
    if row.hash == witness.hash:
        return None
    return Broken(row.seq, f"event {row.seq} is not the one that was committed under this number")


def _check_end(tail: Tail, last: EventRow | None, keys: Mapping[int, str]) -> Broken | None:
    seq = last.seq if last else 0
    if seq != tail.head_seq:
        return Broken(
            min(seq, tail.head_seq) + 1, f"the store's head is {tail.head_seq}, its last event {seq}"
        )
    if last is not None and (last.hash != tail.head_hash or last.epoch > tail.epoch):
        return Broken(seq, f"event {seq} is not the head that the store remembers")
    if keys:
        orphan = min(keys)
        return Broken(orphan, f"a key names event {orphan}, which does not carry it")
    return check_sums(tail.balances)
