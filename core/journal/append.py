"""Writing a batch: one transaction, the epoch first, everything or nothing.

The head, the keys and the accounts are read inside the transaction each time. A cache across batches was
measured, gained nothing that stood out of the noise, and would be one more thing that can be older than the
store. What the store raises comes back as a value: before BEGIN has returned nothing was done; from then on,
COMMIT included, nobody can say, and such a journal never writes again.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Final

from sqlalchemy import Connection, bindparam, insert, select, update
from sqlalchemy.exc import DBAPIError

from core.guarded.recorder import FlightRecorder, Stage
from core.journal import schema
from core.journal.answers import (
    Answer,
    DecisionFailed,
    KeyRow,
    LookUp,
    Order,
    OutcomeUnknown,
    Refused,
    StoreBusy,
    Work,
)
from core.journal.batch import Batch
from core.journal.store import StoreError, StoreFault, store_error
from core.ledger.accounts import Account, AccountType
from core.ledger.events import Event

NAMED_IN_FRAME_MAX: Final = 8  # ids kept in a frame's locals; a stack dump shows no more of a line anyway
VARIABLES_MAX: Final = 20_000  # names asked for in one SELECT, below SQLite's limit of 32,766


@dataclass(frozen=True, slots=True)
class Committed:
    """The batch is in the store (or needed nothing of it), one answer for each of its works."""

    answers: tuple[Answer, ...]


@dataclass(frozen=True, slots=True)
class NotBegun:
    """The lock could not be had: nothing was done."""

    answers: tuple[Answer, ...]


@dataclass(frozen=True, slots=True)
class Failed:
    """The store raised inside the transaction: the outcome is unknown."""

    answers: tuple[Answer, ...]
    error: StoreError


@dataclass(frozen=True, slots=True)
class FencedBy:
    """Another core may write now. Nothing was written, and nobody may be answered."""

    actual: int


BatchOutcome = Committed | NotBegun | Failed | FencedBy


class Journal:
    """The writing side of the store, for one epoch. All calls on one thread."""

    def __init__(
        self,
        connection: Connection,
        epoch: int,
        head_seq: int,
        recorder: FlightRecorder,
        wall_ns: Callable[[], int],
    ) -> None:
        """Take the connection that `open_writing` gave, after its fence has raised `epoch`.

        `head_seq`: the last event, as the proof has found it. `wall_ns`: wall time, a label on each event.
        """
        self._connection = connection
        self._epoch = epoch
        self.head_seq = head_seq  # a plain number, so the loop's thread may look at it
        self._recorder = recorder
        self._wall_ns = wall_ns
        self._broken = False

    def write(self, works: Sequence[Work]) -> BatchOutcome:
        """Carry out a batch in one transaction and return its answers, to be given only after this returns."""
        assert not self._broken, "a journal whose COMMIT failed never writes again"
        self._recorder.in_store(on=True)
        try:
            self._connection.exec_driver_sql("BEGIN IMMEDIATE").close()
        except DBAPIError as error:
            return self._at_begin(works, store_error(error))
        try:
            outcome = self._inside(works)
        except DBAPIError as error:
            return self._failed(works, store_error(error))
        if isinstance(outcome, Committed):
            self._recorder.in_store(on=False)
        return outcome

    def close(self) -> None:
        """Close the store. Nothing may be in it any more."""
        self._connection.close()
        self._connection.engine.dispose()

    def _at_begin(self, works: Sequence[Work], error: StoreError) -> NotBegun | Failed:
        if error.fault is not StoreFault.BUSY:
            return self._failed(works, error)
        self._recorder.in_store(on=False)
        self._recorder.event("STORE_BUSY", error.text)
        return NotBegun((StoreBusy(),) * len(works))

    def _failed(self, works: Sequence[Work], error: StoreError) -> Failed:
        # No ROLLBACK: after a failed COMMIT the frames may be in the log already, and whether they come back
        # is for the next core to see. This one touches the store no more.
        self._broken = True
        return Failed((OutcomeUnknown(),) * len(works), error)

    def _inside(self, works: Sequence[Work]) -> Committed | FencedBy:
        meta = self._connection.execute(_META).one()
        if meta.epoch != self._epoch:
            self._connection.exec_driver_sql("ROLLBACK").close()
            return FencedBy(meta.epoch)
        batch = Batch(
            self._epoch,
            meta.head_seq,
            meta.head_hash,
            self._accounts(name for work in works if isinstance(work, Order) for name in work.account_ids),
            self._keys(work.key for work in works if work.key is not None),
        )
        answers = tuple([self._answer(batch, work) for work in works])
        if batch.is_empty:
            self._connection.exec_driver_sql("ROLLBACK").close()
        else:
            self._store(batch, works)
        for work in works:
            self._recorder.stage(work.slot, Stage.COMMITTED)
        if batch.events:
            self.head_seq = batch.head_seq
            self._recorder.witness(batch.head_seq, batch.epoch, batch.head_hash)
        return Committed(answers)

    def _answer(self, batch: Batch, work: Work) -> Answer:
        self._recorder.stage(work.slot, Stage.DECIDING)
        if isinstance(work, LookUp):
            return batch.look_up(work)
        # Plain strings in this frame, so that a stack dump of a hang names the command.
        transaction_id, account_id = work.transaction_id, " ".join(work.account_ids[:NAMED_IN_FRAME_MAX])
        try:
            decision = batch.decide(work)
        # Deciding is ours and pure: whatever it raises is our bug with this one command, it has changed
        # nothing, and the commands beside it are innocent.
        except Exception as error:  # noqa: BLE001
            return DecisionFailed(f"deciding {transaction_id or account_id} raised {error!r}")
        # It waits again, for the rest of its batch: DECIDING must name one command and no other.
        self._recorder.stage(work.slot, Stage.QUEUED)
        if isinstance(decision, Event):
            return batch.take(work, decision, self._wall_ns())
        if isinstance(decision, Refused):
            batch.refuse(work, decision)
        return decision

    def _store(self, batch: Batch, works: Sequence[Work]) -> None:
        for work in works:
            self._recorder.stage(work.slot, Stage.WRITING)
        orders = [work for work in works if isinstance(work, Order)][:NAMED_IN_FRAME_MAX]
        transaction_id = " ".join(order.transaction_id for order in orders)  # noqa: F841  for stack dumps
        account_id = " ".join(  # noqa: F841  for stack dumps
            dict.fromkeys(name for order in orders for name in order.account_ids)
        )
        connection = self._connection
        for statement, rows in (
            (_EVENTS, batch.events),
            (_KEYS, batch.key_rows),
            (_OPEN, [_account_row(batch.book[name]) for name in sorted(batch.opened)]),
            (_CHANGE, [_change_row(batch.book[name]) for name in sorted(batch.changed - batch.opened)]),
            (_BOOKINGS, batch.bookings),
            (_POSTINGS, batch.postings),
        ):
            if rows:
                connection.execute(statement, rows)
        if batch.events:
            moved = connection.execute(
                _HEAD, {"seq": batch.head_seq, "hash": batch.head_hash, "mine": self._epoch}
            )
            assert moved.rowcount == 1, "the epoch changed under an exclusive lock"
        connection.exec_driver_sql("COMMIT").close()

    def _accounts(self, names: Iterable[str]) -> dict[str, Account]:
        book: dict[str, Account] = {}
        for part in _parts(names):
            for row in self._connection.execute(_ACCOUNTS, {"names": part}):
                book[row.id] = account_of(row)
        return book

    def _keys(self, names: Iterable[str]) -> dict[str, KeyRow]:
        keys: dict[str, KeyRow] = {}
        for part in _parts(names):
            for row in self._connection.execute(_KNOWN_KEYS, {"names": part}):
                keys[row.key] = KeyRow(row.fingerprint, row.seq, row.status, row.reply, row.digest)
        return keys


def account_of(row: Any) -> Account:
    """Return the account in a row of the table of accounts."""
    return Account(
        row.id,
        row.name,
        AccountType(row.type),
        row.currency,
        bool(row.no_overdraft),
        row.posted,
        bool(row.closed),
    )


def _parts(names: Iterable[str]) -> Iterable[list[str]]:
    distinct = list(dict.fromkeys(names))
    return [distinct[start : start + VARIABLES_MAX] for start in range(0, len(distinct), VARIABLES_MAX)]


def _account_row(account: Account) -> dict[str, Any]:
    return {
        "id": account.id,
        "name": account.name,
        "type": account.type.value,
        "currency": account.currency,
        "no_overdraft": int(account.no_overdraft),
        "posted": account.posted,
        "closed": int(account.closed),
    }


def _change_row(account: Account) -> dict[str, Any]:
    return {"which": account.id, "new_posted": account.posted, "new_closed": int(account.closed)}


_META: Final = select(schema.meta.c.epoch, schema.meta.c.head_seq, schema.meta.c.head_hash)
_ACCOUNTS: Final = select(schema.account).where(schema.account.c.id.in_(bindparam("names", expanding=True)))
_KNOWN_KEYS: Final = select(schema.idempotency).where(
    schema.idempotency.c.key.in_(bindparam("names", expanding=True))
)
_EVENTS: Final = insert(schema.event)
_KEYS: Final = insert(schema.idempotency)
_BOOKINGS: Final = insert(schema.booking)
_POSTINGS: Final = insert(schema.posting)
_OPEN: Final = insert(schema.account)
_CHANGE: Final = (
    update(schema.account)
    .where(schema.account.c.id == bindparam("which"))
    .values(posted=bindparam("new_posted"), closed=bindparam("new_closed"))
)
_HEAD: Final = (
    update(schema.meta)
    .where(schema.meta.c.epoch == bindparam("mine"))
    .values(head_seq=bindparam("seq"), head_hash=bindparam("hash"))
)
