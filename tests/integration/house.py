"""A whole guarded ledger for a test: `hardcore up` as a person starts it, with real processes and real sockets.

A house has a data folder of its own, a policy with short waits, and a port that the machine chose. What a test
does to it goes through the doors that people and kernels use: HTTP, the command line, the control socket, and
signals through pidfds. When it ends, whatever names its folders is killed and looked for again until nothing is
left; a fixture that only stopped what it had started would miss what the guard itself has started since.
"""

import contextlib
import http.client
import json
import os
import select
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Self

import psutil

from hardcore.control import client
from hardcore.host.folders import Folders, locate
from postmortem import bundle
from postmortem import cli as incidents_cli
from tests import stores
from tests.waiting import until

#: A cold start takes under a second; a machine that does much else at once may take this long.
START_S: Final = 30.0
ANSWER_S: Final = 30.0
COMMAND_S: Final = 50.0
SWEEPS_MAX: Final = 50

#: Waits made short, patience as people have it, and a budget that a module full of kills does not spend.
#: Without a spare, because a second core beside each one costs a machine that runs many houses half of itself, and
#: because the cold way is the one that has to hold when there is none. Where the spare is the subject, a test asks
#: for one: `new_house(**WITH_SPARE)`.
POLICY: Final[Mapping[str, Any]] = {
    "version": 1,
    "probation_ms": 300,
    "backoff_initial_ms": 50,
    "backoff_max_ms": 400,
    "stop_timeout_ms": 5000,
    "clean_after_ms": 500,
    "snapshot_budget_ms": 10_000,
    "max_restart_count": 1000,
    "spare": False,
    "gateway": {"hold_ms": 25_000, "drain_ms": 1000},
}

#: A house that keeps a spare, whatever this machine has to spare.
WITH_SPARE: Final[Mapping[str, Any]] = {"spare": True, "spare_memory_mb": 0}

BANK: Final = "assets:bank:kb"
SALARY: Final = "income:salary"


@dataclass(frozen=True)
class Answer:
    """What came back over HTTP. `body` is the JSON in it, empty if it is none."""

    status: int
    headers: Mapping[str, str]
    body: dict[str, Any]

    @property
    def outcome(self) -> str | None:
        return self.body.get("outcome")


@dataclass(frozen=True)
class Done:
    """A command that has ended."""

    code: int
    out: str
    err: str

    @property
    def told(self) -> Any:
        return json.loads(self.out)


@dataclass(frozen=True)
class Victim:
    """A process of the house, held by its pidfd so that a signal can't reach a stranger."""

    pid: int
    pidfd: int

    def hit(self, number: int) -> None:
        signal.pidfd_send_signal(self.pidfd, number)

    @property
    def gone(self) -> bool:
        return bool(select.select([self.pidfd], [], [], 0)[0])


