"""The whole log out and in again: the same history, to the byte, or nothing."""

from collections.abc import Callable
from pathlib import Path

import pytest
from sqlalchemy import select

from core.journal import queries, schema
from core.journal.log_out import lines_of, take_in
from core.journal.store import LEDGER_FILE, open_reading
from core.keeping.restoring import NotRestored, restore_log
from core.keeping.shelf import Note
from core.keeping.writing_out import write_log
from core.ledger.accounts import AccountType
from core.ledger.commands import (
    AssertBalance,
    Posting,
    PostPending,
    PostTransaction,
    ReverseTransaction,
    VoidPending,
)
from core.ledger.plans import EndRecurring, EntryTemplate, RecurringBody, SetBudget, SetRecurring
from core.ledger.recurrence import Rule
from tests.unit.core.books import Pen, closing, entering, moving, opening, order, pen, replacing, reversing

#: Tables that follow from the events; what was attested is attested anew.
READINGS = [table for table in schema.metadata.sorted_tables if table.name != "attestation"]


def silent(*_: object) -> None:
    """Hear how far it is."""


def pending(name: str, timeout_s: int | None = None) -> PostTransaction:
    lines = (Posting("food", 700, "KRW"), Posting("bank", -700, "KRW"))
    return PostTransaction(name, "2026-11-21", "held", ("tag",), lines, pending=True, timeout_s=timeout_s)


def every_kind_of_event(made: Pen) -> None:
    made.carry_out(opening("bank"), opening("food", AccountType.EXPENSE), opening("old"), closing("old"))
    gone, changed, moved = entering("-7"), entering("-8", category="카페"), moving(50, "food", "bank")
    made.carry_out(gone, changed, moved, pending("p1"), pending("p2", 60), pending("p3"))
    made.carry_out(
        reversing(gone.id),
        replacing(changed.id, "-9"),
        ReverseTransaction(moved.id, "back"),
        PostPending("posted", "p1"),
        VoidPending("p2"),
        AssertBalance("a1", "bank", "2026-11-21", "-709"),
        SetBudget("food", "2026-11", "300"),
    )
    plan = RecurringBody("rent", Rule("month"), "2026-12-01", entry=EntryTemplate("-5", account="bank"))
    made.carry_out(SetRecurring("r1", plan, is_new=True), EndRecurring("r1"))
    kept = [order(entering("-3"), key="키 1"), order(moving(1, "nobody", "bank"), key="refused")]
    made.write(*kept)


def rows(data: Path) -> dict[str, list[tuple[object, ...]]]:
    readers = open_reading(data / LEDGER_FILE, 1, 1_000)
    try:
        with readers.connect() as connection:
            return {
                table.name: sorted((tuple(row) for row in connection.execute(select(table))), key=repr)
                for table in READINGS
            }
    finally:
        readers.dispose()


@pytest.fixture
def old(tmp_path: Path) -> Path:
    (tmp_path / "old").mkdir()
    with pen(tmp_path / "old") as made:
        every_kind_of_event(made)
    return tmp_path / "old"


def written(data: Path, out: Path) -> Path:
    size = write_log(data / LEDGER_FILE, out, silent)
    assert size == out.stat().st_size, size
    return out


def test_every_table_of_a_book_comes_back_from_its_log_alone(old: Path, tmp_path: Path) -> None:
    log = written(old, tmp_path / "log.jsonl")
    found = restore_log(log, tmp_path / "new", LEDGER_FILE, silent)
    assert isinstance(found, Note), found
    assert rows(tmp_path / "new") == rows(old)
    assert {one.name for one in (tmp_path / "new").iterdir()} == {LEDGER_FILE}
    with pen(tmp_path / "new") as made:  # and it goes on, in an epoch of its own
        assert made.epoch == 2
        again = made.write(order(entering("-3"), key="refused", digest=b"other"))
        assert "Taken" in type(again[0]).__name__


def test_a_log_ends_with_the_event_that_was_the_last_when_it_began(old: Path) -> None:
    readers = open_reading(old / LEDGER_FILE, 2, 1_000)
    lines = lines_of(readers, silent)
    head = next(lines)
    with pen(old) as made:
        made.write(order(entering("-1"), key="later"))
        last = queries.head(made.connection).head_seq
    rest = b"".join(lines)
    readers.dispose()
    assert f'"seq":{last - 1},'.encode() in head
    assert b"later" not in rest


def changed(log: Path, change: Callable[[list[bytes]], list[bytes]]) -> Path:
    log.write_bytes(b"".join(change(log.read_bytes().splitlines(keepends=True))))
    return log


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda _: [], "line 1"),
        (lambda lines: [b"dear ledger\n", *lines], "it is no log"),
        (lambda lines: [lines[0].replace(b'"version":1', b'"version":9'), *lines[1:]], "version 9"),
        (lambda lines: lines[:-1], "cut off"),
        (lambda lines: [*lines[:3], *lines[4:]], "line 4"),
        (
            lambda lines: [*lines[:5], lines[5].replace(b'"booked_ns":1', b'"booked_ns":2'), *lines[6:]],
            "line 6",
        ),
        (lambda lines: [*lines[:2], b'{"event": {"seq": 2}}\n', *lines[3:]], "line 3"),
        (lambda lines: [*lines[:2], b"[" * 100_000 + b"\n", *lines[3:]], "line 3"),
        (lambda lines: [*lines[:-2], lines[-2], lines[-2], lines[-1]], "contradict"),
        (lambda lines: [*lines[:-1], lines[-1].replace(b'"keys":2', b'"keys":3')], "head and its foot"),
        (lambda lines: [lines[0], lines[-1]], "head and its foot"),
    ],
)
def test_a_log_that_is_not_whole_is_refused_with_its_line_and_nothing_is_made(
    old: Path, tmp_path: Path, change: Callable[[list[bytes]], list[bytes]], why: str
) -> None:
    log = changed(written(old, tmp_path / "log.jsonl"), change)
    found = restore_log(log, tmp_path / "new", LEDGER_FILE, silent)
    assert isinstance(found, NotRestored)
    assert why in found.sentence
    assert not list((tmp_path / "new").iterdir())


def test_nothing_is_written_over(old: Path, tmp_path: Path) -> None:
    log = written(old, tmp_path / "log.jsonl")
    before = rows(old)
    assert isinstance(restore_log(log, old, LEDGER_FILE, silent), NotRestored)
    assert rows(old) == before


def test_an_empty_book_goes_out_and_in_too(tmp_path: Path) -> None:
    (tmp_path / "old").mkdir()
    with pen(tmp_path / "old"):
        pass
    log = written(tmp_path / "old", tmp_path / "log.jsonl")
    assert take_in(log.read_bytes().splitlines(keepends=True), tmp_path / "book", silent).seq == 0  # type: ignore[union-attr]
