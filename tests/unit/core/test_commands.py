from typing import Any

import pytest

from core.ledger.accounts import AccountType
from core.ledger.commands import (
    POSTINGS_MAX,
    AccountBody,
    OpenAccount,
    PostingBody,
    PostTransaction,
    TransactionBody,
    fingerprint_of,
    open_account,
    post_transaction,
)
from core.ledger.ids import uuid7
from core.ledger.reasons import Reason, Rejection, Slug


def body(**changes: Any) -> TransactionBody:
    lines = [PostingBody("assets:bank", "-12.00", "USD"), PostingBody("expenses:food", "12", "USD")]
    members: dict[str, Any] = {"date": "2026-11-21", "description": "lunch", "postings": lines}
    return TransactionBody(**(members | changes))


def faults(found: object) -> list[tuple[str, Reason]]:
    assert isinstance(found, Rejection), found
    return [(fault.pointer, fault.reason) for fault in found.faults]


def test_a_well_formed_body_becomes_a_balanced_command() -> None:
    command = post_transaction(body(), "id-1")
    assert isinstance(command, PostTransaction)
    assert sum(posting.amount for posting in command.postings) == 0


def test_all_faults_of_a_body_are_told_at_once() -> None:
    lines = [
        PostingBody("Assets", "1.234", "USD"),
        PostingBody("a", "1", "usd"),
        PostingBody("b", "x", "USD"),
    ]
    found = faults(post_transaction(body(date="2026-02-30", state="open", postings=lines), "id"))
    assert found == [
        ("/date", Reason.MALFORMED),
        ("/state", Reason.UNKNOWN_VALUE),
        ("/postings/0/account", Reason.MALFORMED),
        ("/postings/0/amount", Reason.TOO_MANY_DIGITS),
        ("/postings/1/currency", Reason.MALFORMED),
        ("/postings/2/amount", Reason.MALFORMED),
    ]


def test_postings_must_add_up_to_zero_in_each_currency() -> None:
    lines = [
        PostingBody("a", "10", "USD"),
        PostingBody("b", "-10", "USD"),
        PostingBody("c", "10", "KRW"),
        PostingBody("d", "-9", "KRW"),
    ]
    found = post_transaction(body(postings=lines), "id")
    assert isinstance(found, Rejection)
    assert found.slug is Slug.UNBALANCED
    assert found.values == {"currency": "KRW", "off_by": "1"}


def test_two_currencies_never_balance_each_other() -> None:
    lines = [PostingBody("a", "10", "USD"), PostingBody("b", "-10", "EUR")]
    found = post_transaction(body(postings=lines), "id")
    assert isinstance(found, Rejection)
    assert found.slug is Slug.UNBALANCED


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"postings": []}, ("/postings", Reason.TOO_FEW)),
        ({"postings": [PostingBody("a", "0", "USD")]}, ("/postings", Reason.TOO_FEW)),
        ({"postings": [PostingBody("a", "0", "USD")] * (POSTINGS_MAX + 1)}, ("/postings", Reason.TOO_MANY)),
        ({"description": "x" * 2_001}, ("/description", Reason.TOO_LONG)),
        ({"description": "a\x00b"}, ("/description", Reason.CONTROL_CHARACTER)),
        ({"tags": ["x"] * 51}, ("/tags", Reason.TOO_MANY)),
        ({"tags": ["fine", "two\nlines"]}, ("/tags/1", Reason.CONTROL_CHARACTER)),
        ({"date": "20261121"}, ("/date", Reason.MALFORMED)),
        ({"date": "2026-W47-6"}, ("/date", Reason.MALFORMED)),
        ({"state": "done"}, ("/state", Reason.UNKNOWN_VALUE)),
    ],
)
def test_each_limit_is_told_with_its_field(changes: dict[str, Any], fault: tuple[str, Reason]) -> None:
    assert faults(post_transaction(body(**changes), "id")) == [fault]


def test_an_account_needs_an_id_a_name_a_type_and_a_currency() -> None:
    found = faults(open_account(AccountBody("Assets", "  ", "cash", "won")))
    assert found == [
        ("/id", Reason.MALFORMED),
        ("/name", Reason.EMPTY),
        ("/type", Reason.UNKNOWN_VALUE),
        ("/currency", Reason.MALFORMED),
    ]
    accepted = open_account(AccountBody("assets:bank", "은행", "asset", "KRW"))
    assert accepted == OpenAccount("assets:bank", "은행", AccountType.ASSET, "KRW", no_overdraft=False)


def test_the_same_wish_in_another_spelling_has_the_same_fingerprint() -> None:
    lines = [PostingBody("assets:bank", "-12", "USD"), PostingBody("expenses:food", "12.0", "USD")]
    first, second = post_transaction(body(), "id-1"), post_transaction(body(postings=lines), "id-2")
    assert isinstance(first, PostTransaction)
    assert isinstance(second, PostTransaction)
    assert fingerprint_of(first) == fingerprint_of(second)


def test_another_wish_has_another_fingerprint() -> None:
    first, second = post_transaction(body(), "id"), post_transaction(body(description="dinner"), "id")
    assert isinstance(first, PostTransaction)
    assert isinstance(second, PostTransaction)
    assert fingerprint_of(first) != fingerprint_of(second)


def test_ids_sort_by_time_and_say_their_version() -> None:
    early, late = uuid7(1_000, bytes(10)), uuid7(1_001, bytes(10))
    assert early < late
    assert uuid7(2**48 - 1, b"\xff" * 10) == "ffffffff-ffff-7fff-bfff-ffffffffffff"
