"""The guard's orders to a real core, and what both then see: drills, tasks, and stacks that name who waits.

Each core here is a process with a ledger; the guard's side is the guard's own code.
"""

import asyncio
import http.client
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from hardcore.host.core_control import give
from hardcore.host.locks import read_table, writers_in
from hardcore.host.recorder import PageReader, make_page
from hardcore.model.looks import ThreadStack
from hardcore.model.recorder import CommandNote, Page, SlotStage
from hardcore.snapshot.stacks import find_tools, sample
from hardcore.snapshot.tasks import ask
from tests.integration.lone_core import ROOT, Answer, Core, clean_environment, ready, started
from tests.waiting import WAIT_S, until

NONCE = "nonce-1"


class Watched:
    """A core under watch, from the guard's side of its wires."""

    def __init__(self, core: Core, folder: Path) -> None:
        self.core = core
        self.pid = core.process.pid
        self.data = folder / "data"
        self.control = folder / "control"
        self.reader = PageReader(folder / "page", NONCE)
        self._asking = ThreadPoolExecutor(4)

    def order(self, **order: object) -> str:
        return asyncio.run(give(self.control, order, WAIT_S))

    def drill(self, fault: str, generation: int = 1) -> str:
        return self.order(verb="drill", fault=fault, generation=generation)

    def in_flight(self) -> dict[str, CommandNote]:
        return {note.kind: note for note in self.reader.in_flight() or ()}

    def waits(self, kind: str) -> CommandNote:
        """Wait until a command of this kind is in flight."""
        found = until(lambda: self.in_flight().get(kind), f"a {kind} to be in flight")
        assert found is not None
        return found

    def decided(self, kind: str) -> CommandNote:
        """Wait until a command of this kind is being decided."""

        def look() -> CommandNote | None:
            note = self.in_flight().get(kind)
            return note if note is not None and note.stage is SlotStage.DECIDING else None

        found = until(look, f"a {kind} to be decided")
        assert found is not None
        return found

    def events(self) -> list[str]:
        """What has happened in the core so far, by its codes."""
        page = self.reader.read()
        assert isinstance(page, Page), page
        return [event.code for event in page.events]

    def post(self, amount: int = 5) -> "Future[Answer | None]":
        """Send a booking from a thread of its own; None if the core was gone before it answered."""

        def send() -> Answer | None:
            try:
                return self.core.move(amount, "food", "cash", Idempotency_Key=f"k-{amount}")
            except (OSError, http.client.HTTPException):
                return None

        return self._asking.submit(send)

    def stacks(self) -> dict[int, ThreadStack]:
        found = sample(self.pid, find_tools(), time.monotonic_ns() + int(WAIT_S * 1e9))
        assert not isinstance(found, str), found
        return {stack.tid: stack for stack in found[0]}


@contextmanager
def watched(folder: Path, **environ: Any) -> Iterator[Watched]:
    make_page(folder / "page", NONCE, "boot")
    wires: dict[str, Any] = {
        "HARDCORE_RECORDER": str(folder / "page"),
        "HARDCORE_CONTROL": str(folder / "control"),
    }
    with started(folder / "data", sock=folder / "sock", **wires, **environ) as core:
        guard = Watched(core, folder)
        try:
            yield guard
        finally:
            core.process.kill()  # first: whoever still waits for an answer hears of it
            guard.reader.close()
            guard._asking.shutdown()


@pytest.fixture
def watch(tmp_path: Path) -> Iterator[Watched]:
    with watched(tmp_path) as guard:
        ready(guard.core)
        assert guard.core.open("cash").status == 201
        assert guard.core.open("food", "expense").status == 201
        yield guard


@contextmanager
def holding_lock(data: Path, seconds: int) -> Iterator["subprocess.Popen[str]"]:
    with subprocess.Popen(
        [sys.executable, "-m", "core", "hold-lock", "--data", str(data), "--seconds", str(seconds)],
        cwd=ROOT,
        env=clean_environment(),
        stdout=subprocess.PIPE,
        text=True,
    ) as holder:
        try:
            assert holder.stdout is not None
            assert "Holding the write lock" in holder.stdout.readline()
            yield holder
        finally:
            holder.kill()


def held_by(data: Path) -> set[int]:
    table = read_table()
    assert not isinstance(table, str), table
    return {holder.pid for holder in writers_in(data, 0, table)}


