"""The writer and the book it must not certify: a real core, ten thousand events, and somebody who moves balances."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from core.journal.attestation import EVENTS_BETWEEN
from core.journal.writer import BATCH_MAX
from core.ledger.accounts import AccountType
from tests import stores
from tests.integration.lone_core import verify
from tests.integration.wired_core import Guard, guarding
from tests.unit.core.books import moving, opening, pen


@pytest.fixture
def guard(tmp_path: Path) -> Iterator[Guard]:
    with guarding(tmp_path) as made:
        yield made


def write_up_to(data: Path, seq: int) -> None:
    """Write a book that ends at this event."""
    data.mkdir(mode=0o700)
    with pen(data) as made:
        made.carry_out(opening("cash"), opening("food", AccountType.EXPENSE))
        while made.journal.head_seq < seq:
            count = min(BATCH_MAX, seq - made.journal.head_seq)
            made.carry_out(*[moving(1, "food", "cash") for _ in range(count)])


def test_balances_that_were_moved_are_never_attested_and_nothing_is_booked_after_them(guard: Guard) -> None:
    write_up_to(guard.data, EVENTS_BETWEEN - 2)
    life = guard.core()
    life.hears("X_VERIFIED")  # so what is told from here on is the writer's word
    stores.tamper(
        guard.data, "UPDATE account SET posted = posted + CASE id WHEN 'food' THEN 1000 ELSE -1000 END"
    )
    assert life.core.move(1, "food", "cash").status == 201
    for _ in range(2):
        refused = life.core.move(1, "food", "cash", Idempotency_Key="due")
        assert (refused.status, refused.body["outcome"], refused.body["safe"]) == (
            503,
            "not_done",
            "STORE_CORRUPT",
        )
    assert "the accounts do not stand where" in life.hears("X_UNSOUND")["X_UNSOUND"]
    assert "X_STORE" not in {name for words in life.heard for name in words}
    assert len(life.core.ask("GET", "/api/ledger/accounts").body["items"]) == 2
    assert life.order(verb="status")["safe"] == "STORE_CORRUPT"
    life.core.process.terminate()
    assert life.core.ends_with() == 0
    again = guard.start()
    assert again.core.ends_with() == 65
    assert "the accounts do not stand where" in again.core.said()
    assert verify(guard.data).returncode == 65


def test_a_book_that_stands_where_it_was_left_is_attested_and_the_next_start_hashes_what_came_since(
    guard: Guard,
) -> None:
    write_up_to(guard.data, EVENTS_BETWEEN - 1)
    life = guard.core()
    assert life.core.move(1, "food", "cash").status == 201
    assert life.core.move(1, "food", "cash").status == 201
    life.core.process.terminate()
    assert life.core.ends_with() == 0
    assert guard.core().hears("READY")["X_TAIL"] == "1"
