import msgspec
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from core.ledger.accounts import Account, AccountType, is_overdrawn
from core.ledger.book import Book
from core.ledger.commands import Command, Posting, PostTransaction
from core.ledger.decider import decide
from core.ledger.events import AccountClosed, AccountOpened, TransactionPosted, decode, encode, kind_of
from core.ledger.evolving import evolve
from core.ledger.money import INT64_MAX
from core.ledger.reasons import Reason, Rejection, Slug
from tests.unit.core.books import closing, moving, opening

BOOK = {
    "cash": Account("cash", "Cash", AccountType.ASSET, "KRW", no_overdraft=True, posted=100),
    "card": Account("card", "Card", AccountType.LIABILITY, "KRW", no_overdraft=True, posted=-50),
    "food": Account("food", "Food", AccountType.EXPENSE, "KRW", no_overdraft=False),
    "old": Account("old", "Old", AccountType.ASSET, "KRW", no_overdraft=False, closed=True),
    "usd": Account("usd", "Dollars", AccountType.ASSET, "USD", no_overdraft=False),
}


def refused(command: Command) -> Rejection:
    found = decide(command, Book.of(BOOK.values()))
    assert isinstance(found, Rejection), found
    return found


def test_every_event_reads_back_from_its_bytes() -> None:
    for event in (
        AccountOpened("a", "이름", AccountType.ASSET, "KRW", no_overdraft=True),
        AccountClosed("a"),
        TransactionPosted("t", "2026-11-21", "점심", ("tag",), ()),
    ):
        assert decode(encode(event)) == event
        assert kind_of(event).encode() in encode(event)


@pytest.mark.parametrize("body", [b"", b"{}", b'{"kind":"account.closed","id":"a","v":2}', b"\xff"])
def test_bytes_that_hold_no_event_of_this_version_are_none(body: bytes) -> None:
    assert decode(body) is None


def test_an_account_exists_once() -> None:
    assert refused(opening("cash")).slug is Slug.ACCOUNT_EXISTS


def test_a_closed_account_takes_no_postings_and_is_not_closed_again() -> None:
    assert refused(moving(1, "old", "food")).slug is Slug.ACCOUNT_CLOSED
    assert refused(closing("old")).slug is Slug.ACCOUNT_CLOSED


def test_each_unknown_account_is_named_with_its_line() -> None:
    found = refused(moving(1, "nobody", "nowhere"))
    assert [(fault.pointer, fault.reason) for fault in found.faults] == [
        ("/postings/0/account", Reason.UNKNOWN_ACCOUNT),
        ("/postings/1/account", Reason.UNKNOWN_ACCOUNT),
    ]


def test_an_account_holds_one_currency() -> None:
    found = refused(moving(1, "usd", "food"))
    assert found.slug is Slug.CURRENCY_DIFFERS
    assert [fault.pointer for fault in found.faults] == ["/postings/0/currency"]


def test_an_asset_may_go_down_to_zero_and_no_further() -> None:
    assert not isinstance(decide(moving(100, "food", "cash"), Book.of(BOOK.values())), Rejection)
    found = refused(moving(101, "food", "cash"))
    assert found.slug is Slug.OVERDRAFT
    assert found.values == {"account": "cash", "balance": "-1", "currency": "KRW"}


def test_a_debt_may_be_paid_back_and_not_more() -> None:
    assert not isinstance(decide(moving(50, "card", "food"), Book.of(BOOK.values())), Rejection)
    assert refused(moving(51, "card", "food")).slug is Slug.OVERDRAFT


def test_lines_of_one_account_are_judged_together() -> None:
    lines = (
        Posting("cash", -150, "KRW"),
        Posting("cash", 60, "KRW"),
        Posting("food", 90, "KRW"),
    )
    assert not isinstance(
        decide(PostTransaction("t", "2026-11-21", "", (), lines), Book.of(BOOK.values())), Rejection
    )


def test_a_balance_never_leaves_64_bits() -> None:
    book = BOOK | {"food": msgspec.structs.replace(BOOK["food"], posted=INT64_MAX)}
    found = decide(moving(1, "food", "cash"), Book.of(book.values()))
    assert isinstance(found, Rejection)
    assert found.slug is Slug.BALANCE_OUT_OF_RANGE


@pytest.mark.parametrize("kind", list(AccountType))
def test_zero_is_never_an_overdraft(kind: AccountType) -> None:
    assert not is_overdrawn(kind, 0)
    assert is_overdrawn(kind, 1) != is_overdrawn(kind, -1)


NAMES = st.sampled_from(["a", "b", "c", "d"])


class BookAgainstModel(RuleBasedStateMachine):
    """The decider against a model of a dozen lines: balances, types, locks, and who is closed."""

    def __init__(self) -> None:
        super().__init__()
        self.book: dict[str, Account] = {}
        self.balance: dict[str, int] = {}
        self.kind: dict[str, tuple[AccountType, bool]] = {}
        self.closed: set[str] = set()

    def carry_out(self, command: Command) -> bool:
        before = dict(self.book)
        decision = decide(command, Book.of(self.book.values()))
        assert self.book == before, "deciding changes nothing"
        if isinstance(decision, Rejection):
            return False
        for event in decision:
            read_back = decode(encode(event))
            assert read_back is not None
            self.book.update(evolve(self.book, read_back))
        return True

    @rule(name=NAMES, kind=st.sampled_from(list(AccountType)), locked=st.booleans())
    def open(self, name: str, kind: AccountType, locked: bool) -> None:
        accepted = self.carry_out(opening(name, kind, no_overdraft=locked))
        assert accepted == (name not in self.balance)
        if accepted:
            self.balance[name], self.kind[name] = 0, (kind, locked)

    @rule(name=NAMES)
    def close(self, name: str) -> None:
        accepted = self.carry_out(closing(name))
        assert accepted == (name in self.balance and name not in self.closed)
        if accepted:
            self.closed.add(name)

    @rule(to=NAMES, source=NAMES, amount=st.integers(-1_000, 1_000))
    def move(self, to: str, source: str, amount: int) -> None:
        after = dict(self.balance)
        possible = {to, source} <= after.keys() and not {to, source} & self.closed
        if possible:
            after[to] += amount
            after[source] -= amount
            for name in (to, source):
                kind, locked = self.kind[name]
                wrong = (
                    after[name] < 0 if kind in {AccountType.ASSET, AccountType.EXPENSE} else after[name] > 0
                )
                possible = possible and not (locked and wrong)
        assert self.carry_out(moving(amount, to, source)) == possible
        if possible:
            self.balance = after

    @invariant()
    def books_agree(self) -> None:
        assert {name: account.posted for name, account in self.book.items()} == self.balance
        assert {name for name, account in self.book.items() if account.closed} == self.closed
        assert sum(self.balance.values()) == 0


TestBookAgainstModel = BookAgainstModel.TestCase
TestBookAgainstModel.settings = settings(max_examples=60, stateful_step_count=30, deadline=None)
