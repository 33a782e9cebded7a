"""Two phases: cases that a ledger of accounts must get right, decided in memory."""

from typing import Any

import msgspec
import pytest

from core.ledger.accounts import AccountType
from core.ledger.book import PendingState
from core.ledger.commands import (
    AssertBalance,
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
    fingerprint_of,
    post_batch,
    post_pending,
    post_transaction,
)
from core.ledger.decider import decide
from core.ledger.events import (
    AccountClosed,
    PendingExpired,
    PendingPosted,
    PendingVoided,
    TransactionPending,
    TransactionPosted,
    decode,
)
from core.ledger.money import INT64_MAX, INT64_MIN
from core.ledger.reasons import Fault, Reason, Rejection, Slug
from core.ledger.views import balances_of, tell
from tests.unit.core.worlds import DAY, NOW, SECOND, World, account, moved, part, whole


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
