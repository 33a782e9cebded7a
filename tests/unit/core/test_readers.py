"""The connections that read: what a component holds is none of the requests', and none is waited for without end."""

import threading
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from sqlalchemy import Engine
from sqlalchemy.exc import DBAPIError

from core.journal.store import (
    FREE_WITHIN_S,
    LEDGER_FILE,
    StoreError,
    StoreFault,
    beside,
    close_writing,
    open_reading,
    open_writing,
    snapshot,
    store_error,
)
from core.journal.stores import sqlite


@pytest.fixture
def readers(tmp_path: Path) -> Iterator[Engine]:
    writing = open_writing(tmp_path / LEDGER_FILE, 1_000)
    assert not isinstance(writing, StoreError)
    engine = open_reading(tmp_path / LEDGER_FILE, 1, 1_000)
    yield engine
    engine.dispose()
    close_writing(writing)


def test_a_component_that_hangs_again_and_again_takes_no_connection_from_the_requests(
    readers: Engine,
) -> None:
    own = beside(readers)
    with ExitStack() as held:
        for _ in range(20):
            held.enter_context(snapshot(own, 1_000))
        with snapshot(readers, 1_000) as connection:
            assert connection.exec_driver_sql("SELECT 1").scalar_one() == 1


def test_a_component_reads_as_the_requests_do_and_can_not_write(readers: Engine) -> None:
    with pytest.raises(DBAPIError), snapshot(beside(readers), 1_000) as connection:
        connection.exec_driver_sql("CREATE TABLE t (a)")


def test_where_no_connection_becomes_free_a_read_is_refused_and_told_why(readers: Engine) -> None:
    found: list[DBAPIError] = []
    with ExitStack() as held:
        for _ in range(1 + sqlite._READERS_BEYOND):
            held.enter_context(snapshot(readers, 1_000))

        def ask() -> None:
            with pytest.raises(DBAPIError) as raised, snapshot(readers, 1_000):
                pass
            found.append(raised.value)

        asking = threading.Thread(target=ask)
        asking.start()
        asking.join()
    assert store_error(found[0]).fault is StoreFault.TAKEN
    assert FREE_WITHIN_S < 1
