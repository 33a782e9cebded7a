"""A batch in memory: commands one after the other on a view of the book, and the rows they make.

Pure: it is given what the store knows (head, the accounts and keys the batch may touch) and makes what the
store is to be told. Each command sees the effects of those before it, keys included, so the same key twice in
one batch is answered twice and carried out once. A refused command changes nothing but the row of its key.
A command may take several events (an account that is opened for an entry, the reversal before what replaces
it): they get numbers one after the other in the same transaction, and the last of them carries the key.
Commands of their own for each were not chosen: a death between two of them would leave half a wish.
"""

from collections.abc import Sequence
from typing import Any, assert_never

import msgspec

from core.journal.answers import (
    CREATED,
    OK,
    Answer,
    Commit,
    Done,
    KeyRow,
    KeyTaken,
    LookUp,
    Order,
    Refused,
    found,
    keep,
    repeated,
)
from core.journal.attestation import pending_move
from core.journal.chain import EventRow, hash_of
from core.journal.schema_plans import budget_row
from core.ledger.book import Book, KnownBooking, KnownEntry, KnownPending, PendingState
from core.ledger.commands import AtomicBatch, ReverseTransaction
from core.ledger.decider import EVENTS_PER_BATCH_MAX, EVENTS_PER_COMMAND_MAX, decide
from core.ledger.entries import RecordEntry
from core.ledger.events import (
    AccountClosed,
    AccountOpened,
    BalanceAsserted,
    Booking,
    EntryPosted,
    Event,
    PendingExpired,
    PendingPosted,
    PendingVoided,
    Release,
    TransactionPending,
    TransactionPosted,
    TransactionReversed,
    asserted_amounts,
    encode,
    expiry_of,
    kind_of,
    postings_of,
    released_by,
)
from core.ledger.evolving import evolve
from core.ledger.plan_views import answer_plan
from core.ledger.plans import BudgetSet, KnownRecurring, RecurringEnded, RecurringSet, SetRecurring
from core.ledger.reasons import Rejection, Slug
from core.ledger.views import (
    Place,
    answer_account,
    answer_batch,
    answer_end,
    answer_reversal,
    view_assertion,
    view_entry,
    view_pending,
    view_transaction,
)

Row = dict[str, Any]