def names_in(stack: ThreadStack) -> dict[str, set[str]]:
    """All that the frames of a thread say, by name."""
    found: dict[str, set[str]] = {}
    for frame in stack.frames:
        for name, value in frame.names:
            found.setdefault(name, set()).add(value)
    return found


def functions_of(stack: ThreadStack) -> list[str]:
    return [frame.function for frame in stack.frames]


def test_a_command_that_is_decided_for_ever_names_itself_in_page_and_stacks(watch: Watched) -> None:
    assert watch.drill("slow-tx") == ""
    note = watch.decided("drill")
    assert note.account_ids == ("system:drill",)
    names = names_in(watch.stacks()[note.thread])
    assert note.transaction_id in names["transaction_id"]
    assert "system:drill" in names["account_id"]


def test_others_queue_behind_it_while_the_loop_lives_and_tells_who_they_are(watch: Watched) -> None:
    assert watch.drill("slow-tx") == ""
    watch.decided("drill")
    watch.post()
    queued = watch.waits("transaction.post")
    assert queued.stage is SlotStage.QUEUED
    told = ask(watch.control, time.monotonic_ns() + int(WAIT_S * 1e9))
    assert not isinstance(told, str), told
    tasks = {task["transaction_id"]: task for task in told["tasks"] if task["transaction_id"]}
    booking = tasks[queued.transaction_id]
    assert booking["name"] == f"cmd:{queued.transaction_id}"
    assert booking["account_id"] == "food,cash"
    assert booking["waits_at"].startswith("core/")
    assert watch.core.process.poll() is None
    assert watch.core.ask("GET", "/api/ledger/accounts").status == 200


def test_a_deadlock_shows_two_threads_that_wait_for_each_other(watch: Watched) -> None:
    assert watch.drill("deadlock") == ""
    note = watch.decided("drill")

    def cycle() -> dict[int, dict[str, set[str]]]:
        found = {t: names_in(s) for t, s in watch.stacks().items() if "wait_for_lock" in functions_of(s)}
        return found if len(found) == 2 else {}

    waiting = until(cycle, "both threads to wait")
    assert note.thread in waiting
    (other,) = waiting.keys() - {note.thread}
    assert waiting[note.thread]["held_by"] == {str(other)}
    assert waiting[other]["held_by"] == {str(note.thread)}
    assert waiting[note.thread]["lock_name"] == {"drill.theirs"}
    assert waiting[other]["lock_name"] == {"drill.ours"}
    assert note.transaction_id in waiting[note.thread]["transaction_id"]
    assert watch.order(verb="status") == ""


def test_who_waits_for_the_stores_lock_is_named_in_the_stacks_and_the_holder_in_the_kernels_table(
    tmp_path: Path,
) -> None:
    with watched(tmp_path, CORE_WRITE_BUSY_MS="60000") as watch:
        ready(watch.core)
        assert watch.core.open("cash").status == 201
        assert watch.core.open("food", "expense").status == 201
        with holding_lock(watch.data, 60) as holder:
            answer = watch.post()
            queued = watch.waits("transaction.post")
            until(
                lambda: (b := watch.reader.beats()) is not None and b.in_store_since_ns,
                "the store to be asked",
            )
            page = watch.reader.read()
            assert isinstance(page, Page)
            names = names_in(watch.stacks()[page.threads.writer])
            assert names["transaction_id"] == {queued.transaction_id}
            assert names["account_id"] == {"food,cash"}
            holder.terminate()
            assert holder.wait(WAIT_S) == 0
        told = answer.result(WAIT_S)
        assert told is not None
        assert told.status == 201


def test_an_order_that_comes_before_the_book_is_open_is_refused_with_a_sentence(
    watch: Watched, tmp_path: Path
) -> None:
    with holding_lock(watch.data, 60):
        second = tmp_path / "second"
        second.mkdir()
        (second / "data").symlink_to(watch.data)
        with watched(second, CORE_FENCE_BUSY_MS="60000") as early:
            until(early.control.exists, "the second core's control socket")
            assert early.drill("slow-tx") == "The core has not opened its book yet."
            assert early.order(verb="safe", on=True, reason="DISK_FULL", generation=1) != ""
            assert early.order(verb="status") == ""