def _lives(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def transaction(description: str, amount: int = 1) -> dict[str, Any]:
    """The body of a transaction that moves `amount` won of salary to the bank."""
    postings = [
        {"account": BANK, "amount": str(amount), "currency": "KRW"},
        {"account": SALARY, "amount": str(-amount), "currency": "KRW"},
    ]
    return {"date": "2026-11-21", "description": description, "postings": postings}


@dataclass
class Premises:
    """The folders and the processes of a house: made, started, looked for, taken away."""

    data: Path
    policy: Mapping[str, Any] = field(default_factory=dict)
    launcher: "subprocess.Popen[bytes] | None" = None
    url: str = ""
    _pidfds: list[int] = field(default_factory=list)
    _ups: int = 0
    _runs: set[Path] = field(default_factory=set)
    _read: tuple[Any, list[dict[str, Any]]] = (None, [])

    @property
    def folders(self) -> Folders:
        return locate(self.data)

    @property
    def said(self) -> str:
        """What the last `up` has printed."""
        return self._paper.read_text("utf-8")

    @property
    def _paper(self) -> Path:
        return self.data.parent / f"{self.data.name}.up-{self._ups}.txt"

    def settle_policy(self, **changes: object) -> Path:
        """Write the policy of this house to a file beside its data."""
        path = self.data.parent / f"{self.data.name}.policy.json"
        path.write_text(json.dumps({**POLICY, **self.policy, **changes}), "utf-8")
        return path

    def begin(self, *options: str) -> "subprocess.Popen[bytes]":
        """Start `hardcore up` as a person would, in a session of its own, and wait for nothing."""
        argv = [sys.executable, "-m", "hardcore.cli", "--data", str(self.data), "up", "--port", "0", *options]
        return self.begin_as(argv)

    def begin_as(self, argv: Sequence[str]) -> "subprocess.Popen[bytes]":
        """Start it by a command of the test's own."""
        if self.launcher is not None:
            self.launcher.wait(START_S)  # the one before is gone, or nothing new may be started
        if "--store" not in argv:
            stores.prepare(self.data)
        self._ups += 1
        self._runs.add(self.folders.run)
        with self._paper.open("wb") as paper:
            self.launcher = subprocess.Popen(
                argv,
                env=self.environment(),
                stdin=subprocess.DEVNULL,
                stdout=paper,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        return self.launcher

    def environment(self, **more: str) -> dict[str, str]:
        """What a command of this house finds around it."""
        kept = {name: os.environ[name] for name in ("PATH", "HOME", "TMPDIR") if name in os.environ}
        return {**kept, "LANG": "C.UTF-8", "PYTHONPATH": str(Path(__file__).parents[2]), **more}

    def end(self) -> None:
        """Kill everything of this house, the parent first, until nothing is left; remove its run folders."""
        sweeps = 0
        while found := self.processes():
            sweeps += 1
            assert sweeps < SWEEPS_MAX, f"can't be ended: {found}"
            for pid in sorted(found, key=lambda pid: "launcher.py" not in found[pid]):
                self._end(pid)
            if self.launcher is not None:
                with contextlib.suppress(subprocess.TimeoutExpired):
                    self.launcher.wait(0.1)
        if self.launcher is not None:
            self.launcher.wait(5)
        for fd in self._pidfds:
            os.close(fd)
        self._pidfds.clear()
        for run in {*self._runs, self.folders.run}:
            shutil.rmtree(run, ignore_errors=True)
            assert not run.exists(), f"{run} is left"

    def incidents(self) -> list[dict[str, Any]]:
        """The incidents so far, newest first, as `hardcore incidents --json` lists them.

        Read anew only when a file of theirs has changed: a test that waits asks a hundred times a second.
        """
        marks = _marks(self.folders.incidents)
        if marks != self._read[0]:
            self._read = marks, incidents_cli.list_incidents(self.folders.incidents)
        return self._read[1]

    def processes(self) -> dict[int, str]:
        """Every living process that names this house's folders: pid to command line."""
        marks = [os.fsencode(path) for path in (self.data, self.folders.run, *self._runs)]
        found = {}
        for entry in Path("/proc").iterdir():
            if entry.name.isdigit() and int(entry.name) != os.getpid() and _names(entry, marks):
                found[int(entry.name)] = _command_line(entry)
        return found

    def _end(self, pid: int) -> None:
        with contextlib.suppress(OSError):
            pidfd = os.pidfd_open(pid)
            try:
                if pid in self.processes():  # asked again, now that the descriptor pins who it is
                    signal.pidfd_send_signal(pidfd, signal.SIGKILL)
                    select.select([pidfd], [], [], 2)
            finally:
                os.close(pidfd)


@dataclass
class Doors(Premises):
    """What people and kernels may do to it: the control socket, the command line, signals."""

    def up(self, *options: str) -> Self:
        """Start it and wait until it runs."""
        self.up_unproven(*options)
        self.running()
        return self

    def up_unproven(self, *options: str) -> Self:
        """Start it and wait until a core serves, which need not have outlived its probation."""
        if "--policy" not in options and not self.folders.policy.exists():
            options = (*options, "--policy", str(self.settle_policy()))
        launcher = self.begin(*options)
        until(lambda: "http://" in self.said or launcher.poll() is not None, "`up` to say something", START_S)
        assert launcher.poll() is None, f"`up` ended with {launcher.returncode}: {self.said}"
        self.url = self.until(lambda s: s["core"]["ready"] and s["gateway"]["pid"], "a core to serve")["url"]
        return self

    def status(self) -> dict[str, Any]:
        """What the sentinel says at its door; empty if nobody answers."""
        try:
            return client.ask(self.folders.control, {"verb": "status"})
        except client.Unreachable:
            return {}

    def order(self, verb: str, **particulars: object) -> dict[str, Any]:
        """What the sentinel answers to an order."""
        return client.ask(self.folders.control, {"verb": verb, **particulars})

    def until(self, holds: Callable[[dict[str, Any]], object], what: str) -> dict[str, Any]:
        """Wait until the status says so; return it."""

        def look() -> dict[str, Any] | None:
            status = self.status()
            return status if status and holds(status) else None

        try:
            found = until(look, what, START_S)
        except AssertionError as error:
            raise AssertionError(f"{error}; it is {self.status()}; {self.incidents()[:1]}") from error
        assert found is not None, "`until` gives back what is true"
        return found

    def running(self) -> dict[str, Any]:
        """Wait until a core serves, has proven itself, and no incident is open."""

        def settled(status: dict[str, Any]) -> bool:
            at_rest = status["phase"] == "RUNNING" and status["incident"] is None
            # A core that was killed this moment may still be the one that the guard tells of.
            return at_rest and status["gateway"]["pid"] is not None and _lives(status["core"]["pid"])

        status = self.until(settled, "the house to run")
        self.url = status["url"]
        return status

    def spared(self) -> dict[str, Any]:
        """Wait until a proven core serves, no incident is open, and a spare waits; return the status."""

        def settled(status: dict[str, Any]) -> bool:
            spare = status["spare"]
            return (
                status["phase"] == "RUNNING" and status["incident"] is None and bool(spare and spare["ready"])
            )

        return self.until(settled, "a spare")

    def hold(self, who: str) -> Victim:
        """Hold one of the processes by what the status calls it."""
        return self.hold_pid(self.until(lambda s: s[who]["pid"], f"a {who}")[who]["pid"])

    def hold_pid(self, pid: int) -> Victim:
        """Hold a process by its number. It is given back when the house ends."""
        victim = Victim(pid, os.pidfd_open(pid))
        self._pidfds.append(victim.pidfd)
        return victim

    def hit(self, who: str, number: int = signal.SIGKILL) -> Victim:
        """Send a signal to one of the processes."""
        victim = self.hold(who)
        victim.hit(number)
        return victim

    def cli(self, *words: str, env: Mapping[str, str] | None = None) -> Done:
        """Run `hardcore` with this house's data folder to its end."""
        return run_cli("--data", str(self.data), *words, env=self.environment(**(env or {})))


@dataclass
class House(Doors):
    """See the module: with the ledger's customers and the incidents' readers."""

    def ask(
        self,
        method: str,
        path: str,
        body: object = None,
        *,
        key: str | None = None,
        timeout_s: float = ANSWER_S,
    ) -> Answer:
        """Ask over HTTP, once. Raises OSError or HTTPException as they come."""
        raw = body if isinstance(body, bytes) else json.dumps(body).encode() if body is not None else None
        headers = {"Content-Type": "application/json"} if raw is not None else {}
        if key is not None:
            headers["Idempotency-Key"] = key
        connection = http.client.HTTPConnection(self.url.removeprefix("http://"), timeout=timeout_s)
        try:
            connection.request(method, path, raw, headers)
            answer = connection.getresponse()
            text = answer.read()
        finally:
            connection.close()
        told = json.loads(text) if "json" in answer.headers.get("Content-Type", "") else {}
        headers = {name.lower(): value for name, value in answer.headers.items()}
        return Answer(answer.status, headers, told)

    def open_accounts(self) -> None:
        """Open the two accounts that `transaction` names; a second time changes nothing."""
        for account, kind in ((BANK, "asset"), (SALARY, "income")):
            body = {"id": account, "name": account, "type": kind, "currency": "KRW"}
            answer = self.ask("POST", "/api/ledger/accounts", body, key=f"open-{account}")
            assert answer.status == 201, answer

    def book(self, key: str, **more: Any) -> Answer:
        """Book one won under a key; the description is the key too."""
        return self.ask("POST", "/api/ledger/transactions", transaction(key), key=key, **more)

    def booked(self) -> list[str]:
        """The descriptions of all transactions in the ledger."""
        found: list[str] = []
        cursor = ""
        while True:
            page = self.ask("GET", f"/api/ledger/transactions?limit=500{cursor}")
            assert page.status == 200, page
            found += [item["description"] for item in page.body["items"]]
            if page.body["next_cursor"] is None:
                return found
            cursor = f"&cursor={page.body['next_cursor']}"

    def closed(self, count: int) -> dict[str, Any]:
        """Wait until `count` incidents are closed and the newest has its report; return its story."""

        def look() -> dict[str, Any] | None:
            items = self.incidents()
            if len(items) < count or any(item["closed_at"] is None for item in items):
                return None
            folder = self.folders.incidents / items[0]["id"]
            told = bundle.read_manifest(folder)
            if isinstance(told, bundle.BundleFailed) or "report.md" not in told.files:
                return None
            story = incidents_cli.show_incident(self.folders.incidents, items[0]["id"])
            return story if isinstance(story, dict) else None

        try:
            story = until(look, f"{count} closed incidents", START_S)
        except AssertionError as error:
            raise AssertionError(f"{error}; there are {self.incidents()}") from error
        assert story is not None, "as above"
        listed = [(one["diagnosis"], one["opened_at"], one["summary"]) for one in self.incidents()]
        assert len(listed) == count, listed
        return story


def _marks(incidents: Path) -> set[tuple[str, int, int, int]]:
    """What tells that a file below this folder is another one, or has changed."""
    marks = set()
    for folder, _, names in os.walk(incidents):
        for name in names:
            with contextlib.suppress(FileNotFoundError):
                seen = os.stat(f"{folder}/{name}")  # noqa: PTH116  # a path for each would cost more than the look
                marks.add((f"{folder}/{name}", seen.st_ino, seen.st_size, seen.st_mtime_ns))
    return marks


def bytes_of(path: Path) -> bytes:
    """What stands in a file; a draft may have been given its name meanwhile, and is found under that."""
    try:
        return path.read_bytes()
    except FileNotFoundError:
        return b""


def whole(house: House, count: int) -> dict[str, Any]:
    """Wait until `count` incidents are closed and the newest one's box is whole, its report included; its story."""
    incident = house.closed(count)["id"]
    folder = house.folders.incidents / incident
    until(lambda: not bundle.verify_bundle(folder), "the report to be in the box", START_S)
    story = incidents_cli.show_incident(house.folders.incidents, incident)
    assert isinstance(story, dict), story
    return story


def run_cli(*words: str, env: Mapping[str, str], cwd: Path | None = None) -> Done:
    """Run `hardcore` to its end; it must never show a traceback."""
    argv: Sequence[str] = [sys.executable, "-m", "hardcore.cli", *words]
    done = subprocess.run(
        argv,
        env=dict(env),
        cwd=cwd,
        capture_output=True,
        stdin=subprocess.DEVNULL,
        timeout=COMMAND_S,
        check=False,
    )
    out, err = done.stdout.decode(), done.stderr.decode()
    assert "Traceback" not in out + err, out + err
    return Done(done.returncode, out, err)


def _names(entry: Path, marks: Sequence[bytes]) -> bool:
    try:
        words = (entry / "cmdline").read_bytes() + b"\0" + (entry / "environ").read_bytes()
        state = (entry / "stat").read_text("utf-8", "replace").rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state not in {"Z", "X"} and any(mark in words for mark in marks)


def _command_line(entry: Path) -> str:
    try:
        return (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode("utf-8", "replace")
    except OSError:
        return ""
