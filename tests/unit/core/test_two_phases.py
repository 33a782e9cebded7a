"""Two phases, reversals, batches and assertions, decided in memory: cases that a ledger of accounts must get right."""

import itertools
from typing import Any

import msgspec
import pytest

from core.ledger.accounts import Account, AccountType
from core.ledger.book import Book, KnownBooking, KnownPending, PendingState
from core.ledger.commands import (
    AssertBalance,
    AtomicBatch,
    BatchBody,
    CloseAccount,
    Command,
    ExpirePending,
    PendingPostBody,
    Posting,
    PostingBody,
    PostPending,
    PostTransaction,
    ReverseTransaction,
    TransactionBody,
    VoidPending,
    accounts_of,
    fingerprint_of,
    post_batch,
    post_pending,
    post_transaction,
)
from core.ledger.decider import decide
from core.ledger.events import (
    AccountClosed,
    BalanceAsserted,
    Booking,
    EntryPosted,
    Event,
    PendingExpired,
    PendingPosted,
    PendingVoided,
    PostingLine,
    Release,
    TransactionPending,
    TransactionPosted,
    TransactionReversed,
    decode,
    encode,
)
from core.ledger.evolving import evolve
from core.ledger.money import INT64_MAX, INT64_MIN
from core.ledger.reasons import Fault, Reason, Rejection, Slug
from core.ledger.views import balances_of, tell

SECOND = 1_000_000_000
NOW = 1_795_000_000 * SECOND
DAY = "2026-11-21"
_ids = itertools.count(1)
_STATES = {
    PendingPosted: PendingState.POSTED,
    PendingVoided: PendingState.VOIDED,
    PendingExpired: PendingState.EXPIRED,
}


class World:
    """A book that takes what is decided, as the writer's batch does, through the bytes that would be stored."""

    def __init__(self, *accounts: Account) -> None:
        self.book = Book.of(accounts or (account("cash", no_overdraft=True, posted=100), account("shop")))
        self.book.now_ns = NOW

    def does(self, command: Command) -> tuple[Event, ...]:
        events = decide(command, self.book)
        assert not isinstance(events, Rejection), events
        for event in events:
            read_back = decode(encode(event))
            assert read_back == event
            self.take(event)
        return events

    def take(self, event: Event) -> None:
        seq = next(_ids)
        self.book.update(evolve(self.book.accounts, event))
        if isinstance(event, Booking):
            self.book.bookings[event.id] = KnownBooking(seq, event)
        if isinstance(event, TransactionReversed):
            known = self.book.bookings[event.reverses]
            self.book.bookings[event.reverses] = msgspec.structs.replace(known, reversed=True)
        if isinstance(event, TransactionPending):
            self.book.pendings[event.id] = KnownPending(seq, event)
        if isinstance(event, Release):
            known_pending = self.book.pendings[event.pending]
            self.book.pendings[event.pending] = msgspec.structs.replace(
                known_pending, state=_STATES[type(event)]
            )

    def refuses(self, command: Command) -> Rejection:
        before = dict(self.book.accounts)
        found = decide(command, self.book)
        assert isinstance(found, Rejection), found
        assert self.book.accounts == before
        return found

    def reserve(self, amount: int, timeout_s: int | None = None) -> str:
        command = moved(amount, pending=True, timeout_s=timeout_s)
        self.does(command)
        return command.id

    def stands(self, name: str) -> tuple[int, int, int]:
        found = self.book.accounts[name]
        return found.posted, found.pending_debit, found.pending_credit


def account(name: str, *, no_overdraft: bool = False, posted: int = 0, **named: Any) -> Account:
    made = Account(name, name, AccountType.ASSET, "KRW", no_overdraft, posted, version=1)
    return msgspec.structs.replace(made, **named)


def moved(
    amount: int,
    to: str = "shop",
    source: str = "cash",
    *,
    pending: bool = False,
    timeout_s: int | None = None,
) -> PostTransaction:
    lines = (Posting(to, amount, "KRW"), Posting(source, -amount, "KRW"))
    return PostTransaction(f"t{next(_ids)}", DAY, "memo", ("tag",), lines, pending, timeout_s)


