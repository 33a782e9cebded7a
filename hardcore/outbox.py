"""The guard's side of an alert: a file in a folder, and a process that brings it to people.

Nothing of the guard waits for any of it. Putting a file is done on a hand's thread and told in the log when it fails;
the sender is started when something waits, has a time limit of its own, and what it does wrong ends with it. What came
of it is read from the sender's book and told to the gateway, which shows it to whoever waits. Sending from a thread of
the guard was not chosen: a name that can't be looked up holds a thread for as long as it likes.
"""

import asyncio
import datetime as dt
import json
import os
import shutil
import sys
from collections.abc import Callable, Coroutine, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, Protocol

from hardcore.host import clock, files, lives, logs, processes
from hardcore.host.folders import Folders
from hardcore.host.ids import new_id
from hardcore.host.processes import Handle
from hardcore.model.actions import Alert, AlertStage
from hardcore.snapshot.masking import mask_line

VERSION: Final = 1
WAITING_MAX: Final = 256
#: One alert is given to so many senders: it may be what ends them.
RUNS_MAX: Final = 5
#: Before another sender is started for the same alert: the one of an earlier guard may still be at it.
AGAIN_S: Final = 2.0
#: After that many, and while all that waits is put off: the next is started no later than then.
LATER_S: Final = 900.0
BLANK_BYTES_MAX: Final = 64
LATER_LOOK_S: Final = 5.0
#: A sender ends by itself long before.
SENDER_S: Final = 1260.0
LOOK_S: Final = 0.25
#: When the guard ends, so long for what is just being sent.
LEAVE_S: Final = 3.0
TEST_S: Final = 25.0
ANSWER_BYTES_MAX: Final = 64 << 10
BOOK_BYTES_MAX: Final = 4 << 20
INCIDENTS_MAX: Final = 16
NICE: Final = "10"


class Hands(Protocol):
    """What is needed of the executor around it."""

    async def in_hand(self, work: Callable[..., Any], *args: Any) -> Any:
        """Run blocking work on a hand's thread."""

    def note(self, kind: str, **particulars: object) -> None:
        """Write a line to the guard's log."""

    def begin(self, work: Coroutine[Any, Any, object]) -> None:
        """Start a piece of work that nobody waits for."""


