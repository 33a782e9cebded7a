"""A batch in memory: commands one after the other on a view of the book, and the rows they make.

Pure: it is given what the store knows (head, the accounts and keys the batch may touch) and makes what the
store is to be told. Each command sees the effects of those before it, keys included, so the same key twice in
one batch is answered twice and carried out once. A refused command changes nothing but the row of its key.
"""

from dataclasses import dataclass, field
from typing import Any

import msgspec

from core.journal.answers import (
    CREATED,
    OK,
    Answer,
    Done,
    KeyRow,
    KeyTaken,
    KeyUnknown,
    LookUp,
    Order,
    Refused,
    keep,
    replay,
)
from core.journal.chain import EventRow, hash_of
from core.ledger.accounts import Account
from core.ledger.decider import decide, evolve
from core.ledger.events import (
    AccountClosed,
    AccountOpened,
    Event,
    TransactionPosted,
    encode,
    kind_of,
    postings_of,
)
from core.ledger.reasons import Rejection
from core.ledger.views import Place, answer_account, view_transaction

Row = dict[str, Any]


@dataclass(slots=True)
class Batch:
    """Head, accounts and keys as they stand after the commands taken so far, and the rows to be written."""

    epoch: int
    head_seq: int
    head_hash: bytes
    book: dict[str, Account]
    keys: dict[str, KeyRow]
    events: list[Row] = field(default_factory=list)
    key_rows: list[Row] = field(default_factory=list)
    bookings: list[Row] = field(default_factory=list)
    postings: list[Row] = field(default_factory=list)
    opened: set[str] = field(default_factory=set)
    changed: set[str] = field(default_factory=set)

    def look_up(self, work: LookUp) -> Answer:
        """Return what became of a key. Another request's answer is never told for the one that is meant."""
        row = self.keys.get(work.key)
        if row is None:
            return KeyUnknown()
        return replay(row) if work.digest in {None, row.digest} else KeyTaken()

    def decide(self, order: Order) -> Event | Done | Refused | KeyTaken:
        """Return the event that carries the command out, or the answer that needs none. Changes nothing."""
        known = self.keys.get(order.key) if order.key is not None else None
        if known is not None:
            return replay(known) if known.fingerprint == order.fingerprint else KeyTaken()
        decision = decide(order.command, self.book)
        if isinstance(decision, Rejection):
            return Refused(decision)
        (event,) = decision  # one command, one event, one number: what a key stands for
        return event

    def refuse(self, order: Order, refused: Refused) -> None:
        """Keep a refusal under the key of its command, so that a retry can't be told anything else."""
        if not refused.replayed:
            self._keep(order, refused, None)

    def take(self, order: Order, event: Event, wall_ns: int) -> Done:
        """Append the event at wall time `wall_ns`, take its effects into the view and return the answer."""
        place = self._append(order, event, wall_ns)
        self.book.update(evolve(self.book, event))
        self._project(event, place.seq)
        answer = self._tell(event, place)
        self._keep(order, answer, place.seq)
        return answer

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing to write."""
        return not self.events and not self.key_rows

    def _append(self, order: Order, event: Event, wall_ns: int) -> Place:
        seq = self.head_seq + 1
        body = encode(event)
        row = EventRow(seq, self.epoch, wall_ns, kind_of(event), order.command_id, order.key, body)
        digest = hash_of(self.head_hash, row)
        self.events.append(
            {
                "seq": seq,
                "epoch": self.epoch,
                "booked_ns": wall_ns,
                "kind": row.kind,
                "command_id": row.command_id,
                "key": row.key,
                "body": body,
                "hash": digest,
            }
        )
        self.head_seq, self.head_hash = seq, digest
        return Place(seq, self.epoch, wall_ns, digest)

    def _tell(self, event: Event, place: Place) -> Done:
        match event:
            case TransactionPosted():
                return Done(CREATED, msgspec.json.encode(view_transaction(event, place)))
            case AccountOpened():
                return Done(CREATED, msgspec.json.encode(answer_account(self.book[event.id], place)))
            case AccountClosed():
                return Done(OK, msgspec.json.encode(answer_account(self.book[event.id], place)))

    def _project(self, event: Event, seq: int) -> None:
        match event:
            case AccountOpened(id=name):
                self.opened.add(name)
            case AccountClosed(id=name):
                self.changed.add(name)
            case TransactionPosted():
                self.bookings.append(
                    {"id": event.id, "seq": seq, "date": event.date, "description": event.description}
                )
                for line, posting in enumerate(postings_of(event)):
                    self.changed.add(posting.account)
                    self.postings.append(
                        {"seq": seq, "line": line, "account_id": posting.account, "amount": posting.amount}
                    )

    def _keep(self, order: Order, answer: Done | Refused, seq: int | None) -> None:
        if order.key is None:
            return
        row = keep(answer, order, seq)
        self.keys[order.key] = row
        self.key_rows.append({"key": order.key, **msgspec.structs.asdict(row)})