def part(pending: str, amount: int, *names: str) -> PostPending:
    to, source = names or ("shop", "cash")
    lines = (Posting(to, amount, "KRW"), Posting(source, -amount, "KRW"))
    return PostPending(f"p{next(_ids)}", pending, lines)


def whole(pending: str) -> PostPending:
    return PostPending(f"p{next(_ids)}", pending)


def test_what_is_pending_is_held_on_both_sides_and_moves_no_balance() -> None:
    world = World()
    world.reserve(30)
    assert world.stands("cash") == (100, 0, 30)
    assert world.stands("shop") == (0, 30, 0)
    shown = balances_of(world.book.accounts["cash"])
    assert (shown.posted, shown.pending, shown.available) == ("100", "-30", "70")
    # What may still come in is not there yet.
    shown = balances_of(world.book.accounts["shop"])
    assert (shown.posted, shown.pending, shown.available) == ("0", "30", "0")


@pytest.mark.parametrize("kind", [AccountType.LIABILITY, AccountType.EQUITY, AccountType.INCOME])
def test_what_is_available_on_an_account_of_credits_is_less_what_may_be_debited(kind: AccountType) -> None:
    made = account("card", type=kind, posted=-100, pending_debit=30, pending_credit=5)
    assert made.available == -70


def test_all_of_what_is_pending_is_posted_with_its_day_and_its_words() -> None:
    world = World()
    pending = world.reserve(30)
    (event,) = world.does(whole(pending))
    assert isinstance(event, PendingPosted)
    assert (event.date, event.description, event.tags) == (DAY, "memo", ("tag",))
    assert world.stands("cash") == (70, 0, 0)
    assert world.stands("shop") == (30, 0, 0)


def test_a_part_is_posted_and_the_rest_is_free() -> None:
    world = World()
    pending = world.reserve(30)
    world.does(part(pending, 10))
    assert world.stands("cash") == (90, 0, 0)
    assert world.refuses(part(pending, 1)).slug is Slug.PENDING_POSTED


def test_nothing_of_what_is_pending_may_be_posted() -> None:
    world = World()
    world.does(part(world.reserve(30), 0))
    assert world.stands("cash") == (100, 0, 0)


def test_what_is_voided_is_free_and_books_nothing() -> None:
    world = World()
    (event,) = world.does(VoidPending(world.reserve(30)))
    assert isinstance(event, PendingVoided)
    assert world.stands("cash") == (100, 0, 0)
    assert not world.book.bookings


@pytest.mark.parametrize(
    ("lines", "fault"),
    [
        ((("shop", 31), ("cash", -31)), Fault("/postings/0/amount", Reason.EXCEEDS_PENDING)),
        ((("shop", -1), ("cash", 1)), Fault("/postings/0/amount", Reason.EXCEEDS_PENDING)),
        ((("cash", -1), ("shop", 1)), Fault("/postings/0/account", Reason.EXCEEDS_PENDING)),
        ((("shop", 1), ("cash", -1), ("cash", 0)), Fault("/postings", Reason.TOO_MANY)),
    ],
)
def test_a_part_has_the_lines_of_the_whole_and_no_more(
    lines: tuple[tuple[str, int], ...], fault: Fault
) -> None:
    world = World()
    postings = tuple(Posting(name, amount, "KRW") for name, amount in lines)
    found = world.refuses(PostPending("p", world.reserve(30), postings))
    assert found.slug is Slug.PENDING_EXCEEDED
    assert found.faults[0] == fault


ENDS = {
    PendingState.POSTED: Slug.PENDING_POSTED,
    PendingState.VOIDED: Slug.PENDING_VOIDED,
    PendingState.EXPIRED: Slug.PENDING_EXPIRED,
}


