"""What a journal wishes of the ledger: accounts, bodies, and why something is not taken."""

from decimal import Decimal

import pytest

from core.ledger.accounts import is_account_id
from core.ledger.commands import (
    AccountBody,
    OpenAccount,
    PostingBody,
    PostTransaction,
    TransactionBody,
    open_account,
    post_transaction,
)
from hardcore.journals.wishes import Line, NotTaken, Told, Wishes, wishes_of


def told(*lines: tuple[str, str, str], line: int = 3, fault: str = "") -> Told:
    return Told(line, "2026-11-21", "점심", ("tag",), tuple(Line(*one) for one in lines), fault)


def accepted(wishes: Wishes) -> None:
    """The ledger takes every body as it is."""
    for account in wishes.accounts.values():
        assert isinstance(open_account(AccountBody(**account)), OpenAccount), account
    for _, body in wishes.transactions:
        postings = [PostingBody(**one) for one in body.pop("postings")]
        assert isinstance(
            post_transaction(TransactionBody(postings=postings, **body), "t"), PostTransaction
        ), body


def test_a_transaction_becomes_accounts_by_currency_and_a_body() -> None:
    wishes = wishes_of(
        [told(("Expenses:Food:Lunch", "12000", "KRW"), ("Assets:Bank", "-12000.00", "KRW"))], {}
    )
    assert list(wishes.accounts) == ["expense:food:lunch:krw", "asset:bank:krw"]
    assert wishes.accounts["expense:food:lunch:krw"]["name"] == "Food · Lunch"
    assert [one["amount"] for one in wishes.transactions[0][1]["postings"]] == ["12000", "-12000"]
    accepted(wishes)


def test_what_is_exchanged_goes_through_an_account_of_exchange_for_each_currency() -> None:
    wishes = wishes_of([told(("Assets:Fund", "2.5", "VTI"), ("Assets:Bank", "-640.25", "$"))], {})
    sums: dict[str, Decimal] = {}
    for one in wishes.transactions[0][1]["postings"]:
        sums[one["currency"]] = sums.get(one["currency"], Decimal(0)) + Decimal(one["amount"])
    assert sums == {"VTI": 0, "USD": 0}
    assert {"equity:exchange:vti", "equity:exchange:usd"} <= set(wishes.accounts)
    accepted(wishes)


@pytest.mark.parametrize(
    "name", ["Assets:생활비 통장", "Assets:" + "very long " * 30, "Assets::", "자산:통장:-"]
)
def test_every_name_gets_an_id_that_may_be_one_and_always_the_same(name: str) -> None:
    first, again = (
        wishes_of([told((name, "1", "A.B"), ("Equity:Other", "-1", "A.B"))], {}) for _ in range(2)
    )
    assert all(map(is_account_id, first.accounts))
    assert first.accounts == again.accounts


@pytest.mark.parametrize(
    ("one", "why", "what"),
    [
        (told(("Assets:A", "0", "KRW")), "nothing", ""),
        (
            told(("Assets:A", "1", "hours of work"), ("Assets:B", "-1", "hours of work")),
            "currency",
            "hours of work",
        ),
        (told(("Vermögen:A", "1", "EUR"), ("Assets:B", "-1", "EUR")), "kind", "Vermögen"),
        (told(("Assets:A", "1", "EUR"), fault="virtual"), "virtual", ""),
    ],
)
def test_what_can_not_be_taken_is_told_with_its_line_and_the_others_are_taken(
    one: Told, why: str, what: str
) -> None:
    good = told(("Assets:A", "1", "EUR"), ("Assets:B", "-1", "EUR"), line=9)
    wishes = wishes_of([one, good], {})
    assert wishes.not_taken == [NotTaken(3, why, what)]
    assert [line for line, _ in wishes.transactions] == [9]


def test_the_kind_of_a_name_can_be_said() -> None:
    wishes = wishes_of([told(("Vermögen:A", "1", "EUR"), ("Assets:B", "-1", "EUR"))], {"vermögen": "asset"})
    assert not wishes.not_taken
    accepted(wishes)
