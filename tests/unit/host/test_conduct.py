"""Strange conduct is a fact in words; what a core always does is none."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from hardcore.host import conduct
from tests.waiting import until

PARENT = """
import subprocess, sys
child = subprocess.Popen(sys.argv[1:], stdin=subprocess.PIPE) if sys.argv[1:] else None
print("begun", flush=True)
sys.stdin.read()
child and child.communicate()
"""
LISTENER = """
import socket, sys
with socket.create_server(("127.0.0.1", 0)) as server:
    print(server.getsockname()[1], flush=True)
    sys.stdin.read()
"""
CAT = [sys.executable, "-c", "import sys; sys.stdin.read()"]


@contextmanager
def running(code: str, *argv: str) -> Iterator[tuple[int, str]]:
    with subprocess.Popen(
        [sys.executable, "-c", code, *argv], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        yield process.pid, process.stdout.readline().strip()
        assert process.stdin is not None
        process.stdin.close()
        process.wait()


def test_a_child_that_no_core_has_is_named_by_its_program_and_not_by_its_arguments() -> None:
    with running(PARENT, *CAT) as (pid, _):
        (said,) = until(conduct._ChildrenWatch(pid).look, "the child to be seen")
    assert "python" in said
    assert "stdin" not in said


def test_the_reader_of_a_banks_file_is_a_child_that_a_core_has(tmp_path: Path) -> None:
    stub = tmp_path / "core" / "imports" / "reading.py"
    stub.parent.mkdir(parents=True)
    stub.write_text("import sys; sys.stdin.read()")
    reader = [sys.executable, "-c", "import os, sys; os.execv(sys.argv[1], sys.argv[1:])", sys.executable]
    with running(PARENT, *reader, "-m", "core.imports.reading", "-") as (pid, _):
        watch = conduct._ChildrenWatch(pid)
        expected = until(
            lambda: [
                one for one in conduct._found_children(pid) if conduct._EXPECTED.search(conduct._command(one))
            ],
            "the reader",
        )
        assert expected
        assert watch.look() == ()


def test_a_process_without_children_shows_none() -> None:
    with running(PARENT) as (pid, _):
        assert conduct._ChildrenWatch(pid).look() == ()


def test_a_port_that_is_listened_on_is_named_and_one_of_another_process_is_not() -> None:
    with ExitStack() as both:
        listener, port = both.enter_context(running(LISTENER))
        other, _ = both.enter_context(running(PARENT))
        assert conduct.listening(listener) == (f"port {port}",)
        assert conduct.listening(other) == ()


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package of a core that can be changed."""
    folder = tmp_path / "rollers"
    (folder / "rooms").mkdir(parents=True)
    (folder / "__init__.py").write_text("")
    (folder / "rooms" / "__init__.py").write_text("")
    (folder / "rooms" / "book.py").write_text("a = 1\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    return folder


def test_code_that_is_what_it_was_is_no_news_and_each_kind_of_change_is(package: Path) -> None:
    with running(PARENT) as (pid, _):
        watch = conduct._CodeWatch(pid, "rollers")
        assert watch.look() == ()
        assert watch.look() == ()
        (package / "rooms" / "book.py").write_text("a = 12\n")
        (package / "rooms" / "new.py").write_text("")
        (package / "__init__.py").unlink()
        assert watch.look() == (
            "rollers/__init__.py is gone",
            "rollers/rooms/book.py has changed",
            "rollers/rooms/new.py is new",
        )


def test_many_changes_are_told_up_to_a_bound(package: Path) -> None:
    with running(PARENT) as (pid, _):
        watch = conduct._CodeWatch(pid, "rollers")
        watch.look()
        for number in range(50):
            (package / f"new_{number}.py").write_text("")
        assert len(watch.look()) == conduct.TOLD_MAX


def test_a_jump_is_told_against_the_lifes_own_middle_and_growth_that_lasts_becomes_usual() -> None:
    with running(PARENT) as (pid, _):
        watch = conduct.ConductWatch(pid)

        def jumps(threads: int, fds: int | None) -> tuple[str, ...]:
            return watch.look(0, threads, fds).jumps

        assert all(jumps(9, 30) == () for _ in range(conduct.LOOKS_NEEDED))
        assert jumps(9 + conduct.THREADS_JUMP, 30 + conduct.FDS_JUMP) == ()
        assert jumps(60, None) == ("60 threads, usually 9",)
        assert jumps(9, 400) == ("400 open files, usually 30",)
        for _ in range(conduct.LOOKS_KEPT):
            jumps(60, 30)
        assert jumps(60, 30) == ()


def test_a_core_that_begins_is_not_measured_by_its_first_looks() -> None:
    with running(PARENT) as (pid, _):
        watch = conduct.ConductWatch(pid)
        assert watch.look(0, 1, 8).jumps == ()
        assert watch.look(0, 200, 900).jumps == ()


def test_a_process_that_is_gone_shows_nothing_strange() -> None:
    with running(PARENT) as (pid, _):
        pass
    assert conduct._ChildrenWatch(pid).look() == ()
    assert conduct.listening(pid) == ()