@pytest.mark.parametrize("first", list(ENDS))
@pytest.mark.parametrize("second", list(ENDS))
def test_what_is_pending_ends_once_however_it_ends(first: PendingState, second: PendingState) -> None:
    world = World()
    pending = world.reserve(30, timeout_s=10)
    deeds: dict[PendingState, Command] = {
        PendingState.POSTED: whole(pending),
        PendingState.VOIDED: VoidPending(pending),
        PendingState.EXPIRED: ExpirePending(pending),
    }
    if first is PendingState.EXPIRED:
        world.book.now_ns += 10 * SECOND
    world.does(deeds[first])
    assert world.refuses(deeds[second]).slug is ENDS[first]
    assert world.stands("shop")[1:] == (0, 0)


@pytest.mark.parametrize("deed", [whole, VoidPending])
def test_what_has_run_out_is_over_before_anybody_writes_that_down(deed: object) -> None:
    world = World()
    pending = world.reserve(30, timeout_s=10)
    assert callable(deed)
    world.book.now_ns = NOW + 10 * SECOND - 1
    assert not isinstance(decide(deed(pending), world.book), Rejection)
    world.book.now_ns = NOW + 10 * SECOND
    assert world.refuses(deed(pending)).slug is Slug.PENDING_EXPIRED


def test_nothing_runs_out_before_its_time() -> None:
    world = World()
    pending, for_ever = world.reserve(30, timeout_s=10), world.reserve(30)
    world.book.now_ns = NOW + 10 * SECOND - 1
    assert world.refuses(ExpirePending(pending)).slug is Slug.NOT_YET_EXPIRED
    world.book.now_ns += 1
    (event,) = world.does(ExpirePending(pending))
    assert isinstance(event, PendingExpired)
    assert world.stands("cash") == (100, 0, 30)
    world.book.now_ns *= 2
    assert world.refuses(ExpirePending(for_ever)).slug is Slug.NOT_YET_EXPIRED


def test_the_moment_at_which_it_runs_out_stands_in_the_event() -> None:
    world = World()
    (event,) = world.does(moved(1, pending=True, timeout_s=1))
    assert isinstance(event, TransactionPending)
    assert event.expires_at == "2026-11-18T11:06:41.000000000Z"


@pytest.mark.parametrize("deed", [whole, VoidPending, ExpirePending])
def test_what_was_never_pending_can_not_end(deed: object) -> None:
    world = World()
    booked = moved(1)
    world.does(booked)
    assert callable(deed)
    assert world.refuses(deed("nobody")).slug is Slug.PENDING_NOT_FOUND
    assert world.refuses(deed(booked.id)).slug is Slug.PENDING_NOT_FOUND


def test_what_is_spoken_for_can_not_be_spent_again() -> None:
    world = World()
    world.reserve(60)
    assert world.refuses(moved(41)).slug is Slug.OVERDRAFT
    assert world.refuses(moved(41, pending=True)).slug is Slug.OVERDRAFT
    world.does(moved(40))
    assert world.stands("cash") == (60, 0, 60)


def test_what_may_still_come_in_can_not_be_spent() -> None:
    world = World(account("cash", no_overdraft=True), account("shop"))
    world.reserve(-50)
    assert world.refuses(moved(1)).slug is Slug.OVERDRAFT


def test_the_limits_hold_for_all_that_may_still_be_posted() -> None:
    world = World(account("cash"), account("shop"))
    world.reserve(INT64_MAX)
    assert world.refuses(moved(1)).slug is Slug.BALANCE_OUT_OF_RANGE
    assert world.refuses(moved(1, pending=True)).slug is Slug.BALANCE_OUT_OF_RANGE
    world.does(moved(-1))
    assert world.refuses(moved(2, pending=True)).slug is Slug.BALANCE_OUT_OF_RANGE


