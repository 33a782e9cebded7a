"""The example on real input, in small: a household's first year is booked while the core is killed and frozen."""

import dataclasses
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest

from examples import audit
from examples.household import Household, Wish
from examples.lanes import Lanes
from examples.reading import Books
from tests import waiting

EXAMPLE = Path(__file__).parents[2] / "examples" / "replay_household.py"


@contextmanager
def started(*words: str) -> Iterator[subprocess.Popen[str]]:
    with subprocess.Popen(
        [sys.executable, str(EXAMPLE), "--quick", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    ) as example:
        try:
            yield example
        finally:
            example.terminate()


def test_a_household_under_kills_and_freezes_ends_with_beancounts_own_balances_each_transaction_once(
    tmp_path: Path,
) -> None:
    with started("--data", str(tmp_path / "data")) as example:
        told, _ = example.communicate()
    assert example.returncode == 0, told
    assert "equal beancount's own" in told
    assert "Nothing is missing and nothing is there twice." in told


def test_ctrl_c_stops_the_example_cleanly_and_leaves_nothing_running(tmp_path: Path) -> None:
    with started("--data", str(tmp_path / "data")) as example:
        log = tmp_path / "data" / "logs" / "sentinel.log"
        waiting.until(log.exists, "the guard to be at work")
        example.send_signal(signal.SIGINT)
        told, _ = example.communicate()
    assert example.returncode == 130, told
    assert "Nothing is left running." in told
    assert "Traceback" not in told


def test_a_data_folder_that_is_in_use_is_refused_with_the_next_step(tmp_path: Path) -> None:
    (tmp_path / "something").touch()
    with started("--data", str(tmp_path)) as example:
        told, _ = example.communicate()
    assert example.returncode == 1
    assert told == f"{tmp_path} is not empty: name a new folder with --data.\n"


# ---- the checks at the end are worth something only if they refuse ----


def wish(key: str, amount: str) -> Wish:
    lines = [
        {"account": "assets:a", "amount": amount, "currency": "USD"},
        {"account": "income:b", "amount": f"-{amount}", "currency": "USD"},
    ]
    body = {"date": "2020-01-01", "description": key, "tags": [], "postings": lines}
    return Wish(key, body, ("assets:a", "income:b"))


WISHES = (wish("one", "1.00"), wish("two", "2.00"))
ACCOUNTS = tuple(Wish(f"open {name}", {"id": name}, (name,)) for name in ("assets:a", "income:b"))
HOUSEHOLD = Household(ACCOUNTS, WISHES, {"assets:a": Decimal(3), "income:b": Decimal(-3)})
TOLD = {"one": "id-one", "two": "id-two"}


def event(seq: int, key: str) -> dict[str, Any]:
    return {"seq": seq, "key": key, "body": {"id": f"id-{key}"}}


GOOD = Books(
    {"assets:a": Decimal("3.00"), "income:b": Decimal("-3.00")},
    tuple({"id": f"id-{each.key}", **each.body} for each in reversed(WISHES)),
    (event(1, "one"), event(2, "two")),
)


def faults(books: Books) -> dict[str, int]:
    return {
        "balances": len(audit.wrong_balances(books, HOUSEHOLD)),
        "counts": len(audit.wrong_counts(books, WISHES)),
        "contents": len(audit.wrong_contents(books, WISHES, TOLD)),
        "orders": len(audit.wrong_orders(books, WISHES)),
    }


def test_a_ledger_that_has_everything_once_and_in_order_is_found_good() -> None:
    assert set(faults(GOOD).values()) == {0}


@pytest.mark.parametrize(
    ("check", "change"),
    [
        ("balances", {"balances": {**GOOD.balances, "assets:a": Decimal("3.01")}}),
        ("balances", {"balances": {"assets:a": Decimal(3)}}),
        ("balances", {"balances": {**GOOD.balances, "assets:c": Decimal(0)}}),
        ("counts", {"events": GOOD.events[:1]}),
        ("counts", {"events": (*GOOD.events, event(3, "two"))}),
        ("counts", {"events": (*GOOD.events, event(3, "three"))}),
        ("contents", {"transactions": GOOD.transactions[:1]}),
        ("contents", {"transactions": (*GOOD.transactions, GOOD.transactions[0])}),
        ("contents", {"transactions": (*GOOD.transactions, {**GOOD.transactions[0], "id": "id-three"})}),
        ("contents", {"transactions": ({**GOOD.transactions[0], "tags": ["x"]}, GOOD.transactions[1])}),
        ("contents", {"events": (event(1, "one"), {**event(2, "two"), "body": {"id": "id-other"}})}),
        ("orders", {"events": (event(1, "two"), event(2, "one"))}),
    ],
)
def test_a_ledger_that_differs_is_refused(check: str, change: dict[str, Any]) -> None:
    assert faults(dataclasses.replace(GOOD, **change))[check] > 0


# ---- several senders, and yet each account has its own in order ----


def test_work_is_ready_when_it_is_first_for_every_account_it_touches() -> None:
    lanes = Lanes([("a",), ("a", "b"), ("b",), ("c",)])
    lanes.open_up_to(4)
    assert [lanes.take(), lanes.take()] == [0, 3]
    lanes.finish(0)
    assert lanes.take() == 1
    lanes.finish(1)
    assert lanes.take() == 2
    lanes.finish(2)
    lanes.finish(3)
    assert lanes.take() is None
