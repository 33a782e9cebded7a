"""What a spare asks itself before it is promoted."""

from pathlib import Path

from core.journal.rehearsal import rehearse_writing
from core.journal.store import LEDGER_FILE, StoreError, WritingEngine, close_writing
from core.web.app import ROUTES
from core.web.pages_table import PAGES
from core.web.rehearsal import PATHS, UNASKED

FULL = 2  # as SQLite says it


def test_every_question_of_the_core_is_rehearsed_but_those_that_take_long() -> None:
    questions = [path for path, methods in {**ROUTES, **PAGES}.items() if "GET" in methods]
    assert len(PATHS) == len(questions) - len(UNASKED)
    assert set(questions) >= UNASKED
    assert not any("{" in path for path in PATHS)


def test_the_writing_side_is_rehearsed_without_a_trace_on_the_disk(tmp_path: Path) -> None:
    engine = WritingEngine(tmp_path / LEDGER_FILE)
    rehearse_writing(engine)
    assert list(tmp_path.iterdir()) == []
    connection = engine.connect(1_000)
    assert not isinstance(connection, StoreError)
    assert connection.exec_driver_sql("SELECT count(*) FROM sqlite_master").scalar_one() == 0
    assert connection.exec_driver_sql("PRAGMA synchronous").scalar_one() == FULL
    assert connection.exec_driver_sql("PRAGMA journal_mode").scalar_one() == "wal"
    close_writing(connection)
