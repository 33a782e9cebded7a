"""Reversals, versions, assertions and batches, decided in memory, and the order in which a no is told."""

import msgspec
import pytest

from core.ledger.commands import (
    AssertBalance,
    AtomicBatch,
    CloseAccount,
    ReverseTransaction,
    VoidPending,
    accounts_of,
)
from core.ledger.events import (
    BalanceAsserted,
    EntryPosted,
    PostingLine,
    TransactionReversed,
)
from core.ledger.money import INT64_MAX
from core.ledger.reasons import Fault, Reason, Slug
from tests.unit.core.worlds import DAY, World, account, moved, part


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