class Outbox:
    """Owns the folder and the sender. `publish` takes lines for the gateway."""

    def __init__(
        self, folders: Folders, hands: Hands, publish: Callable[[Mapping[str, object]], None]
    ) -> None:
        self.url = ""  # where the ledger is served, for the link in a message
        self._folders = folders
        self._hands = hands
        self._publish = publish
        self._awaited: dict[str, str] = {}  # of an incident: what was told to the gateway last
        self._lines: dict[str, dict[str, object]] = {}
        self._runs: dict[str, int] = {}
        self._sender: Handle | None = None
        self._more = False
        self._stirred = asyncio.Event()
        self._wanted = True
        self._idle = asyncio.Event()  # no sender is kept
        self._idle.set()

    @property
    def lines(self) -> tuple[dict[str, object], ...]:
        """What a gateway that begins to listen has to know: whether somebody was told of the last incident."""
        return tuple(self._lines.values())[-1:]

    async def put(self, alert: Alert) -> None:
        """Have it told. Returns as soon as it lies in the outbox, or can't."""
        incident, name, told = (
            alert.incident,
            new_id(),
            self._told(alert),
        )  # named here: in the order of the orders
        if not await self._hands.in_hand(self._has_channels):
            self._tell(incident, None)
            return
        try:
            await self._hands.in_hand(self._write, name, told)
        except OSError as error:
            self._hands.note("alert", diagnosis=alert.diagnosis, failed=error.strerror or str(error))
            self._tell(incident, None)
            return
        if incident is not None and alert.stage is not AlertStage.CLOSED:
            self._awaited.setdefault(incident, "")
            self._bound(self._awaited)
        self._wake()

    async def resume(self, url: str) -> None:
        """Go on with what an earlier guard has left in the outbox. `url`: where the ledger is served from now on."""
        self.url = url
        if await self._hands.in_hand(self._waiting):
            self._wake()

    async def stop(self) -> None:
        """Let the sender finish what it is at, but not for long; what is left waits for the next guard."""
        self._wanted = False
        self._stirred.set()
        with suppress(TimeoutError):
            await asyncio.wait_for(self._idle.wait(), LEAVE_S)
        if self._sender is not None:
            self._sender.kill_tree()

    async def test(self, channel: int | None = None) -> dict[str, object]:
        """Have a test sent to each channel, or to one; return the answer of the door."""
        read, write = os.pipe()
        try:
            argv = [
                "--test",
                "--url",
                self.url,
                *(["--channel", str(channel)] if channel is not None else []),
            ]
            try:
                handle = await self._hands.in_hand(self._spawn, argv, write)
            except OSError as error:
                return {"ok": False, "code": "no-sender", "error": error.strerror or str(error)}
            finally:
                os.close(write)
            await self._ended(handle, TEST_S)
            return _results(_read(read))
        finally:
            os.close(read)

    # ---- the folder ----

    def _told(self, alert: Alert) -> dict[str, object]:
        return {
            "version": VERSION,
            "at": clock.wall(clock.now_ns()),
            "stage": str(alert.stage),
            "diagnosis": str(alert.diagnosis),
            "incident": alert.incident,
            "fingerprint": str(alert.diagnosis),  # the incident's own is known long after somebody was told
            "text": mask_line(alert.text),
            "outcome": alert.outcome,
            "outage_ms": alert.outage_ms,
            "url": self.url,
            "lang": ["ko", "en"],
        }

    def _has_channels(self) -> bool:
        """Whether the policy in force names anybody. Whether it is right was judged by whoever reads it."""
        places = (self._folders.good_policy, self._folders.policy)
        for path in places:
            if found := files.read_json(path):
                return bool(found.get("alerts"))
        # Of one that can't be read now the sender will see; a short one that says nothing names nobody.
        return any(os.path.lexists(path) and not _is_blank(path) for path in places)

    @property
    def _places(self) -> tuple[Path, Path]:
        """Where alerts lie; the second is memory, for when the disk is what has to be told of."""
        return self._folders.outbox, self._folders.run / "alerts"

    def _write(self, name: str, told: Mapping[str, object]) -> None:
        self._make_room(str(told["fingerprint"]))
        durable, passing = self._places
        try:
            durable.mkdir(mode=0o700, parents=True, exist_ok=True)
            files.write_json(durable / f"{name}.json", told)
        except OSError:
            passing.mkdir(mode=0o700, exist_ok=True)
            files.write_json(passing / f"{name}.json", told, durable=False)

    def _make_room(self, fingerprint: str) -> None:
        """Keep the folder bounded: the oldest of the same kind goes, else the oldest of all."""
        waiting = self._waiting()
        if len(waiting) < WAITING_MAX:
            return
        same = [path for path in waiting if files.read_json(path).get("fingerprint") == fingerprint]
        with suppress(OSError):  # a disk that takes no write takes no further file either
            (same or waiting)[0].unlink(missing_ok=True)

    def _waiting(self) -> list[Path]:
        found: list[Path] = []
        for folder in self._places:
            with suppress(OSError), os.scandir(folder) as there:  # there is none yet
                found += [Path(one.path) for one in there if one.is_file(follow_symlinks=False)]
        found = [path for path in found if path.suffix == ".json" and path.name[0] != "."]
        return sorted(found, key=lambda path: path.name)

    # ---- the sender ----

    def _wake(self) -> None:
        self._more = True
        self._stirred.set()
        if self._idle.is_set() and self._wanted:
            self._idle.clear()
            self._hands.begin(self._keep())

    async def _keep(self) -> None:
        """Have what waits sent, by one sender after the other."""
        try:
            while self._wanted and (self._more or await self._left()):
                self._more = False
                await self._run_one()
        finally:
            self._idle.set()

    async def _left(self) -> bool:
        """Whether something waits that another sender may be given, after a pause."""
        waiting, due_s = await self._hands.in_hand(self._put_off)
        if not waiting:
            return self._more
        soon = any(self._runs.get(name, 0) < RUNS_MAX for name in waiting if due_s.get(name, 0.0) <= 0)
        await self._pause(AGAIN_S if soon else min((LATER_S, *(one for one in due_s.values() if one > 0))))
        return True

    async def _pause(self, for_s: float) -> None:
        loop = asyncio.get_running_loop()
        until_s = loop.time() + for_s
        every_s = LOOK_S if for_s <= AGAIN_S else LATER_LOOK_S
        while not self._is_stirred() and (left_s := until_s - loop.time()) > 0:
            await self._look()
            self._stirred.clear()
            if self._is_stirred():
                return  # while it looked
            with suppress(TimeoutError):
                await asyncio.wait_for(self._stirred.wait(), min(every_s, left_s))

    def _is_stirred(self) -> bool:
        return self._more or not self._wanted

    def _put_off(self) -> tuple[set[str], dict[str, float]]:
        """Return what waits, and in how many seconds a sender wants to be asked again about what of it."""
        waiting, now = {path.name for path in self._waiting()}, dt.datetime.now(dt.UTC)
        due_s = {}
        for one in _listed(self._book().get("last")):
            with suppress(ValueError, TypeError, OverflowError):  # there is no such time
                due = dt.datetime.fromisoformat(str(one.get("again_at")))
                due_s[f"{one.get('id')}.json"] = (due - now).total_seconds()
        return waiting, {name: due_s[name] for name in waiting if name in due_s}

    async def _run_one(self) -> None:
        waiting, due_s = await self._hands.in_hand(self._put_off)
        # What a sender has put off did not end it.
        self._runs = {name: self._runs.get(name, 0) + 1 for name in waiting if due_s.get(name, 0.0) <= 0}
        if not waiting or not self._wanted:
            return  # the guard may have been told to leave during the pause before this one
        try:
            self._sender = await self._hands.in_hand(self._spawn, [])
        except OSError as error:
            self._hands.note("alert", failed=f"the sender could not be started: {error.strerror}")
            return
        await self._ended(self._sender, SENDER_S)
        self._sender = None

    async def _ended(self, handle: Handle, within_s: float) -> None:
        """Wait for a sender's end; end it when its time is over."""
        loop = asyncio.get_running_loop()
        give_up_at = loop.time() + within_s
        try:
            while not await processes.gone(handle, LOOK_S):
                await self._look()
                if loop.time() > give_up_at:
                    self._hands.note("alert", failed="the sender did not end by itself")
                    break
            await self._look()
        finally:
            handle.kill_tree()
            await processes.gone(handle, lives.KILL_S)
            handle.reap()
            handle.close()

    def _spawn(self, more: list[str], stdout: int | None = None) -> Handle:
        folders = self._folders
        argv = [sys.executable, "-I", "-m", "hardcore.alerting", "--data", str(folders.data), *more]
        log = logs.place(folders.logs / "alerts.log", folders.run)
        nice = ["nice", "-n", NICE] if shutil.which("nice") else []
        return processes.spawn([*nice, *argv], lives.clean_environment(), log, folders.data, stdout=stdout)

    # ---- what came of it ----

    async def _look(self) -> None:
        """Tell the gateway what has become of the incidents that it may be asked about."""
        if not self._awaited:
            return
        told, untold = await self._hands.in_hand(self._read_book)
        for incident in list(self._awaited):
            if incident in told:
                self._tell(incident, str(told[incident]))
                self._awaited.pop(incident, None)
            elif incident in untold and not self._awaited[incident]:
                self._awaited[incident] = "failed"
                self._tell(incident, None)

    def _read_book(self) -> tuple[Mapping[str, object], Mapping[str, object]]:
        book = self._book()
        return _mapping(book.get("told")), _mapping(book.get("untold"))

    def _book(self) -> Mapping[str, object]:
        paths = (self._folders.alerts, self._folders.run / "alerts.json")
        return max((files.read_json(path, BOOK_BYTES_MAX) for path in paths), key=_serial)

    def _tell(self, incident: str | None, at: str | None) -> None:
        if incident is None:
            return
        line: dict[str, object] = {"type": "alerted", "incident": incident, "at": at, "failed": at is None}
        self._lines.pop(incident, None)
        self._lines[incident] = line
        self._bound(self._lines)
        self._publish(line)

    @staticmethod
    def _bound(kept: dict[str, Any]) -> None:
        while len(kept) > INCIDENTS_MAX:
            kept.pop(next(iter(kept)))


def _serial(book: Mapping[str, object]) -> int:
    number = book.get("serial")
    return number if isinstance(number, int) else 0


def _is_blank(path: Path) -> bool:
    """Whether this is the policy that says nothing."""
    try:
        return (
            path.is_file() and path.stat().st_size <= BLANK_BYTES_MAX and json.loads(path.read_bytes()) == {}
        )
    except (OSError, ValueError):
        return False


def _listed(value: object) -> list[Mapping[str, object]]:
    return [one for one in value if isinstance(one, dict)] if isinstance(value, list) else []


def _mapping(value: object) -> Mapping[str, object]:
    return value if isinstance(value, dict) else {}


def _read(fd: int) -> bytes:
    """Return what a process that has ended left in its pipe."""
    os.set_blocking(fd, False)  # whoever inherited the other end might hold it open
    try:
        return os.read(fd, ANSWER_BYTES_MAX)
    except BlockingIOError:
        return b""


def _results(printed: bytes) -> dict[str, object]:
    try:
        results = json.loads(printed)
    except ValueError:
        return {"ok": False, "code": "no-sender", "error": "the sender gave no answer (logs/alerts.log)"}
    return {"ok": True, "results": results}
