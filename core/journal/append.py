"""Writing a batch: one transaction, the epoch first, everything or nothing.

The head, the keys and the accounts are read inside the transaction each time. A cache across batches was
measured, gained nothing that stood out of the noise, and would be one more thing that can be older than the
store. What the store raises comes back as a value. Before BEGIN has returned nothing was done. A disk that takes
no write is met before COMMIT was sent, and what was rolled back was not done either; nor is a batch after which
the book would have to be attested and does not stand where it was left. Whatever else is raised, COMMIT above all,
leaves a batch of which nobody can say what became, and such a journal never writes again.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import islice
from types import MappingProxyType
from typing import Any, Final, assert_never

import msgspec
from sqlalchemy import Connection, bindparam, insert, select, update
from sqlalchemy.exc import DBAPIError

from core.guarded.naming import ids_shown
from core.guarded.poison import Armoury, At
from core.guarded.quarantine import Quarantine, Rules
from core.guarded.recorder import FlightRecorder, Stage
from core.journal import queries, schema
from core.journal.answers import (
    OK,
    Answer,
    DecisionFailed,
    Done,
    Each,
    Exercise,
    KeyRow,
    LookUp,
    Order,
    Orders,
    OutcomeUnknown,
    ReadOnly,
    Refused,
    SetAside,
    StoreBusy,
    Touch,
    Work,
    found,
    orders_of,
    repeated,
)
from core.journal.attestation import Balance, attest, attested_before, due_between, standing
from core.journal.batch import Batch
from core.journal.laying import lay_down
from core.journal.proof import check_balances
from core.journal.room import Room
from core.journal.shelf import fetch_book, fetch_keys, parked_orders
from core.journal.store import (
    StoreError,
    StoreFault,
    begin_writing,
    commit,
    is_open,
    store_error,
)
from core.ledger.events import Event, accounts_in

#: What a store that takes no write is called, by its fault.
SHUT: Final = MappingProxyType({StoreFault.NO_ROOM: "DISK_FULL", StoreFault.READ_ONLY: "DISK_READ_ONLY"})
#: Why nothing was written, by the fault: the store did not take it, or the book is not one to be written on.
WHY_NOT: Final = MappingProxyType({**SHUT, StoreFault.DAMAGED: "STORE_CORRUPT"})
NAMED_IN_FRAME_MAX: Final = 8  # orders whose ids are kept in a frame's locals


class Committed(msgspec.Struct, frozen=True):
    """The batch is in the store (or needed nothing of it), one answer for each of its works.

    `events` are those that came of it, each with its number.
    """

    answers: tuple[Answer, ...]
    events: tuple[tuple[int, Event], ...] = ()


class NotBegun(msgspec.Struct, frozen=True):
    """The lock could not be had: nothing was done."""

    answers: tuple[Answer, ...]


class Failed(msgspec.Struct, frozen=True):
    """The store raised inside the transaction: the outcome is unknown."""

    answers: tuple[Answer, ...]
    error: StoreError


class FencedBy(msgspec.Struct, frozen=True):
    """Another core may write now. Nothing was written, and nobody may be answered."""

    actual: int


class NotTaken(msgspec.Struct, frozen=True):
    """Nothing can be written now (see `WHY_NOT`), nothing was done, and what was known before is answered."""

    answers: tuple[Answer, ...]
    error: StoreError


BatchOutcome = Committed | NotBegun | NotTaken | Failed | FencedBy


class Journal:
    """The writing side of the store, for one epoch. All calls on one thread."""

    def __init__(
        self,
        connection: Connection,
        epoch: int,
        head_seq: int,
        recorder: FlightRecorder,
        room: Room,
        wall_ns: Callable[[], int],
        quarantine: Quarantine | None = None,
        armoury: Armoury | None = None,
    ) -> None:
        """Take the connection that `open_writing` gave, after its fence has raised `epoch`.

        `head_seq`: the last event, as the proof has found it. `room`: of the store's file system. `wall_ns`: wall
        time, a label on each event. `quarantine`: accounts on which nothing more is booked, and the events they have
        that from; `armoury`: what a drill kills this process with. Without them there is nothing of the kind.
        """
        self._connection = connection
        self._epoch = epoch
        self.head_seq = head_seq  # a plain number, so the loop's thread may look at it
        self._recorder = recorder
        self._room = room
        self._wall_ns = wall_ns
        self._quarantine = quarantine or Quarantine()
        self._armoury = armoury or Armoury()
        self._broken = False
        self._committing = False

    def write(self, works: Sequence[Work]) -> BatchOutcome:
        """Carry out a batch in one transaction and return its answers, to be given only after this returns."""
        assert not self._broken, "a journal whose COMMIT failed never writes again"
        # Plain strings in this frame, so that a stack dump of a wait for the store names who waits.
        transaction_id, account_id = _named(works)  # noqa: RUF059  for stack dumps
        self._recorder.in_store(on=True)
        try:
            begin_writing(self._connection)
        except DBAPIError as error:
            return self._at_begin(works, store_error(error))
        try:
            outcome = self._inside(works)
        except DBAPIError as error:
            return self._ended_inside(works, store_error(error))
        if not isinstance(outcome, FencedBy):
            self._recorder.in_store(on=False)
        return outcome

    def pretend_full(self, until_ns: int) -> None:
        """Answer as on a full disk until `until_ns`, monotonic: a drill. Any thread."""
        self._room.pretend_full(until_ns)

    def close(self) -> None:
        """Close the store. Nothing may be in it any more."""
        self._connection.close()
        self._connection.engine.dispose()

    def _at_begin(self, works: Sequence[Work], error: StoreError) -> NotBegun | NotTaken | Failed | FencedBy:
        if error.fault in SHUT:
            try:
                keys = fetch_keys(self._connection, works)
                # After the keys: nobody else has committed anything before he has raised the epoch.
                epoch = self._connection.execute(_META).one().epoch
            except DBAPIError as unreadable:
                return self._failed(works, store_error(unreadable))
            if epoch != self._epoch:
                return FencedBy(epoch)
            self._recorder.in_store(on=False)
            return NotTaken(tuple([_recall(keys, work, error) for work in works]), error)
        if error.fault not in {StoreFault.BUSY, StoreFault.AWAY}:
            return self._failed(works, error)
        return self._not_begun(works, error)

    def _ended_inside(self, works: Sequence[Work], error: StoreError) -> NotBegun | Failed:
        # What a server has lost the way to before COMMIT was sent, it undoes; of a file nothing is lost.
        if error.fault is StoreFault.AWAY and not self._committing:
            return self._not_begun(works, error)
        return self._failed(works, error)

    def _not_begun(self, works: Sequence[Work], error: StoreError) -> NotBegun:
        self._recorder.in_store(on=False)
        self._recorder.event(f"STORE_{error.fault.name}", error.text)
        return NotBegun(tuple([_told(work, StoreBusy()) for work in works]))

    def _failed(self, works: Sequence[Work], error: StoreError) -> Failed:
        # No ROLLBACK: after a failed COMMIT the frames may be in the log already, and whether they come back
        # is for the next core to see. This one touches the store no more.
        self._broken = True
        return Failed(tuple([_told(work, OutcomeUnknown()) for work in works]), error)

    def _inside(self, works: Sequence[Work]) -> Committed | NotTaken | FencedBy:
        meta = self._connection.execute(_META).one()
        if meta.epoch != self._epoch:
            self._connection.exec_driver_sql("ROLLBACK").close()
            return FencedBy(meta.epoch)
        keys = fetch_keys(self._connection, works)
        if meta.head_seq < self.head_seq:
            # A server may be given an older state while a core lives; what follows on it would be lost again.
            self._connection.exec_driver_sql("ROLLBACK").close()
            text = f"it ends with event {meta.head_seq}, and {self.head_seq} was committed"
            gone = StoreError(StoreFault.DAMAGED, text)
            return NotTaken(tuple([_recall(keys, work, gone) for work in works]), gone)
        orders = list(orders_of(works))
        aside = self._aside(orders)
        touching = [order for order in orders if order.command_id not in aside] if aside else orders
        book = fetch_book(self._connection, touching)
        batch = Batch(self._epoch, meta.head_seq, meta.head_hash, book, dict(keys))
        answers = tuple([self._answer(batch, work, aside) for work in works])
        if batch.is_empty and not any(_must_write(work) for work in works):
            self._connection.exec_driver_sql("ROLLBACK").close()
        elif (error := self._lay_down(batch, works)) is not None:
            return NotTaken(tuple([_recall(keys, work, error) for work in works]), error)
        else:
            self._committing = True
            commit(self._connection)
            self._committing = False
            self._strike(At.LATER, batch, works)
        for work in works:
            self._recorder.stage(work.slot, Stage.COMMITTED)
        if batch.events:
            self.head_seq = batch.head_seq
            self._recorder.witness(batch.head_seq, batch.epoch, batch.head_hash)
        return Committed(answers, tuple(batch.happened))

    def _lay_down(self, batch: Batch, works: Sequence[Work]) -> StoreError | None:
        """Write the batch, all but its COMMIT; return why it can't be written, with nothing left of it."""
        error = self._room.fault(batch.bytes_written)
        if error is None:
            try:
                self._store(batch, works)
                error = self._attest(batch)
            except DBAPIError as raised:
                error = store_error(raised)
                if error.fault not in SHUT:
                    raise
        if error is not None and is_open(self._connection):
            # Where SQLite has rolled back by itself nothing is open. Where this raises, the outcome is unknown.
            self._connection.exec_driver_sql("ROLLBACK").close()
        return error

    def _aside(self, orders: Sequence[Order]) -> Mapping[str, SetAside]:
        """Return, by its id, what is answered to each command that must begin with an event that is left out.

        Deciding one of them would begin with reading that event.
        """
        rules = self._quarantine.rules
        if not rules.parked:
            return {}
        found = parked_orders(self._connection, orders, rules.parked)
        return {command_id: _parked(rules, seq) for command_id, seq in found.items()}

    def _strike(self, at: At, batch: Batch, works: Sequence[Work]) -> None:
        """Have a drill's command kill this process, where it is in the batch and is carried out, not told again."""
        if self._armoury.armed is None:
            return
        booked = {row["command_id"] for row in batch.events}
        self._armoury.strike(
            at,
            {
                *(work.name for work in works if isinstance(work, Exercise)),
                *(order.name for order in orders_of(works) if order.command_id in booked),
            },
        )

    def _answer(self, batch: Batch, work: Work, aside: Mapping[str, SetAside]) -> Answer:
        self._recorder.stage(work.slot, Stage.DECIDING)
        answer = self._judge(batch, work, aside)
        # It waits again, for the rest of its batch: DECIDING must name one work and no other.
        self._recorder.stage(work.slot, Stage.QUEUED)
        return answer

    def _judge(self, batch: Batch, work: Work, aside: Mapping[str, SetAside]) -> Answer:
        match work:
            case LookUp():
                return batch.look_up(work)
            case Exercise():
                self._armoury.strike(At.DECIDE, (work.name,))
                return _exercise(work)
            case Touch():
                return Done(OK, b"{}")
            case Order():
                return self._decide(batch, work, aside.get(work.command_id))
            case Orders(orders=orders):
                return Each(tuple([self._decide(batch, one, aside.get(one.command_id)) for one in orders]))
            case _:
                assert_never(work)

    def _decide(self, batch: Batch, work: Order, aside: SetAside | None) -> Answer:
        # Plain strings in this frame, so that a stack dump of a hang names the command.
        transaction_id, account_id = work.transaction_id, ids_shown(work.account_ids)
        is_new = work.key is None or work.key not in batch.keys
        if is_new and aside is not None:
            return aside
        if is_new:
            self._armoury.strike(At.DECIDE, (work.name,))
        wall_ns = self._wall_ns()
        try:
            decision = batch.decide(work, wall_ns)
        # Deciding is ours and pure: whatever it raises is our bug with this one command, it has changed
        # nothing, and the commands beside it are innocent.
        except Exception as error:  # noqa: BLE001
            return DecisionFailed(f"deciding {transaction_id or account_id} raised {error!r}")
        if isinstance(decision, tuple):
            marked = self._quarantine.rules.marked
            if (
                marked
                and (name := next((one for one in _touched(decision) if one in marked), None)) is not None
            ):
                return SetAside(marked[name], name)
            return batch.take(work, decision, wall_ns)
        if isinstance(decision, Refused):
            batch.refuse(work, decision)
        return decision

    def _store(self, batch: Batch, works: Sequence[Work]) -> None:
        for work in works:
            # Nothing is written for a look-up: its key is no suspect of a write that ends badly.
            if not isinstance(work, LookUp):
                self._recorder.stage(work.slot, Stage.WRITING)
        self._strike(At.WRITE, batch, works)
        transaction_id, account_id = _named(works)  # noqa: RUF059  for stack dumps
        lay_down(self._connection, batch)
        # Of nothing, it is the write without effect that a `Touch` asks for.
        if batch.events or batch.is_empty:
            moved = self._connection.execute(
                _HEAD, {"seq": batch.head_seq, "hash": batch.head_hash, "mine": self._epoch}
            )
            assert moved.rowcount == 1, "the epoch changed under an exclusive lock"

    def _attest(self, batch: Batch) -> StoreError | None:
        """Attest what falls due within a batch that was laid down; return why it must not be, with nothing attested."""
        due = due_between(batch.head_seq - len(batch.events), batch.head_seq)
        if not due:
            return None
        now = queries.balances(self._connection)
        base = attested_before(queries.newest_attestation(self._connection), due[0] - 1)
        moved = queries.moved_between(self._connection, base.seq + 1) if base is not None else {}
        broken = check_balances(base, now, moved)
        if broken is not None:
            return StoreError(StoreFault.DAMAGED, broken.sentence)
        self._connection.execute(_ATTEST, _attested(batch, due, now))
        return None