class Batch(msgspec.Struct):
    """Head, book and keys as they stand after the commands taken so far, and the rows to be written.

    `happened` are the events with their numbers; `reversed_seqs` those whose postings stand no longer; `reserved` what
    each event has moved of what is pending, as `attestation.pending_moves` names it.
    """

    epoch: int
    head_seq: int
    head_hash: bytes
    book: Book
    keys: dict[str, KeyRow]
    events: list[Row] = []
    key_rows: list[Row] = []
    bookings: list[Row] = []
    postings: list[Row] = []
    reversals: list[Row] = []
    pendings: list[Row] = []
    pending_postings: list[Row] = []
    endings: list[Row] = []
    assertions: list[Row] = []
    budgets: list[Row] = []
    recurrings: list[Row] = []
    origins: list[Row] = []
    happened: list[tuple[int, Event]] = []
    reversed_seqs: list[int] = []
    reserved: list[tuple[int, str, int]] = []
    opened: set[str] = set()
    changed: set[str] = set()
    entered: set[str] = set()
    altered: set[str] = set()

    def look_up(self, work: LookUp) -> Answer:
        """Return what became of a key."""
        return found(self.keys.get(work.key), work.digest)

    def decide(self, order: Order, wall_ns: int) -> tuple[Event, ...] | Done | Refused | KeyTaken:
        """Return the events that carry the command out, or the answer that needs none. Changes nothing.

        `wall_ns`: the moment at which it is decided, and which its events will bear.
        """
        self.book.now_ns = wall_ns
        known = self.keys.get(order.key) if order.key is not None else None
        if known is not None:
            return repeated(known, order.fingerprint)
        decision = decide(order.command, self.book)
        return Refused(decision) if isinstance(decision, Rejection) else decision

    def refuse(self, order: Order, refused: Refused) -> None:
        """Keep a refusal under the key of its command, so that a retry can't be told anything else.

        But not that it is too early: the clock alone takes that back, and the same wish must then be done under its key.
        """
        if not refused.replayed and refused.rejection.slug is not Slug.NOT_YET_EXPIRED:
            self._keep(order, refused, None)

    def take(self, order: Order, events: Sequence[Event], wall_ns: int) -> Done:
        """Append the events at wall time `wall_ns`, take their effects into the view and return the answer.

        The last event is the one that was wished for: it carries the key and makes the answer.
        """
        is_batch = isinstance(order.command, AtomicBatch)
        assert 0 < len(events) <= (EVENTS_PER_BATCH_MAX if is_batch else EVENTS_PER_COMMAND_MAX), (
            "a command that is carried out happens, and so often"
        )
        places = [self._happen(order, event, None, wall_ns) for event in events[:-1]]
        place = self._happen(order, events[-1], order.key, wall_ns)
        if is_batch:
            told = answer_batch(zip(events, [*places, place], strict=True))
            answer = Done(CREATED, msgspec.json.encode(told))
        else:
            answer = self._tell(order, events[-1], place)
        answer = msgspec.structs.replace(answer, commit=Commit(place.seq, place.hash))
        self._keep(order, answer, place.seq)
        return answer

    def follow(self, row: EventRow, event: Event) -> None:
        """Take in an event of another book as it stands there, with its number, its epoch and its hash."""
        self.events.append(msgspec.structs.asdict(row))
        self.epoch, self.head_seq, self.head_hash = row.epoch, row.seq, row.hash
        self.happened.append((row.seq, event))
        self.book.update(evolve(self.book.accounts, event))
        self._project(event, row.seq)

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing to write."""
        return not self.events and not self.key_rows

    @property
    def bytes_written(self) -> int:
        """How long the bodies and answers are that are to be written: what a batch is large by."""
        return sum(len(row["body"]) for row in self.events) + sum(len(row["reply"]) for row in self.key_rows)

    def _happen(self, order: Order, event: Event, key: str | None, wall_ns: int) -> Place:
        place = self._append(order.command_id, event, key, wall_ns)
        self.happened.append((place.seq, event))
        self.book.update(evolve(self.book.accounts, event))
        self._project(event, place.seq)
        return place

    def _append(self, command_id: str, event: Event, key: str | None, wall_ns: int) -> Place:
        seq = self.head_seq + 1
        row = EventRow(seq, self.epoch, wall_ns, kind_of(event), command_id, key, encode(event))
        digest = hash_of(self.head_hash, row)
        self.events.append(
            {
                "seq": seq,
                "epoch": self.epoch,
                "booked_ns": wall_ns,
                "kind": row.kind,
                "command_id": row.command_id,
                "key": row.key,
                "body": row.body,
                "hash": digest,
            }
        )
        self.head_seq, self.head_hash = seq, digest
        return Place(seq, self.epoch, wall_ns, digest)

    def _tell(self, order: Order, event: Event, place: Place) -> Done:
        match event:
            case TransactionPosted() | PendingPosted():
                return Done(CREATED, msgspec.json.encode(view_transaction(event, place)))
            case TransactionPending():
                return Done(CREATED, msgspec.json.encode(view_pending(event, place)))
            case PendingVoided() | PendingExpired():
                return Done(OK, msgspec.json.encode(answer_end(event, place)))
            case BalanceAsserted():
                return Done(CREATED, msgspec.json.encode(view_assertion(event, place)))
            case BudgetSet() | RecurringSet() | RecurringEnded():
                is_new = isinstance(order.command, SetRecurring) and order.command.is_new
                return Done(CREATED if is_new else OK, msgspec.json.encode(answer_plan(event, place)))
            case TransactionReversed() if isinstance(order.command, ReverseTransaction):
                return Done(CREATED, msgspec.json.encode(view_transaction(event, place)))
            case EntryPosted():
                money = self.book.accounts[event.postings[0].account]
                status = CREATED if isinstance(order.command, RecordEntry) else OK
                return Done(status, msgspec.json.encode(view_entry(event, place, money.name)))
            case TransactionReversed():
                return Done(OK, msgspec.json.encode(answer_reversal(event, place)))
            case AccountOpened():
                account = self.book.accounts[event.id]
                return Done(CREATED, msgspec.json.encode(answer_account(account, place)))
            case AccountClosed():
                account = self.book.accounts[event.id]
                return Done(OK, msgspec.json.encode(answer_account(account, place)))
            case _:
                assert_never(event)

    def _project(self, event: Event, seq: int) -> None:
        match event:
            case AccountOpened(id=name):
                self.opened.add(name)
            case AccountClosed(id=name):
                self.changed.add(name)
            case TransactionPosted():
                self._book(event, seq, standing=1)
            case EntryPosted():
                self._book(event, seq, standing=1)
                self._enter(event, seq)
            case TransactionReversed():
                self._book(event, seq, standing=0)
                self._take_back(event, seq)
            case PendingPosted():
                self._book(event, seq, standing=1)
                self._end(event, seq, PendingState.POSTED)
            case PendingVoided():
                self._end(event, seq, PendingState.VOIDED)
            case PendingExpired():
                self._end(event, seq, PendingState.EXPIRED)
            case TransactionPending():
                self._reserve(event, seq)
            case BalanceAsserted():
                self._assert(event, seq)
            case BudgetSet():
                self.budgets.append(budget_row(event, seq))
            case RecurringSet() | RecurringEnded():
                self._recur(event, seq)
            case _:
                assert_never(event)

    def _book(self, event: Booking, seq: int, *, standing: int) -> None:
        self.bookings.append(
            {"id": event.id, "seq": seq, "date": event.date, "description": event.description}
        )
        self.book.bookings[event.id] = KnownBooking(seq, event)
        for line, posting in enumerate(postings_of(event)):
            self.changed.add(posting.account)
            self._date(posting.account, event.date, posting.amount)
            self.postings.append(
                {
                    "seq": seq,
                    "line": line,
                    "account_id": posting.account,
                    "amount": posting.amount,
                    "date": event.date,
                    "standing": standing,
                }
            )

    def _enter(self, event: EntryPosted, seq: int) -> None:
        (self.altered if event.entry in self.book.entries else self.entered).add(event.entry)
        self.book.entries[event.entry] = KnownEntry(seq, event)
        if event.origin is not None:
            self.book.fingerprints.add(event.origin.fingerprint)
            self.origins.append({"seq": seq, "fingerprint": event.origin.fingerprint})

    def _take_back(self, event: TransactionReversed, seq: int) -> None:
        if event.entry is not None:
            entry = self.book.entries[event.entry]
            reversed_seq = entry.seq
            self.book.entries[event.entry] = msgspec.structs.replace(entry, reversed=True)
            self.altered.add(event.entry)
        else:
            reversed_seq = self.book.bookings[event.reverses].seq
        known = self.book.bookings.get(event.reverses)
        if known is not None:
            self.book.bookings[event.reverses] = msgspec.structs.replace(known, reversed=True)
        self.reversals.append({"seq": seq, "reversed_seq": reversed_seq})
        self.reversed_seqs.append(reversed_seq)

    def _reserve(self, event: TransactionPending, seq: int) -> None:
        self.book.pendings[event.id] = KnownPending(seq, event)
        self.pendings.append(
            {
                "id": event.id,
                "seq": seq,
                "date": event.date,
                "description": event.description,
                "state": PendingState.OPEN.value,
                "expires_ns": expiry_of(event),
                "closed_seq": None,
            }
        )
        for line, posting in enumerate(postings_of(event)):
            self.changed.add(posting.account)
            self.pending_postings.append(
                {"seq": seq, "line": line, "account_id": posting.account, "amount": posting.amount}
            )
            self.reserved.append((seq, *pending_move(posting.account, posting.amount)))

    def _end(self, event: Release, seq: int, state: PendingState) -> None:
        known = self.book.pendings[event.pending]
        self.book.pendings[event.pending] = msgspec.structs.replace(known, state=state, closed_seq=seq)
        self.endings.append({"which": event.pending, "new_state": state.value, "new_closed_seq": seq})
        for posting in released_by(event):
            self.changed.add(posting.account)
            name, amount = pending_move(posting.account, posting.amount)
            self.reserved.append((seq, name, -amount))

    def _assert(self, event: BalanceAsserted, seq: int) -> None:
        amount, actual = asserted_amounts(event)
        self.assertions.append(
            {
                "id": event.id,
                "seq": seq,
                "account_id": event.account,
                "date": event.date,
                "amount": amount,
                "actual": actual,
                "holds": int(event.holds),
            }
        )

    def _recur(self, event: RecurringSet | RecurringEnded, seq: int) -> None:
        ended = isinstance(event, RecurringEnded)
        said = event if isinstance(event, RecurringSet) else self.book.recurrings[event.id].event
        self.book.recurrings[event.id] = KnownRecurring(seq, said, ended)
        self.recurrings.append({"seq": seq, "id": event.id, "ended": int(ended)})

    def _date(self, account: str, date: str, amount: int) -> None:
        """Take a posting into what is asserted later in this batch."""
        for asked, until in self.book.dated:
            if asked == account and date <= until:
                self.book.dated[asked, until] += amount

    def _keep(self, order: Order, answer: Done | Refused, seq: int | None) -> None:
        if order.key is None:
            return
        row = keep(answer, order, seq)
        self.keys[order.key] = row
        self.key_rows.append({"key": order.key, **msgspec.structs.asdict(row)})