def test_the_lowest_amount_has_no_opposite() -> None:
    world = World(account("cash"), account("shop"), account("third"))
    # Two lines take it up, because there is no such amount on the debit side.
    lines = (
        Posting("cash", INT64_MIN, "KRW"),
        Posting("shop", INT64_MAX, "KRW"),
        Posting("third", 1, "KRW"),
    )
    world.does(PostTransaction("low", DAY, "", (), lines))
    assert world.refuses(ReverseTransaction("low", "back")).slug is Slug.BALANCE_OUT_OF_RANGE
    held = World(account("cash"), account("shop"), account("third"))
    found = held.refuses(PostTransaction("low", DAY, "", (), lines, pending=True))
    assert found.slug is Slug.BALANCE_OUT_OF_RANGE


def test_an_account_on_which_something_is_pending_is_not_closed() -> None:
    world = World()
    pending = world.reserve(30)
    assert world.refuses(CloseAccount("shop")).slug is Slug.ACCOUNT_HAS_PENDING
    world.does(VoidPending(pending))
    world.does(CloseAccount("shop"))


def test_a_closed_account_lets_go_of_what_is_pending_and_takes_nothing() -> None:
    world = World()
    booked = moved(10)
    world.does(booked)
    pending = world.reserve(30)
    world.take(AccountClosed("shop"))  # no rule of ours closes it now
    for command in (
        moved(1),
        moved(1, pending=True),
        whole(pending),
        ReverseTransaction(booked.id, "back"),
        AssertBalance("a", "shop", DAY, "0"),
    ):
        assert world.refuses(command).slug is Slug.ACCOUNT_CLOSED, command
    world.does(VoidPending(pending))


def test_any_transaction_is_reversed_once() -> None:
    world = World()
    booked = moved(30)
    world.does(booked)
    (event,) = world.does(ReverseTransaction(booked.id, "back"))
    assert isinstance(event, TransactionReversed)
    assert (event.entry, event.reverses, event.date) == (None, booked.id, DAY)
    assert world.stands("cash") == (100, 0, 0)
    assert world.refuses(ReverseTransaction(booked.id, "again")).slug is Slug.TRANSACTION_REVERSED
    assert world.refuses(ReverseTransaction("back", "again")).slug is Slug.ALREADY_A_REVERSAL
    assert world.refuses(ReverseTransaction("nobody", "again")).slug is Slug.TRANSACTION_NOT_FOUND


def test_what_was_posted_of_a_pending_transaction_is_reversed_like_any_other() -> None:
    world = World()
    pending = world.reserve(30)
    assert world.refuses(ReverseTransaction(pending, "back")).slug is Slug.TRANSACTION_PENDING
    command = part(pending, 10)
    world.does(command)
    assert world.refuses(ReverseTransaction(pending, "back")).slug is Slug.PENDING_POSTED
    world.does(ReverseTransaction(command.id, "back"))
    assert world.stands("cash") == (100, 0, 0)


def test_the_transaction_of_an_entry_is_reversed_through_its_entry() -> None:
    world = World()
    lines = (PostingLine("cash", "-5", "KRW"), PostingLine("shop", "5", "KRW"))
    world.take(EntryPosted("tx", "entry-7", DAY, "", (), lines, None, None, None))
    found = world.refuses(ReverseTransaction("tx", "back"))
    assert (found.slug, found.values) == (Slug.TRANSACTION_OF_ENTRY, {"entry": "entry-7"})


def test_a_reversal_may_not_overdraw() -> None:
    world = World(account("cash", no_overdraft=True), account("shop"))
    paid_in = moved(-50)
    world.does(paid_in)
    world.does(moved(50))
    assert world.refuses(ReverseTransaction(paid_in.id, "back")).slug is Slug.OVERDRAFT


def test_every_event_that_touches_an_account_gives_it_another_version() -> None:
    world = World()
    seen = [world.book.accounts["cash"].version]

    def looked() -> int:
        seen.append(world.book.accounts["cash"].version)
        return seen[-1]

    pending = world.reserve(1)
    looked()
    world.does(VoidPending(pending))
    looked()
    world.does(moved(1))
    looked()
    world.does(AssertBalance("a", "cash", DAY, "99"))
    assert looked() == seen[-2], "to say what it stands at moves nothing"
    assert seen == [1, 2, 3, 4, 4]


