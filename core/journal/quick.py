"""The quick proof: from the last good ground to the head, in slices, beside whoever writes.

It is the proof before serving without a witness, taken at a later moment: everything since the ground is hashed, and all
balances are held against it at the head. It costs what was booked since, so it can be made every minute; each one is the
ground of the next. What it does not see again is what lies before the ground: that is the whole proof's (`verify`).
"""

from collections.abc import Callable

import msgspec
from sqlalchemy import Connection, Engine
from sqlalchemy.exc import DBAPIError

from core.journal.ahead import Ahead
from core.journal.attestation import Attestation, attest, is_of_account, standing
from core.journal.chain import Broken
from core.journal.ground import Ground
from core.journal.proof import Proven, prove, sums_by_currency
from core.journal.rebuilding import Rebuilding
from core.journal.store import StoreError, snapshot, store_error
from core.journal.verify import GivenUp
from core.ledger.money import format_amount


class Quick(msgspec.Struct, frozen=True):
    """The book is whole from its ground to its head. `attested`: what stands there now; `sums`: per currency, zero each.

    `grounded`: the balances could be held against something; they can't in a book without any ground yet.
    """

    proof: Proven
    attested: Attestation
    epoch: int
    sums: dict[str, str]
    accounts: int
    grounded: bool


def prove_quickly(
    readers: Engine,
    slice_ms_max: int,
    tail_events: int,
    ground: Ground,
    is_leaving: Callable[[], bool],
    rebuilding: Rebuilding | None = None,
) -> Quick | Broken | StoreError | GivenUp:
    """Prove the book from its ground. Blocks; `is_leaving` is asked between two slices."""
    gate = rebuilding or Rebuilding()
    ahead = Ahead(tail_events, gate, ground)
    try:
        while not is_leaving():
            with snapshot(readers, slice_ms_max) as connection:
                if ahead.follow(connection):
                    return _at_the_head(connection, ahead, gate)
    except DBAPIError as error:
        return store_error(error)
    return GivenUp()


def _at_the_head(connection: Connection, ahead: Ahead, gate: Rebuilding) -> Quick | Broken:
    tail = ahead.tail(connection, ())
    if isinstance(tail, Broken):
        return tail
    grounded = tail.walk.base is not None
    proof = prove(msgspec.structs.replace(tail, rows=gate.over(tail.rows)), ())
    if isinstance(proof, Broken):
        return proof
    sums = {name: format_amount(total, name) for name, total in sums_by_currency(tail.balances).items()}
    accounts = sum(1 for name, *_ in tail.balances if is_of_account(name))
    attested = attest(proof.head_seq, proof.head_hash, standing(tail.balances, {}))
    return Quick(proof, attested, tail.epoch, sums, accounts, grounded)
