"""A core that serves reads only: ordered by its guard, shut by its store, or started so."""

import contextlib
import hashlib
import json
import shutil
import socket
import sqlite3
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from core.imports.waves import ROWS_MAX
from tests import stores
from tests.integration.lone_core import Core, ready, started
from tests.integration.test_imports import form, statement
from tests.waiting import WAIT_S, until

UNSHARE = shutil.which("unshare")
KEY = "Idempotency_Key"


class Notified:
    """The guard's end of the notify socket, and its words to the core's control socket."""

    def __init__(self, folder: Path) -> None:
        self.control = folder / "control"
        self.address = folder / "notify"
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(str(self.address))
        self._socket.settimeout(WAIT_S)
        self._heard: list[dict[str, str]] = []

    def environ(self, **more: str) -> dict[str, Any]:
        return {"HARDCORE_CONTROL": str(self.control), "NOTIFY_SOCKET": str(self.address), **more}

    def wait_for(self, name: str) -> dict[str, str]:
        """The next datagram with this field."""
        while True:
            lines = self._socket.recv(4096).decode().splitlines()
            told = dict(line.split("=", 1) for line in lines)
            self._heard.append(told)
            if name in told:
                return told

    def has_heard(self, name: str) -> bool:
        return any(name in told for told in self._heard)

    def order(self, **order: Any) -> Any:
        with socket.socket(socket.AF_UNIX) as line:
            line.settimeout(WAIT_S)
            line.connect(str(self.control))
            line.sendall(json.dumps(order).encode() + b"\n")
            return json.loads(line.makefile("rb").readline())

    def safe(self, *, on: bool, reason: str = "DISK_FULL", generation: int = 1) -> Any:
        return self.order(verb="safe", on=on, reason=reason, generation=generation)

    def close(self) -> None:
        self._socket.close()


@pytest.fixture
def guard(tmp_path: Path) -> Iterator[Notified]:
    made = Notified(tmp_path)
    yield made
    made.close()


def opened(core: Core) -> None:
    for name, kind in (("cash", "asset"), ("food", "expense")):
        assert core.open(name, kind).status == 201


def a_ledger(folder: Path) -> Path:
    """A folder with a ledger in it, left by a core that was killed: its last event is still in the log."""
    data = folder / "data"
    with started(data, sock=folder / "before") as core:
        opened(ready(core))
        assert core.move(500, "food", "cash", **{KEY: "before"}).status == 201
    return data


def is_refused(core: Core, reason: str, **headers: str) -> None:
    answer = core.move(7, "food", "cash", **headers)
    assert (answer.status, answer.body["type"]) == (503, "/problems/safe-mode"), answer
    assert (answer.body["outcome"], answer.body["safe"]) == ("not_done", reason)
    assert int(answer.headers["retry-after"]) == answer.body["retry_after"] > 1


# -- ordered -------------------------------------------------------------------------------------------


def test_a_core_ordered_to_read_only_refuses_new_writes_and_remembers_old_ones(
    tmp_path: Path, guard: Notified
) -> None:
    with started(tmp_path / "data", sock=tmp_path / "sock", **guard.environ()) as core:
        opened(ready(core))
        done = core.move(500, "food", "cash", **{KEY: "before"})
        assert done.status == 201
        assert guard.safe(on=True, reason="DISK_STALLED") == {"ok": True}
        assert guard.order(verb="status")["safe"] == "DISK_STALLED"
        is_refused(core, "DISK_STALLED")
        is_refused(core, "DISK_STALLED", **{KEY: "new"})
        again = core.move(500, "food", "cash", **{KEY: "before"})
        assert (again.status, again.headers.get("idempotent-replayed")) == (201, "true")
        assert again.body["id"] == done.body["id"]
        other = core.move(9, "food", "cash", **{KEY: "before"})
        assert (other.status, other.body["type"]) == (422, "/problems/key-reused")
        assert core.ask("GET", "/api/ledger/commands/before").body["outcome"] == "done"
        assert core.ask("GET", "/api/ledger/commands/new").body["outcome"] == "not_done"
        assert core.ask("GET", "/api/ledger/verify").body["ok"]
        assert guard.safe(on=False, reason="DISK_STALLED") == {"ok": True}
        assert guard.order(verb="status")["safe"] is None
        assert core.move(7, "food", "cash", **{KEY: "new"}).status == 201
        refused = guard.safe(on=True, generation=0)
        assert refused["ok"] is False