def test_a_command_that_has_seen_another_version_is_refused_before_anything_else() -> None:
    world = World()
    stale = msgspec.structs.replace(moved(10_000), expected_versions={"cash": 2})
    found = world.refuses(stale)
    assert (found.slug, found.values) == (Slug.ACCOUNT_CHANGED, {"account": "cash", "version": "1"})
    world.does(msgspec.structs.replace(moved(1), expected_versions={"cash": 1, "shop": 1}))
    for command in (
        CloseAccount("cash", {"cash": 1}),
        VoidPending("nobody", {"cash": 1}),
        AtomicBatch((moved(1),), {"elsewhere": 1}),
    ):
        assert world.refuses(command).slug is Slug.ACCOUNT_CHANGED
    assert accounts_of(VoidPending("x", {"cash": 1})) == ("cash",)


@pytest.mark.parametrize("holds", [True, False])
def test_an_assertion_passes_or_flags_and_is_never_refused(holds: bool) -> None:
    world = World()
    world.book.dated["cash", DAY] = 100 if holds else 99
    (event,) = world.does(AssertBalance("a", "cash", DAY, "100"))
    assert isinstance(event, BalanceAsserted)
    assert (event.holds, event.amount, event.actual) == (holds, "100", "100" if holds else "99")
    assert world.stands("cash") == (100, 0, 0)


def test_a_balance_of_a_day_that_is_no_amount_is_not_written_down() -> None:
    world = World()
    world.book.dated["cash", DAY] = INT64_MAX + 1
    assert world.refuses(AssertBalance("a", "cash", DAY, "1")).slug is Slug.BALANCE_OUT_OF_RANGE
    assert world.refuses(AssertBalance("a", "cash", DAY, "1.5")).slug is Slug.INVALID_BODY
    assert world.refuses(AssertBalance("a", "none", DAY, "1")).slug is Slug.UNKNOWN_ACCOUNT


def test_a_batch_sees_its_own_effects_and_is_all_or_nothing() -> None:
    world = World()
    world.does(AtomicBatch((moved(100), moved(-40), moved(40, pending=True))))
    assert world.stands("cash") == (40, 0, 40)
    found = world.refuses(AtomicBatch((moved(-5), moved(5), moved(1))))
    assert found.slug is Slug.OVERDRAFT
    assert found.faults == (Fault("/transactions/2/postings/1/amount", Reason.OVERDRAFT),)


def test_a_batch_of_one_or_of_none_and_one_after_a_failed_one() -> None:
    world = World()
    assert world.refuses(AtomicBatch(())).slug is Slug.INVALID_BODY
    assert world.refuses(AtomicBatch((moved(101),))).slug is Slug.OVERDRAFT
    world.does(AtomicBatch((moved(100),)))
    assert world.stands("cash") == (0, 0, 0)


def test_the_first_no_of_a_batch_is_told() -> None:
    world = World()
    found = world.refuses(AtomicBatch((moved(1), moved(1, "nowhere"), moved(1, "elsewhere"))))
    assert found.faults == (Fault("/transactions/1/postings/0/account", Reason.UNKNOWN_ACCOUNT),)


#: What is wrong, from what is told first to what is told last; each command has all that follow as well.
PRECEDENCE = [
    (Slug.ACCOUNT_CHANGED, "stale", "gone", "closed"),
    (Slug.UNKNOWN_ACCOUNT, "", "gone", "closed"),
    (Slug.ACCOUNT_CLOSED, "", "shop", "closed"),
    (Slug.CURRENCY_DIFFERS, "", "shop", "dollars"),
    (Slug.BALANCE_OUT_OF_RANGE, "", "full", "cash"),
    (Slug.OVERDRAFT, "", "shop", "cash"),
]