def test_a_term_is_obeyed_also_while_a_command_is_stuck_for_ever(tmp_path: Path) -> None:
    with watched(tmp_path, CORE_DRAIN_MS="50", CORE_CLOSE_MS="50") as watch:
        ready(watch.core)
        assert watch.core.open("cash").status == 201
        assert watch.drill("slow-tx") == ""
        watch.decided("drill")
        watch.core.process.terminate()
        assert watch.core.ends_with() == 0
        assert watch.events()[-2:] == ["DRAIN_INCOMPLETE", "CLOSE_INCOMPLETE"]


def test_a_term_is_obeyed_also_while_a_proof_of_the_whole_book_is_stuck_for_ever(tmp_path: Path) -> None:
    stuck = (sys.executable, "-m", "tests.contract.core_with_stuck_proof")
    with watched(
        tmp_path, before=stuck, CORE_DRAIN_MS="50", CORE_CLOSE_MS="50", CORE_VERIFY_AFTER_MS="0"
    ) as watch:
        ready(watch.core)
        until(lambda: "The proof is stuck" in watch.core.said(), "the proof to be stuck")
        watch.core.process.terminate()
        assert watch.core.ends_with() == 0
        assert watch.events()[-1] == "CLOSE_INCOMPLETE"
        assert "DRAIN_INCOMPLETE" not in watch.events()


def test_a_key_behind_a_stuck_writer_is_unknown_and_reads_go_on(tmp_path: Path) -> None:
    with watched(tmp_path, CORE_WRITE_BUSY_MS="10") as watch:
        ready(watch.core)
        assert watch.core.open("cash").status == 201
        assert watch.core.open("food", "expense").status == 201
        assert watch.drill("slow-tx") == ""
        watch.decided("drill")
        watch.post(5)
        watch.waits("transaction.post")
        assert safe(watch, 1, on=True) == ""
        for _ in range(3):
            assert watch.core.ask("GET", "/api/ledger/commands/k-5").body["outcome"] == "unknown"
        again = watch.core.move(5, "food", "cash", Idempotency_Key="k-5")
        assert (again.status, again.body["outcome"]) == (503, "unknown")
        until(lambda: set(watch.in_flight()) == {"drill", "transaction.post"}, "the slots of those who asked")
        assert watch.core.ask("GET", "/api/ledger/accounts").status == 200


@pytest.mark.parametrize("fault", ["slow-tx", "deadlock"])
def test_what_a_drill_has_stuck_leaves_no_trace_in_the_ledger(watch: Watched, fault: str) -> None:
    head = watch.core.ask("GET", "/healthz").body["seq"]
    assert watch.drill(fault) == ""
    watch.decided("drill")
    watch.core.process.kill()
    watch.core.ends_with()
    with started(watch.data, sock=watch.data.parent / "sock-2") as core:
        ready(core)
        assert core.ask("GET", "/healthz").body["seq"] == head
        assert core.ask("GET", "/api/ledger/verify").body["ok"]


def safe(watch: Watched, generation: int, *, on: bool) -> str:
    return watch.order(verb="safe", on=on, reason="DISK_FULL", generation=generation)


def test_a_disk_that_is_full_for_a_while_makes_the_core_read_only_without_anybodys_write(
    watch: Watched,
) -> None:
    assert watch.order(verb="drill", fault="diskfull", generation=1, seconds=60) == ""
    until(lambda: "SAFE_ON" in watch.events(), "the core to read only")
    refused = watch.core.move(5, "food", "cash", Idempotency_Key="k-1")
    assert (refused.status, refused.body["outcome"]) == (503, "not_done")
    assert watch.core.ask("GET", "/api/ledger/accounts").status == 200
    assert "takes no write" in safe(watch, 2, on=False)


def test_a_disk_that_has_room_again_is_written_to_once_the_guard_says_so(watch: Watched) -> None:
    assert watch.order(verb="drill", fault="diskfull", generation=1, seconds=1) == ""
    until(lambda: "SAFE_ON" in watch.events(), "the core to read only")
    until(lambda: safe(watch, 2, on=False) == "", "the store to take a write")
    assert watch.core.move(5, "food", "cash", Idempotency_Key="k-1").status == 201