def test_no_way_of_writing_is_left_open(tmp_path: Path, guard: Notified) -> None:
    with started(tmp_path / "data", sock=tmp_path / "sock", **guard.environ()) as core:
        opened(ready(core))
        assert guard.safe(on=True) == {"ok": True}
        for path, body in (
            ("/api/ledger/imports", b"x"),
            ("/api/ledger/entries", {"date": "2026-11-21", "amount": "-5", "account": "cash"}),
            ("/api/ledger/accounts", {"id": "a", "name": "a", "type": "asset", "currency": "KRW"}),
        ):
            answer = core.ask("POST", path, body)
            assert (answer.status, answer.body["type"]) == (503, "/problems/safe-mode"), (path, answer)
        assert core.ask("GET", "/api/ledger/imports").status == 200


def test_an_import_rests_while_only_reads_are_served_and_goes_on_later(
    tmp_path: Path, guard: Notified
) -> None:
    rows = 4_000
    with started(tmp_path / "data", sock=tmp_path / "sock", **guard.environ()) as core:
        opened(ready(core))
        body, kind = form(statement(rows, "row"), {"account": "cash"}, "bank.csv")
        made = core.ask("POST", "/api/ledger/imports", body, Content_Type=kind, Idempotency_Key="file")
        assert made.status == 201, made
        path = f"/api/ledger/imports/{made.body['id']}"
        assert core.ask("POST", f"{path}/commit", {}).status == 202
        until(lambda: core.ask("GET", "/healthz").body["seq"] > 10, "the first rows to be booked")
        assert guard.safe(on=True) == {"ok": True}
        seq = core.ask("GET", "/healthz").body["seq"]
        # Again under its key the upload is not told that nothing was done, and the wish that stands is shown.
        again = core.ask("POST", "/api/ledger/imports", body, Content_Type=kind, Idempotency_Key="file")
        assert (again.status, again.body["outcome"]) == (503, "unknown")
        assert core.ask("POST", f"{path}/commit", {}).status == 202
        for _ in range(3):
            assert core.ask("GET", "/api/ledger/verify").body["ok"]  # each takes longer than a wave of rows
            assert core.ask("GET", "/healthz").body["seq"] <= seq + ROWS_MAX
        assert core.ask("GET", path).body["state"] == "committing"
        assert guard.safe(on=False) == {"ok": True}
        ended = until(lambda: is_over(core, path), "the import to end")
        assert ended is not None
        assert (ended["state"], ended["rows"]["new"], ended["rows"]["refused"]) == ("done", rows, 0)


def is_over(core: Core, path: str) -> dict[str, Any] | None:
    now: dict[str, Any] = core.ask("GET", path).body
    return None if now["state"] == "committing" else now


# -- shut by its store ---------------------------------------------------------------------------------


def test_a_full_disk_shuts_the_core_for_writes_tells_the_guard_and_room_opens_it_again(
    tmp_path: Path, guard: Notified
) -> None:
    with started(tmp_path / "data", sock=tmp_path / "sock", **guard.environ()) as core:
        opened(ready(core))
        drill = guard.order(verb="drill", fault="diskfull", generation=1, seconds=60)
        assert drill == {"ok": True}
        assert guard.wait_for("X_STORE")["X_STORE"] == "FULL"
        until(lambda: guard.order(verb="status")["safe"] == "DISK_FULL", "the core to shut itself")
        is_refused(core, "DISK_FULL", **{KEY: "k"})
        refused = guard.safe(on=False)
        assert refused["ok"] is False
        assert "DISK_FULL" in refused["error"]
        assert core.ask("GET", "/api/ledger/accounts").status == 200
        # The drill goes on for a while; a shorter one takes its place.
        assert guard.order(verb="drill", fault="diskfull", generation=1, seconds=1) == {"ok": True}
        until(lambda: guard.safe(on=False)["ok"], "the store to take a write again")
        assert guard.wait_for("X_STORE")["X_STORE"] == "OK"
        assert core.move(7, "food", "cash", **{KEY: "k"}).status == 201


# -- started so ----------------------------------------------------------------------------------------