@pytest.mark.parametrize(("slug", "stale", "to", "source"), PRECEDENCE)
@pytest.mark.parametrize("pending", [False, True])
def test_what_is_wrong_is_told_in_one_order(
    slug: Slug, stale: str, to: str, source: str, pending: bool
) -> None:
    world = World(
        account("cash", no_overdraft=True, posted=100),
        account("shop"),
        account("full", posted=INT64_MAX),
        account("closed", closed=True, currency="USD", no_overdraft=True),
        account("dollars", currency="USD", no_overdraft=True),
    )
    command = moved(101, to, source, pending=pending)
    if stale:
        command = msgspec.structs.replace(command, expected_versions={"cash": 9})
    assert world.refuses(command).slug is slug


def body(**changes: Any) -> TransactionBody:
    lines = [PostingBody("shop", "30", "KRW"), PostingBody("cash", "-30", "KRW")]
    made = TransactionBody(DAY, "memo", lines)
    return msgspec.structs.replace(made, **changes)


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"state": "pending", "timeout_s": 0}, Fault("/timeout_s", Reason.OUT_OF_RANGE)),
        ({"state": "pending", "timeout_s": 400_000_000}, Fault("/timeout_s", Reason.OUT_OF_RANGE)),
        ({"timeout_s": 1}, Fault("/timeout_s", Reason.NOT_SUPPORTED)),
    ],
)
def test_a_timeout_is_between_a_second_and_ten_years_and_of_what_is_pending(
    changes: dict[str, object], fault: Fault
) -> None:
    found = post_transaction(body(**changes), "id")
    assert isinstance(found, Rejection)
    assert found.faults == (fault,)


def test_a_malformed_part_or_batch_is_refused_before_the_book_is_asked() -> None:
    unbalanced = PendingPostBody([PostingBody("shop", "30", "KRW"), PostingBody("cash", "-29", "KRW")])
    found = post_pending("t", unbalanced, "p")
    assert isinstance(found, Rejection)
    assert found.slug is Slug.UNBALANCED
    batch = post_batch(BatchBody([body(), body(date="today")]), ["1", "2"])
    assert isinstance(batch, Rejection)
    assert batch.faults == (Fault("/transactions/1/date", Reason.MALFORMED),)
    for bodies in ([], [body()] * 8_191):
        assert isinstance(post_batch(BatchBody(bodies), [""] * len(bodies)), Rejection)


def test_the_same_wish_has_the_same_fingerprint_whatever_ids_it_got() -> None:
    first, second = (post_transaction(body(state="pending"), name) for name in "ab")
    booked = post_transaction(body(), "a")
    assert not isinstance(first, Rejection)
    assert not isinstance(second, Rejection)
    assert not isinstance(booked, Rejection)
    assert fingerprint_of(first) == fingerprint_of(second) != fingerprint_of(booked)
    assert fingerprint_of(CloseAccount("a")) == b'["CloseAccount",{"id":"a"}]', "as it always was"
    assert fingerprint_of(CloseAccount("a")) != fingerprint_of(CloseAccount("a", {"a": 1}))


def test_who_listens_is_told_of_every_event_and_its_accounts() -> None:
    world = World()
    pending = world.reserve(30)
    told = tell(world.book.pendings[pending].event, 1)
    assert (told.kind, told.id, told.accounts) == ("transaction.pending", pending, ("shop", "cash"))
    (event,) = world.does(VoidPending(pending))
    told = tell(event, 2)
    assert (told.kind, told.id, told.accounts) == ("pending.voided", pending, ("shop", "cash"))


def test_an_event_of_an_older_shape_is_raised_step_by_step_and_one_to_come_is_not_known() -> None:
    old = b'{"kind":"transaction.posted","who":"t","day":"2026-11-21","v":-1}'
    steps = {
        "transaction.posted": {
            -1: lambda found: {"id": found["who"], "date": found["day"]},
            0: lambda found: {**found, "description": "", "tags": [], "postings": []},
        }
    }
    assert decode(old) is None
    assert decode(old, steps) == TransactionPosted("t", DAY, "", (), ())
    assert decode(old.replace(b"-1", b"2"), steps) is None
    assert decode(b'{"kind":"transaction.posted","v":"x"}', steps) is None