def test_a_healthy_core_reads_only_and_writes_again_as_it_is_told(watch: Watched) -> None:
    assert safe(watch, 1, on=True) == ""
    assert watch.core.move(5, "food", "cash", Idempotency_Key="k-1").status == 503
    assert safe(watch, 1, on=False) == ""
    assert watch.core.move(5, "food", "cash", Idempotency_Key="k-1").status == 201


def test_no_drill_is_begun_for_an_older_generation(watch: Watched) -> None:
    assert watch.drill("slow-tx", generation=7) == ""
    note = watch.decided("drill")
    assert "Generation 6 is over" in watch.drill("crash", generation=6)
    assert [n.command_id for n in watch.reader.in_flight() or ()] == [note.command_id]
    assert watch.core.process.poll() is None


def test_the_policys_limit_is_that_of_a_write(tmp_path: Path) -> None:
    with watched(tmp_path, HARDCORE_LIMIT_MS="250") as watch:
        ready(watch.core)
        assert watch.core.open("cash").status == 201
        assert watch.drill("slow-tx") == ""
        assert watch.decided("drill").limit_ns == 250_000_000


def test_the_lock_of_a_drill_is_seen_by_the_kernel_and_changes_nothing(watch: Watched) -> None:
    head = watch.core.ask("GET", "/healthz").body["seq"]
    files = {
        path.name: path.read_bytes() for path in watch.data.glob("ledger.db*") if path.suffix != ".db-shm"
    }
    with holding_lock(watch.data, 60) as holder:
        assert held_by(watch.data) == {holder.pid}
        assert watch.core.move(5, "food", "cash").status == 503
        holder.send_signal(signal.SIGTERM)
        assert holder.wait(WAIT_S) == 0
    assert held_by(watch.data) == set()
    assert {name: (watch.data / name).read_bytes() for name in files} == files
    assert watch.core.move(5, "food", "cash").status == 201
    assert watch.core.ask("GET", "/healthz").body["seq"] == head + 1


def test_a_core_that_is_drilled_for_a_locked_store_knocks_until_it_is_let_in(watch: Watched) -> None:
    with holding_lock(watch.data, 60) as holder:
        assert watch.drill("dblock") == ""
        until(lambda: watch.events().count("STORE_BUSY") > 1, "it to have been turned away twice")
        assert "drill" in watch.in_flight()
        holder.terminate()
        assert holder.wait(WAIT_S) == 0
    until(lambda: not watch.in_flight(), "the drill to have ended")
    assert watch.core.move(5, "food", "cash").status == 201


def test_the_lock_of_a_drill_is_let_go_in_time_by_itself(watch: Watched) -> None:
    with holding_lock(watch.data, 1) as holder:
        assert holder.wait(WAIT_S) == 0
    assert watch.core.move(5, "food", "cash").status == 201


def test_a_ledger_at_rest_is_the_same_file_after_a_lock(tmp_path: Path) -> None:
    with started(tmp_path / "data") as core:
        ready(core)
        assert core.open("cash").status == 201
        core.process.terminate()
        assert core.ends_with() == 0
    before = (tmp_path / "data" / "ledger.db").read_bytes()
    with holding_lock(tmp_path / "data", 60) as holder:
        holder.terminate()
        assert holder.wait(WAIT_S) == 0
    assert (tmp_path / "data" / "ledger.db").read_bytes() == before


def refused(data: Path) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, "-m", "core", "hold-lock", "--data", str(data)],
        cwd=ROOT,
        env={**clean_environment(), "CORE_FENCE_BUSY_MS": "10"},
        capture_output=True,
        text=True,
        timeout=WAIT_S,
        check=False,
    )


def test_where_there_is_no_ledger_nothing_is_locked_and_nothing_made(tmp_path: Path) -> None:
    told = refused(tmp_path)
    assert told.returncode == 78
    assert "There is no ledger" in told.stderr
    (tmp_path / "ledger.db").write_bytes(b"something else " * 100)
    told = refused(tmp_path)
    assert told.returncode == 78
    assert told.stdout == ""
    assert [path.name for path in tmp_path.iterdir()] == ["ledger.db"]


def test_a_lock_that_somebody_else_has_is_not_waited_for_for_ever(watch: Watched) -> None:
    with holding_lock(watch.data, 60):
        told = refused(watch.data)
    assert told.returncode == 69
    assert "Another program holds the ledger's lock" in told.stderr