def _attested(batch: Batch, due: Sequence[int], now: Sequence[Balance]) -> list[dict[str, Any]]:
    """Return the attestations of a batch. `now`: all balances, as they stand after it."""
    hashes = {row["seq"]: row["hash"] for row in batch.events if row["seq"] in due}
    made = []
    for seq in due:
        moved: dict[str, int] = {}
        for row in batch.postings:
            if row["seq"] > seq:
                moved[row["account_id"]] = moved.get(row["account_id"], 0) + row["amount"]
        for at, name, amount in batch.reserved:
            if at > seq:
                moved[name] = moved.get(name, 0) + amount
        made.append(msgspec.structs.asdict(attest(seq, hashes[seq], standing(now, moved))))
    return made


def _touched(events: Sequence[Event]) -> Iterator[str]:
    """Return the accounts that events book on, open or close."""
    for event in events:
        yield from accounts_in(event)


def _parked(rules: Rules, seq: int) -> SetAside:
    """Return what is answered to a change of an entry that stands in this event, which is left out."""
    parked = rules.parked[seq]
    return SetAside(parked.letter, next(iter(parked.account_ids), None))


def _exercise(work: Exercise) -> Done:
    transaction_id, account_id = work.transaction_id, work.account_id  # noqa: F841  for stack dumps
    if work.run is not None:
        work.run()
    return Done(OK, b"{}")


