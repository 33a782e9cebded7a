"""What is left out of the log is shown as the tables list it, and its bytes are never read for it."""

from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
from sqlalchemy import update

from core.journal import queries, register, schema
from core.journal.queries import TransactionFilter
from core.journal.register import HouseholdFilter
from core.ledger.views import TransactionView
from core.web import pages_book
from tests.unit.core.books import Pen, entering, moving, opening, pen, replacing, reversing

MONTH = "2026-11"


@pytest.fixture
def book(tmp_path: Path) -> Iterator[Pen]:
    """Two accounts, a transaction, an entry that was changed, one without category, and one that was taken back."""
    with pen(tmp_path) as made:
        changed, plain, gone = entering("-500", category="food", tags=("a",)), entering("-7"), entering("9")
        made.carry_out(opening("bank"), opening("cash"), moving(3, "cash", "bank"), changed, plain, gone)
        made.carry_out(replacing(changed.id, "-600", category="rent"), reversing(gone.id))
        yield made


def spoil(book: Pen, *events: int) -> None:
    """Have whoever reads these events fail, as if their bytes killed him."""
    book.connection.exec_driver_sql("DROP TRIGGER event_is_never_changed").close()
    book.connection.execute(update(schema.event).where(schema.event.c.seq.in_(events)).values(body=b"poison"))


def every(book: Pen) -> tuple[int, ...]:
    return tuple(range(1, queries.head(book.connection).head_seq + 1))


def without_what_events_say(shown: list[object]) -> list[object]:
    """Return answers without what no table lists."""
    return [
        msgspec.structs.replace(
            one, **{name: None for name in ("tags", "payment_method") if hasattr(one, name)}
        )  # type: ignore[type-var]
        for one in shown
    ]


def test_entries_and_register_show_what_is_left_out_as_if_it_were_read(book: Pen) -> None:
    def seen(parked: tuple[int, ...]) -> list[object]:
        wanted = HouseholdFilter(limit=50)
        lines = register.list_register(book.connection, wanted, parked)
        entries = register.list_entries(book.connection, wanted, parked)
        alone = [register.get_entry(book.connection, one.id, parked) for one in entries]
        return without_what_events_say([*lines, *entries, *alone])

    read, events = seen(()), every(book)
    assert len(read) > 6
    spoil(book, *events)
    assert seen(events) == read


def test_a_transaction_that_is_left_out_says_so_and_is_drawn_from_what_is_listed(book: Pen) -> None:
    def seen(parked: tuple[int, ...]) -> dict[str, TransactionView]:
        found = queries.list_transactions(book.connection, TransactionFilter(), parked)
        assert found == [queries.get_transaction(book.connection, one.id, parked) for one in found]
        return {one.id: one for one in found}

    read, events = seen(()), every(book)
    spoil(book, *events)
    drawn = seen(events)
    assert {one.state for one in read.values()} == {"posted"}
    assert {one.state for one in drawn.values()} == {"set-aside"}
    for name, one in drawn.items():
        same = msgspec.structs.replace(one, state="posted", tags=read[name].tags)
        assert same == read[name]


def test_only_what_is_left_out_is_drawn(book: Pen) -> None:
    *_, before, last = every(book)
    spoil(book, last)
    found = queries.list_transactions(book.connection, TransactionFilter(), (last,))
    assert [one.state for one in found[:2]] == ["set-aside", "posted"]
    assert found[1].seq == before
    with pytest.raises(AssertionError):
        queries.list_transactions(book.connection, TransactionFilter(), ())


def test_a_page_reads_nothing_that_is_left_out(book: Pen) -> None:
    events = every(book)
    spoil(book, *events)
    seen = pages_book.overview(book.connection, MONTH, MONTH, 8, events)
    assert {one.id for one in seen.money_accounts} == {"bank", "cash"}
    asked = dict.fromkeys(("account", "q", "from", "to", "cursor"), "")
    page = pages_book.register(book.connection, asked, 50, events)
    assert page.lines
    entry = pages_book.entry(book.connection, seen.recent[0].id, events)
    assert entry is not None
    assert entry.entry == seen.recent[0]
