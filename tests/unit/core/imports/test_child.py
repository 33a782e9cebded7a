import asyncio
import re
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import msgspec
import psutil
import pytest

from core.imports.reading.child import read_in_child
from core.imports.reading.kept import ReadTable, open_table
from core.imports.reading.table import Row, Unreadable, Why
from tests.unit.core.imports.files import LIMITS, bomb, far_corner, in_child, locked, workbook
from tests.waiting import until

CSV = "거래일자,내용,금액\n2026-01-02,가상,-4500\n"
PASSWORD = "canary-531974"
# Takes seconds to read, so that something can be done meanwhile.
LONG = ("거래일자,내용,금액\n" + "2026-01-02,가상,-4500\n" * 190_000).encode()
_PARENT = """
import asyncio, sys
from pathlib import Path
from core.imports.reading.child import read_in_child
from core.imports.reading.limits import ReadingLimits
asyncio.run(read_in_child(
    Path(sys.argv[1]), encoding=None, password=None, out=Path(sys.argv[2]), limits=ReadingLimits()))
"""


def test_a_table_is_written_and_can_be_opened_again_later(tmp_path: Path) -> None:
    made = in_child(tmp_path, CSV.encode("cp949"))
    assert isinstance(made, ReadTable)
    assert made.head.columns == ("거래일자", "내용", "금액")
    assert open_table(tmp_path / "rows") == made
    assert list(made.rows()) == [Row(2, ("2026-01-02", "가상", "-4500"))]
    assert list(made.rows()) == list(made.rows())


def test_rows_are_for_their_owner_alone_and_no_half_table_stays(tmp_path: Path) -> None:
    in_child(tmp_path, CSV.encode())
    assert (tmp_path / "rows").stat().st_mode & 0o777 == 0o600
    assert sorted(path.name for path in tmp_path.iterdir()) == ["given", "rows"]
    limits = msgspec.structs.replace(LIMITS, rows_bytes_max=100)
    big = tmp_path / "big"
    big.mkdir()
    assert in_child(big, (CSV + CSV * 50).encode(), limits=limits) == Unreadable(Why.TOO_LARGE)
    assert [path.name for path in big.iterdir()] == ["given"]


def test_a_locked_file_is_read_once_and_its_password_is_nowhere_afterwards(tmp_path: Path) -> None:
    data = locked(workbook([["거래일자", "내용", "금액"], ["2026-01-02", "가상", -4500]]), PASSWORD)
    assert in_child(tmp_path, data) == Unreadable(Why.LOCKED)
    assert in_child(tmp_path, data, password="wrong") == Unreadable(Why.WRONG_PASSWORD)
    made = in_child(tmp_path, data, password=PASSWORD)
    assert isinstance(made, ReadTable)
    assert made.head.row_count == 1
    assert [path.name for path in tmp_path.iterdir() if PASSWORD.encode() in path.read_bytes()] == []


def test_the_password_is_in_no_argument_and_no_environment(tmp_path: Path) -> None:
    def look(child: psutil.Process) -> None:
        about = Path(f"/proc/{child.pid}")
        words = (about / "cmdline").read_bytes() + (about / "environ").read_bytes()
        assert b"core.imports.reading" in words
        assert PASSWORD.encode() not in words
        assert b"HARDCORE" not in words

    asyncio.run(_interrupted(tmp_path, look))


def test_the_child_puts_its_limits_on_itself(tmp_path: Path) -> None:
    def look(child: psutil.Process) -> None:
        text = Path(f"/proc/{child.pid}/limits").read_text()
        assert re.search(rf"Max address space +{LIMITS.address_space_bytes_max} ", text)
        assert re.search(rf"Max cpu time +{LIMITS.cpu_s_max} ", text)
        assert re.search(r"Max core file size +0 ", text)
        assert child.nice() > 0

    asyncio.run(_interrupted(tmp_path, look))


def test_a_reading_that_takes_too_long_is_ended(tmp_path: Path) -> None:
    limits = msgspec.structs.replace(LIMITS, wall_ms_max=50)
    assert in_child(tmp_path, LONG, limits=limits) == Unreadable(Why.TOO_SLOW)
    assert psutil.Process().children() == []


def test_the_child_does_not_outlive_the_process_that_started_it(tmp_path: Path) -> None:
    (tmp_path / "given").write_bytes(LONG)
    words = [sys.executable, "-c", _PARENT, str(tmp_path / "given"), str(tmp_path / "rows")]
    parent = subprocess.Popen(words, cwd=Path(__file__).parents[4])
    try:
        child = _stopped_at_work(psutil.Process(parent.pid))
    finally:
        parent.kill()
        parent.wait()
    until(
        lambda: not child.is_running() or child.status() == psutil.STATUS_ZOMBIE, "the reading child to end"
    )
    assert not (tmp_path / "rows").exists()


def test_too_much_memory_is_an_answer_and_not_the_end_of_the_ledger(tmp_path: Path) -> None:
    tight = msgspec.structs.replace(LIMITS, address_space_bytes_max=96 << 20)
    assert in_child(tmp_path, LONG, limits=tight) == Unreadable(Why.OUT_OF_MEMORY)


def test_two_cells_far_apart_do_not_make_a_table_of_all_between(tmp_path: Path) -> None:
    made = in_child(tmp_path, far_corner())
    assert isinstance(made, Unreadable)
    assert made.reason in {Why.OUT_OF_MEMORY, Why.TOO_MANY_ROWS, Why.UNREADABLE}


def test_a_bomb_a_huge_and_an_empty_file_are_told_early(tmp_path: Path) -> None:
    assert in_child(tmp_path, bomb(64 << 20)) == Unreadable(Why.ZIP_BOMB)
    assert in_child(tmp_path, b"x" * (50 << 20)) == Unreadable(Why.TOO_LARGE)
    assert in_child(tmp_path, b"") == Unreadable(Why.EMPTY)


def test_a_table_that_is_not_there_is_told(tmp_path: Path) -> None:
    assert open_table(tmp_path / "rows") == Unreadable(Why.UNREADABLE)
    (tmp_path / "rows").write_bytes(b"not json\n")
    assert open_table(tmp_path / "rows") == Unreadable(Why.UNREADABLE)


async def _interrupted(folder: Path, look: Callable[[psutil.Process], None]) -> None:
    """Begin a long reading, look at the child while it is stopped, and call the reading off."""
    (folder / "given").write_bytes(LONG)
    out = folder / "rows"
    reading = asyncio.create_task(
        read_in_child(folder / "given", encoding=None, password=PASSWORD, out=out, limits=LIMITS)
    )
    child = await asyncio.to_thread(_stopped_at_work, psutil.Process())
    try:
        look(child)
    finally:
        reading.cancel()
        with pytest.raises(asyncio.CancelledError):
            await reading
    assert not child.is_running()
    assert not out.exists()


def _stopped_at_work(parent: psutil.Process) -> psutil.Process:
    """The reading child of `parent`, stopped once it has limited itself, which is before it opens the file."""

    def at_work() -> psutil.Process | None:
        for child in parent.children():
            with suppress(psutil.NoSuchProcess):
                if child.rlimit(psutil.RLIMIT_CORE) == (0, 0) and child.nice() > 0:
                    child.suspend()
                    return child
        return None

    found = until(at_work, "the reading child to be at work")
    assert found is not None
    return found
