"""Proof B: the whole book, replayed from its first event and compared with every reading of it.

It reads in slices of a few thousand events, each a short read transaction, so it can run beside a working
core and never keeps the log from being checkpointed. The last slice sees the head and the balances at the
same moment. It stops at the first fault and names it: what follows a broken link can't be judged. Nothing is
ever repaired here; a repair would be a guess about somebody's money.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Final

import msgspec
from sqlalchemy import Connection, Engine
from sqlalchemy.exc import DBAPIError

from core.journal import queries
from core.journal.attestation import Attestation, Balance, attest, balances_of, is_due, standing
from core.journal.chain import GENESIS, Broken, EventRow, check_link
from core.journal.proof import check_key, check_sums, sums_by_currency
from core.journal.readings import Readings, listed_after, read_between
from core.journal.rebuilding import Rebuilding
from core.journal.store import StoreError, snapshot, store_error
from core.ledger.accounts import Account
from core.ledger.commands import Posting
from core.ledger.events import (
    AccountClosed,
    AccountOpened,
    BalanceAsserted,
    Booking,
    EntryPosted,
    Event,
    Release,
    TransactionPending,
    accounts_in,
    asserted_amounts,
    decode,
    kind_of,
    postings_of,
    released_by,
)
from core.ledger.evolving import evolve, sides
from core.ledger.fields import folded
from core.ledger.money import format_amount

SLICE_EVENTS: Final = 2_000


class Verdict(msgspec.Struct, frozen=True):
    """What came of proof B.

    `head` is the hash of the last event seen, `events` how many were whole, `attested` the last of them after which
    the balances were attested and are what its writer said (0: none was yet). `parked`: events whose content was left
    out of it, because they kill whoever reads it; their hashes are whole, and where they left their own accounts is
    taken from what is listed and not proven.
    """

    ok: bool
    events: int
    head: str
    trial_balance: dict[str, str]
    first_bad_seq: int | None
    reason: str | None
    attested: int = 0
    parked: tuple[int, ...] = ()


class GivenUp:
    """The core leaves: the proof was not brought to its end."""


class _Replay(msgspec.Struct):
    """The book as its events tell it, so far.

    `unproven`: accounts that events which were left out have booked on; `unnamed`: how many of those name none. `dated`:
    what was posted for each day, of those accounts of which something is asserted.
    """

    rebuilding: Rebuilding
    last: EventRow | None = None
    book: dict[str, Account] = {}
    entries: int = 0
    attested: int = 0
    parked: list[int] = []
    unproven: set[str] = set()
    unnamed: int = 0

    dated: dict[str, dict[str, int]] = {}

    @property
    def seq(self) -> int:
        return self.last.seq if self.last else 0

    def date(self, name: str, date: str, amount: int) -> None:
        """Note what was posted for a day to an account, if anything is asserted of it anywhere in the book."""
        days = self.dated.get(name)
        if days is not None:
            days[date] = days.get(date, 0) + amount


def verify(
    readers: Engine,
    slice_ms_max: int,
    is_leaving: Callable[[], bool],
    rebuilding: Rebuilding | None = None,
) -> Verdict | StoreError | GivenUp:
    """Prove the whole book, in slices that may each read for `slice_ms_max`. Blocks: give it a thread.

    `is_leaving` is asked between two slices, so that a proof of minutes never delays an end of moments.
    `rebuilding` says what is left out of it; absent: nothing.
    """
    replay = _Replay(rebuilding or Rebuilding())
    try:
        while not is_leaving():
            with snapshot(readers, slice_ms_max) as connection:
                seen = replay.seq
                if not seen:
                    replay.dated = {name: {} for name in queries.asserted_accounts(connection)}
                broken = _slice(connection, replay)
                if broken is None and replay.seq - seen == SLICE_EVENTS:
                    continue
                # A slice that was not full has met the end, at the same moment as the readings below.
                return _verdict(replay, broken or _check_readings(connection, replay))
    except DBAPIError as error:
        return store_error(error)
    return GivenUp()


def _slice(connection: Connection, replay: _Replay) -> Broken | None:
    rows = list(queries.event_rows(connection, replay.seq, SLICE_EVENTS))
    if not rows:
        return None
    first, last = replay.seq + 1, rows[-1].seq
    keys = queries.keys_between(connection, first, last)
    attested = queries.attestations_between(connection, first, last)
    readings = read_between(connection, first, last)
    for row in rows:
        broken = check_link(replay.last, row) or check_key(row, keys)
        if broken is None and replay.rebuilding.takes(row.seq):
            broken = _take(connection, replay, row, readings)
        elif broken is None:
            _leave_out(connection, replay, row, readings)
        if broken is not None:
            return broken
        replay.last = row
        broken = _check_attested(replay, row, attested.pop(row.seq, None))
        if broken is not None:
            return broken
    orphans = [*keys, *readings.left()]
    return Broken(min(orphans), f"event {min(orphans)} is listed and does not exist") if orphans else None


def _take(connection: Connection, replay: _Replay, row: EventRow, readings: Readings) -> Broken | None:
    """Have an event happen in the book of the replay, or say what is wrong with it."""
    event = decode(row.body)
    if replay.parked:
        _stand_in(connection, replay, _touched(event))
    broken = _check_event(replay, row, event)
    if broken is not None:
        return broken
    assert event is not None
    if not readings.take(event, row.seq):
        return Broken(row.seq, f"what is listed for event {row.seq} is not what the event says")
    replay.book.update(evolve(replay.book, event))
    if isinstance(event, Booking) and replay.dated:
        for posting in postings_of(event):
            replay.date(posting.account, event.date, posting.amount)
    replay.entries += isinstance(event, EntryPosted) and event.entry == event.id
    return None


def _touched(event: Event | None) -> Iterable[str]:
    """Return the accounts that have to be there before this event happens."""
    return () if event is None or isinstance(event, AccountOpened) else accounts_in(event)


def _leave_out(connection: Connection, replay: _Replay, row: EventRow, readings: Readings) -> None:
    """Go past an event without reading it: what its commit has listed stands in its place, and proves nothing.

    So every other account, and every attestation that follows, can still be held against the other events.
    """
    left = readings.leave_out(row.seq)
    names = left.accounts | set(replay.rebuilding.accounts_of(row.seq))
    _stand_in(connection, replay, names)
    for name, amount in left.posted:
        _move(replay, name, amount, 0, 0)
    for lines, sign in ((left.reserved, 1), (left.released, -1)):
        for name, amount in lines:
            debit, credit = sides(amount)
            _move(replay, name, 0, sign * debit, sign * credit)
    for (name, amount), date in zip(left.posted, left.days, strict=True):
        replay.date(name, date, amount)
    replay.entries += queries.began_entry(connection, row.seq)
    replay.parked.append(row.seq)
    replay.unproven |= names
    replay.unnamed += not names


def _move(replay: _Replay, name: str, posted: int, debit: int, credit: int) -> None:
    if name in replay.book:
        account = replay.book[name]
        replay.book[name] = msgspec.structs.replace(
            account,
            posted=account.posted + posted,
            pending_debit=account.pending_debit + debit,
            pending_credit=account.pending_credit + credit,
        )


def _stand_in(connection: Connection, replay: _Replay, names: Iterable[str]) -> None:
    """Have accounts in the book that an event which was left out has opened: empty, as at their beginning."""
    for name in sorted(set(names) - replay.book.keys()):
        account = queries.get_account(connection, name)
        if account is not None:
            replay.book[name] = msgspec.structs.replace(
                account, posted=0, closed=False, pending_debit=0, pending_credit=0, version=0
            )
            replay.unproven.add(name)


def _check_event(replay: _Replay, row: EventRow, event: Event | None) -> Broken | None:
    if event is None or kind_of(event) != row.kind:
        return Broken(row.seq, f"event {row.seq} can't be read")
    if isinstance(event, AccountClosed) and event.id not in replay.book:
        return Broken(row.seq, f"event {row.seq} closes an account that is not there")
    if isinstance(event, BalanceAsserted):
        return _check_assertion(replay, row.seq, event)
    for lines in _lines_in(event):
        sums: dict[str, int] = {}
        for posting in lines:
            account = replay.book.get(posting.account)
            if account is None or account.currency != posting.currency:
                return Broken(row.seq, f"event {row.seq} books to an account that is not there")
            sums[posting.currency] = sums.get(posting.currency, 0) + posting.amount
        if any(sums.values()):
            return Broken(row.seq, f"event {row.seq} does not add up to zero")
    return None


def _lines_in(event: Event) -> Iterator[tuple[Posting, ...]]:
    """Return the lines of an event that belong together: each of them adds up to zero."""
    if isinstance(event, Booking | TransactionPending):
        yield postings_of(event)
    if isinstance(event, Release):
        yield released_by(event)


def _check_assertion(replay: _Replay, seq: int, event: BalanceAsserted) -> Broken | None:
    """Say whether the book stood, at this place in it, where the event says that it stood by the end of the day."""
    account = replay.book.get(event.account)
    if account is None or account.currency != event.currency:
        return Broken(seq, f"event {seq} is about an account that is not there")
    amount, actual = asserted_amounts(event)
    stood = sum(moved for day, moved in replay.dated.get(account.id, {}).items() if day <= event.date)
    if event.holds != (amount == actual) or (stood != actual and account.id not in replay.unproven):
        return Broken(seq, f"event {seq} asserts a balance of the day that is not the book's")
    return None


def _check_attested(replay: _Replay, row: EventRow, found: Attestation | None) -> Broken | None:
    """Say whether what was attested after this event is what the events have led to."""
    if found is None:
        # A ledger that was brought up to attestations has its first one later; from then on it has them all.
        if replay.attested and is_due(row.seq):
            return Broken(row.seq, f"nothing is attested after event {row.seq}")
        return None
    if found != attest(row.seq, row.hash, standing(_balances(replay.book), {})):
        return Broken(row.seq, f"what is attested after event {row.seq} is not what its events have led to")
    replay.attested = row.seq
    return None


def _check_readings(connection: Connection, replay: _Replay) -> Broken | None:
    meta = queries.head(connection)
    seq, last_hash = meta.head_seq, replay.last.hash if replay.last else GENESIS
    if replay.seq != seq:
        return Broken(min(replay.seq, seq) + 1, f"the store's head is {seq}, its last event {replay.seq}")
    if last_hash != meta.head_hash:
        return Broken(seq, f"event {seq} is not the head that the store remembers")
    beyond = [*queries.keys_between(connection, seq + 1), *listed_after(connection, seq)]
    newest = queries.newest_attestation(connection)
    if newest is not None and newest.seq > seq:
        beyond.append(newest.seq)
    if beyond:
        return Broken(min(beyond), f"event {min(beyond)} is listed and does not exist")
    accounts = {account.id: account for account in queries.all_accounts(connection)}
    for name in sorted(accounts.keys() | replay.book.keys()):
        if name in replay.unproven or accounts.get(name) == replay.book.get(name):
            continue
        replay.unnamed -= 1  # one that names no account may have opened or closed this one
        if replay.unnamed < 0:
            return Broken(None, f"account {name} does not stand where its events have left it")
    if queries.account_names(connection) != {
        (folded(account.name), name) for name, account in accounts.items()
    }:
        return Broken(None, "the accounts are not listed under their names")
    if queries.count_entries(connection) != replay.entries:
        return Broken(None, "the entries that are listed are not those that were booked")
    return check_sums(sums_by_currency(_balances(accounts)))


def _verdict(replay: _Replay, broken: Broken | None) -> Verdict:
    sums = sums_by_currency(_balances(replay.book))
    return Verdict(
        ok=broken is None,
        events=replay.seq,
        head=(replay.last.hash if replay.last else GENESIS).hex(),
        trial_balance={currency: format_amount(total, currency) for currency, total in sorted(sums.items())},
        first_bad_seq=broken.seq if broken else None,
        reason=broken.sentence if broken else None,
        attested=replay.attested,
        parked=tuple(replay.parked),
    )


def _balances(accounts: Mapping[str, Account]) -> list[Balance]:
    return [
        balance
        for account in accounts.values()
        for balance in balances_of(
            account.id, account.currency, account.posted, account.pending_debit, account.pending_credit
        )
    ]