def contents(data: Path) -> dict[str, str]:
    """The digests of everything in a folder but the shared index, which readers lock."""
    return {
        str(path.relative_to(data)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(data.rglob("*"))
        if path.is_file() and not path.name.endswith("-shm")
    }


@pytest.mark.in_a_file  # of which no byte is changed
def test_a_core_started_to_read_only_serves_what_is_there_and_changes_nothing(
    tmp_path: Path, guard: Notified
) -> None:
    data = a_ledger(tmp_path)
    before = contents(data)
    assert "ledger.db-wal" in before
    environ = guard.environ(HARDCORE_SAFE="DISK_FULL", HARDCORE_EPOCH="1")
    with started(data, sock=tmp_path / "sock", **environ) as core:
        ready(core)
        told = guard.wait_for("READY")
        assert (told["X_EPOCH"], told["X_SEQ"], told["X_PROOF"], told["X_TAIL"]) == ("1", "3", "none", "0")
        page = core.ask("GET", "/api/ledger/accounts/food")
        assert (page.status, page.headers["x-core-epoch"]) == (200, "1")
        assert core.ask("GET", "/healthz").body == {
            "epoch": 1,
            "seq": 3,
            "safe": "DISK_FULL",
            "checkpoint": None,
        }
        is_refused(core, "DISK_FULL")
        is_refused(core, "DISK_FULL", **{KEY: "new"})
        # It has fenced nobody: whether what it finds will last, it can't say, and what it does not find is not there.
        kept = core.move(500, "food", "cash", **{KEY: "before"})
        assert (kept.status, kept.body["outcome"]) == (503, "unknown")
        assert core.ask("GET", "/api/ledger/commands/before").body["outcome"] == "unknown"
        assert core.ask("GET", "/api/ledger/commands/new").status == 404
        refused = guard.safe(on=False)
        assert refused["ok"] is False
        assert "another" in refused["error"]
        assert "X_VERIFIED" in guard.wait_for("X_VERIFIED")
        assert not guard.order(verb="drill", fault="diskfull", generation=1)["ok"]
        core.process.terminate()
        assert core.ends_with() == 0
    assert contents(data) == before
    with started(data, sock=tmp_path / "after") as core:
        assert ready(core).ask("GET", "/healthz").body == {
            "epoch": 2,
            "seq": 3,
            "safe": None,
            "checkpoint": None,
        }
        again = core.move(500, "food", "cash", **{KEY: "before"})
        assert (again.status, again.headers.get("idempotent-replayed")) == (201, "true")


def at_rest(folder: Path) -> Path:
    """A folder with a ledger that a core has left in order: one file, and nothing in a log."""
    data = a_ledger(folder)
    with started(data, sock=folder / "resting") as core:
        ready(core)
        core.process.terminate()
        assert core.ends_with() == 0
    assert not (data / "ledger.db-wal").exists()
    return data


def test_of_a_core_that_only_reads_nothing_is_left_but_an_empty_log(tmp_path: Path) -> None:
    data = at_rest(tmp_path)
    before = contents(data)
    with started(data, sock=tmp_path / "sock", HARDCORE_SAFE="DISK_FULL") as core:
        assert ready(core).ask("GET", "/healthz").body["seq"] == 3
        core.process.terminate()
        assert core.ends_with() == 0
    (data / "ledger.db-wal").touch()
    assert contents(data) == before | {"ledger.db-wal": hashlib.sha256(b"").hexdigest()}


@pytest.mark.in_a_file
def test_a_ledger_that_somebody_is_at_work_on_is_not_read_as_if_nobody_were(tmp_path: Path) -> None:
    data = at_rest(tmp_path)
    with contextlib.closing(sqlite3.connect(data / "ledger.db", isolation_level=None)) as other:
        other.execute("PRAGMA locking_mode = EXCLUSIVE").close()
        other.execute("SELECT epoch FROM meta").close()
        other.execute("BEGIN IMMEDIATE").close()
        with started(
            data, sock=tmp_path / "sock", HARDCORE_SAFE="DB_LOCKED", CORE_WRITE_BUSY_MS="10"
        ) as core:
            assert core.ends_with() == 69
            assert "Another program holds the ledger's lock" in core.said()


def test_a_damaged_ledger_is_read_as_far_as_it_can_be_and_told_unsound(
    tmp_path: Path, guard: Notified
) -> None:
    data = a_ledger(tmp_path)
    stores.tamper(data, "UPDATE account SET posted = posted + 1 WHERE id = 'food'")
    environ = guard.environ(HARDCORE_SAFE="STORE_CORRUPT")
    with started(data, sock=tmp_path / "sock", **environ) as core:
        ready(core)
        assert core.ask("GET", "/api/ledger/accounts").status == 200
        is_refused(core, "STORE_CORRUPT")
        assert "not whole" in guard.wait_for("X_UNSOUND")["X_UNSOUND"]


def test_where_not_even_the_head_can_be_read_the_core_leaves_with_the_code_of_a_damaged_store(
    tmp_path: Path,
) -> None:
    data = tmp_path / "data"
    data.mkdir()
    (data / "ledger.lock").touch()
    (data / "ledger.db").write_bytes(b"no database at all, and long enough to be looked at" * 100)
    with started(data, sock=tmp_path / "sock", HARDCORE_SAFE="STORE_CORRUPT") as core:
        assert core.ends_with() == 65
        assert "not even its head can be read" in core.said()


@pytest.mark.in_a_file
def test_without_a_ledger_there_is_nothing_to_read(tmp_path: Path) -> None:
    with started(tmp_path / "data", sock=tmp_path / "sock", HARDCORE_SAFE="DISK_FULL") as core:
        assert core.ends_with() == 78
    assert list((tmp_path / "data").iterdir()) == []


# -- a real disk ---------------------------------------------------------------------------------------


def own_mounts() -> bool:
    argv = [UNSHARE or "unshare", "--mount", "mount", "-t", "tmpfs", "none", "/mnt"]
    return UNSHARE is not None and subprocess.run(argv, capture_output=True, check=False).returncode == 0


with_mounts = pytest.mark.skipif(not own_mounts(), reason="no mounts of one's own here: that needs root")


class Disk:
    """A file system of 4 MiB in a namespace of its own, kept by a process that does nothing else."""

    def __init__(self, folder: Path) -> None:
        self.data = folder / "data"
        self.data.mkdir()
        script = 'mount -t tmpfs -o size=4m,mode=700 none "$1" && echo mounted && exec cat'
        argv = [UNSHARE or "unshare", "--mount", "sh", "-c", script, "sh", str(self.data)]
        self.keeper = subprocess.Popen(argv, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        assert self.keeper.stdout is not None
        assert self.keeper.stdout.readline() == b"mounted\n"
        self.outside = Path(f"/proc/{self.keeper.pid}/root{self.data}")

    def inside(self, *argv: str) -> list[str]:
        return ["nsenter", f"--mount=/proc/{self.keeper.pid}/ns/mnt", *argv]

    def fill(self) -> None:
        with (self.outside / "filler").open("wb", buffering=0) as file:
            for size in (65536, 4096, 512):
                try:
                    while True:
                        file.write(b"x" * size)
                except OSError:
                    continue

    def make_room(self) -> None:
        (self.outside / "filler").unlink()

    def turn_read_only(self) -> None:
        subprocess.run(self.inside("mount", "-o", "remount,ro", str(self.data)), check=True)

    def end(self) -> None:
        self.keeper.kill()
        self.keeper.wait(WAIT_S)
        for pipe in (self.keeper.stdin, self.keeper.stdout):
            assert pipe is not None
            pipe.close()


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Disk]:
    made = Disk(tmp_path)
    yield made
    made.end()


@contextmanager
def on(disk: Disk, sock: Path, **environ: Any) -> Iterator[Core]:
    """A core whose data is on this disk."""
    with started(disk.data, sock=sock, before=disk.inside(), **environ) as core:
        yield core


@with_mounts
def test_on_a_disk_that_is_really_full_nothing_is_unknown_and_no_core_dies(
    tmp_path: Path, disk: Disk, guard: Notified
) -> None:
    with on(disk, tmp_path / "sock", **guard.environ()) as core:
        opened(ready(core))
        assert core.move(1, "food", "cash", **{KEY: "before"}).status == 201
        disk.fill()
        is_refused(core, "DISK_FULL", **{KEY: "k"})
        assert guard.wait_for("X_STORE")["X_STORE"] == "FULL"
        assert core.move(1, "food", "cash", **{KEY: "before"}).status == 201
        assert not guard.safe(on=False)["ok"]
        disk.make_room()
        assert guard.safe(on=False) == {"ok": True}
        assert core.move(7, "food", "cash", **{KEY: "k"}).status == 201
        assert core.ask("GET", "/api/ledger/verify").body["ok"]


@with_mounts
@pytest.mark.parametrize("end", ["killed", "asked to leave"])
def test_on_a_full_or_read_only_disk_a_core_can_be_started_to_read(
    tmp_path: Path, disk: Disk, end: str
) -> None:
    with on(disk, tmp_path / "first") as core:
        opened(ready(core))
        if end != "killed":
            core.process.terminate()
            assert core.ends_with() == 0
    disk.fill()
    with on(disk, tmp_path / "fenced") as core:
        assert core.ends_with() == 73
    with on(disk, tmp_path / "full", HARDCORE_SAFE="DISK_FULL") as core:
        assert ready(core).ask("GET", "/healthz").body["seq"] == 2
        is_refused(core, "DISK_FULL")
    disk.make_room()
    disk.turn_read_only()
    with on(disk, tmp_path / "locked") as core:
        assert core.ends_with() == 73
        assert "is read-only" in core.said()
    with on(disk, tmp_path / "read", HARDCORE_SAFE="DISK_READ_ONLY") as core:
        assert ready(core).ask("GET", "/api/ledger/accounts").status == 200
        is_refused(core, "DISK_READ_ONLY")