def _must_write(work: Work) -> bool:
    """Whether a work asks the store to take a write though nothing is booked for it."""
    return isinstance(work, Touch) or (isinstance(work, Exercise) and work.run is None)


def _told(work: Work, answer: Answer) -> Answer:
    """Return the same answer for all that is in a work."""
    return Each((answer,) * len(work.orders)) if isinstance(work, Orders) else answer


def _recall(keys: Mapping[str, KeyRow], work: Work, error: StoreError) -> Answer:
    """Return what was known of a work before its batch, which the store did not take."""
    match work:
        case LookUp(key=str(key)):
            return found(keys.get(key), work.digest)
        case Order(key=str(key)) if key in keys:
            return repeated(keys[key], work.fingerprint)
        case Orders(orders=orders):
            return Each(tuple([_recall(keys, one, error) for one in orders]))
        case _:
            return ReadOnly(WHY_NOT[error.fault])


def _named(works: Sequence[Work]) -> tuple[str, str]:
    """Return the transactions and the accounts of a batch's orders, as a stack dump shows them."""
    orders = list(islice(orders_of(works), NAMED_IN_FRAME_MAX))
    accounts = (name for order in orders for name in order.account_ids)
    return ids_shown(order.transaction_id for order in orders), ids_shown(accounts)


_META: Final = select(schema.meta.c.epoch, schema.meta.c.head_seq, schema.meta.c.head_hash)
_ATTEST: Final = insert(schema.attestation)
_HEAD: Final = (
    update(schema.meta)
    .where(schema.meta.c.epoch == bindparam("mine"))
    .values(head_seq=bindparam("seq"), head_hash=bindparam("hash"))
)
