"""Proof A: before a core serves, the tail of the book is shown to be whole, in bounded time.

Pure: functions over rows that somebody read at one moment. The tail begins after the last attestation, or where a
walk along the chain has come that this very process began earlier: a spare walks ahead while it waits, so that few
events are left when it is promoted. All witnesses are looked up, each commit that somebody saw, wherever in the book
it lies; without any (nobody saw one, or the machine was started anew) the proof says that it rests on the chain
alone. A head *behind* a witness means that an acknowledged event is gone; a head ahead of it is normal, because the
predecessor can die between its COMMIT and its last note (136 of 300 kills). And the balances must be those that were
attested, moved by what was posted since.
"""

from collections.abc import Iterable, Mapping, Sequence
from enum import StrEnum

import msgspec

from core.journal.attestation import Attestation, Balance, attest, standing
from core.journal.chain import Broken, EventRow, check_link


class Witness(msgspec.Struct, frozen=True):
    """A commit that somebody saw: its number, the epoch of whoever told it, and its hash (32 bytes)."""

    seq: int
    epoch: int
    hash: bytes


class Walk(msgspec.Struct):
    """A walk along the chain: where it began, where it has come, and what it met on its way.

    `base`: what was attested where it began; None: nothing was (a ledger that was brought up to attestations and
    has not come to its first one). `last`: the last event seen whole; None: it begins with the first of all.
    `moved`: what was posted to each account between the two, in minor units. `checked`: how many events were hashed.
    """

    base: Attestation | None
    last: EventRow | None
    moved: dict[str, int] = {}
    checked: int = 0

    @property
    def seq(self) -> int:
        """The number of the last event that was seen whole."""
        return self.last.seq if self.last else 0

    def take(self, row: EventRow, keys: dict[int, str]) -> Broken | None:
        """Go on to the next event, or say why it can't be that one; takes the row of its key out of `keys`."""
        broken = check_link(self.last, row) or check_key(row, keys)
        if broken is None:
            self.last = row
            self.checked += 1
        return broken

    def post(self, moved: Mapping[str, int]) -> None:
        """Note what was posted by the events that were taken."""
        for name, amount in moved.items():
            self.moved[name] = self.moved.get(name, 0) + amount


class Tail(msgspec.Struct, frozen=True):
    """What is read for the proof, at one moment.

    `head_*` is what the store says of itself; `walk` is as far as the chain has been seen, and `hashes` are those of
    the events that it and the witnesses speak of, by number, as they stand now. `rows` are the events from there to
    the last one stored, in order; `keys` the rows of keys whose event is among them, by its number; `moved` what is
    listed as posted by them. `balances` are all accounts.
    """

    head_seq: int
    head_hash: bytes
    epoch: int
    walk: Walk
    hashes: Mapping[int, bytes]
    rows: Iterable[EventRow]
    keys: Mapping[int, str]
    moved: Mapping[str, int]
    balances: Sequence[Balance]


class ProofKind(StrEnum):
    """What a proof rests on."""

    WITNESS = "witness"
    CHAIN = "chain"


class Proven(msgspec.Struct, frozen=True):
    """The tail is whole: what the proof rests on, how many events were hashed for it in this life, and the head."""

    kind: ProofKind
    tail: int
    head_seq: int
    head_hash: bytes


def prove(tail: Tail, witnesses: Sequence[Witness]) -> Proven | Broken:
    """Return the proof, or the exact place where it fails. The walk of the tail is at its end then."""
    walk = tail.walk
    broken = _check_witnesses(tail, witnesses) or _check_start(tail)
    if broken is not None:
        return broken
    keys = dict(tail.keys)
    for row in tail.rows:
        broken = walk.take(row, keys)
        if broken is not None:
            return broken
    walk.post(tail.moved)
    return _check_end(tail, keys) or Proven(
        ProofKind.WITNESS if witnesses else ProofKind.CHAIN, walk.checked, tail.head_seq, tail.head_hash
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


def _check_witnesses(tail: Tail, witnesses: Sequence[Witness]) -> Broken | None:
    for number, witness in enumerate(witnesses, 1):
        who = f"witness {number} of {len(witnesses)}, of epoch {witness.epoch}, saw"
        if tail.head_seq < witness.seq:
            sentence = (
                f"it ends at event {tail.head_seq}, but event {witness.seq} had been committed, as {who}"
            )
            return Broken(tail.head_seq + 1, sentence)
        # The hash covers the event's epoch. The witness's own may be a later core's, which proved this event and
        # died without committing another: to compare it called a whole ledger damaged.
        if tail.hashes.get(witness.seq) != witness.hash:
            sentence = f"event {witness.seq} is not the one that was committed under this number, which {who}"
            return Broken(witness.seq, sentence)
    return None


def _check_start(tail: Tail) -> Broken | None:
    """Say whether the event from which the walk goes on is still the one that it met."""
    last = tail.walk.last
    if last is None or tail.hashes.get(last.seq) == last.hash:
        return None
    if last.seq not in tail.hashes:
        return Broken(last.seq, f"event {last.seq} is missing")
    return Broken(last.seq, f"event {last.seq} is not the one that was seen or attested under this number")


def _check_end(tail: Tail, keys: Mapping[int, str]) -> Broken | None:
    walk = tail.walk
    if walk.seq != tail.head_seq:
        return Broken(
            min(walk.seq, tail.head_seq) + 1,
            f"the store's head is {tail.head_seq}, its last event {walk.seq}",
        )
    if walk.last is not None and (walk.last.hash != tail.head_hash or walk.last.epoch > tail.epoch):
        return Broken(walk.seq, f"event {walk.seq} is not the head that the store remembers")
    if keys:
        orphan = min(keys)
        return Broken(orphan, f"a key names event {orphan}, which does not carry it")
    return check_sums(sums_by_currency(tail.balances)) or check_balances(
        tail.walk.base, tail.balances, tail.walk.moved
    )


def check_balances(
    base: Attestation | None, balances: Iterable[Balance], moved: Mapping[str, int]
) -> Broken | None:
    """Say whether the balances are those that were attested last, `moved` by what was posted since.

    `base` None: nothing was attested (see `Walk`), so nothing can be said.
    """
    if base is None:
        return None
    stood = attest(base.seq, base.hash, standing(balances, moved))
    if stood.balances == base.balances:
        return None
    since = f"attested after event {base.seq}" if base.seq else "nothing"
    return Broken(None, f"the accounts do not stand where {since} and what was posted since have left them")


def sums_by_currency(balances: Iterable[Balance]) -> dict[str, int]:
    """Return the sum of the balances per currency. Added here: SQL's sum would overflow at 64 bits."""
    sums: dict[str, int] = {}
    for _, currency, amount in balances:
        sums[currency] = sums.get(currency, 0) + amount
    return sums
