"""The investigator's process: takes in what the guard leaves, and answers the dashboard and the command line.

HTTP on a Unix socket that only this machine's owner can open (`docs/wires.md` section 16). One at a time, by a lock: a
second one waits until the first listens and leaves. It ends by itself when nobody has asked for a while and nothing is
under way, so a household's machine does not keep it for one look a month. Whatever happens here, the guard and the
ledger go on: they never ask, and what they have to say waits in files.
"""

import asyncio
import contextlib
import fcntl
import importlib.metadata
import logging
import os
import secrets
import signal
import socket
import stat
import sys
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import msgspec
import uvicorn
from sqlalchemy.exc import SQLAlchemyError
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response

from postmortem import api, as_told
from postmortem.acts import Desk, do_one
from postmortem.bulks import PACE_S, Lane
from postmortem.courts import Court, Limits
from postmortem.deciding import Decider
from postmortem.diary import Diary
from postmortem.gate import Gate
from postmortem.guard_line import GuardLine
from postmortem.incident_acts import IncidentDesk
from postmortem.intake import Intake
from postmortem.records import log
from postmortem.records.opening import Records, RecordsFailed, open_records
from postmortem.records.reads import Archive
from postmortem.retrying import Retrier
from postmortem.views import Letter, Refusal
from postmortem.web.app import routes as page_routes
from postmortem.web.places import Places

#: How often the two folders are looked at, what a death left undone is seen to, and old rows are forgotten.
LOOK_S: Final = 0.25
MEND_S: Final = 2.0
FORGET_S: Final = 3_600.0
#: A second one waits so long for the first to listen.
FIRST_S: Final = 15.0
#: Requests at one time; beyond, the next ones wait in the socket's line.
BACKLOG: Final = 64
#: A connection that says nothing is kept so long.
SILENT_S: Final = 30
ENDING_S: Final = 5

LISTENING: Final = 0
FAILED: Final = 1

_LOG: Final = logging.getLogger("postmortem")


class Wishes(msgspec.Struct, frozen=True):
    """How the investigator is started."""

    data: Path
    socket: Path
    control: Path
    idle_s: float = 600.0
    pace_s: float = PACE_S
    limits: Limits = msgspec.field(default_factory=Limits)


def serve(wishes: Wishes) -> int:
    """Serve until it is told to end or nobody asks any more; return the exit code, after a sentence where it is not 0."""
    # The server gives a TERM back once it has ended; then everything below lets go of what it holds.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(LISTENING))
    logging.basicConfig(level=logging.INFO, stream=sys.stderr, format="%(asctime)s %(name)s %(message)s")
    state = wishes.data / "state"
    try:
        state.mkdir(mode=0o700, parents=True, exist_ok=True)
        with _alone(state / "investigator.lock") as first:
            if not first:
                return LISTENING if _heard(wishes.socket) else _fail("another investigator does not answer")
            return _serve_alone(wishes)
    except OSError as error:
        return _fail(f"the investigator could not be started: {error.strerror}")


def _serve_alone(wishes: Wishes) -> int:
    records = open_records(wishes.data / "hardcore.db")
    if isinstance(records, RecordsFailed):
        return _fail(records.reason)
    try:
        listener = _listen(wishes.socket)
        try:
            asyncio.run(Investigator(wishes, records).run(listener))
        finally:
            listener.close()
            wishes.socket.unlink(missing_ok=True)
    finally:
        records.close()
    return LISTENING


class Investigator:
    """The parts of one investigator, and what it does besides answering."""

    def __init__(self, wishes: Wishes, records: Records) -> None:
        self._wishes = wishes
        self._records = records
        guard, state = GuardLine(wishes.control), wishes.data / "state"
        self._intake = Intake(
            records, wishes.data / "spool", wishes.data / "incidents", state / "quarantine.json"
        )
        archive = Archive(records, wishes.data / "state" / "rule_hits.json")
        self._diary = Diary(records)
        self._retrier = Retrier(records, guard, Court(wishes.data, wishes.limits))
        self._decider = Decider(records, archive, guard, self._diary)
        self._lane = Lane(records, guard, self._do, wishes.pace_s)
        of_incidents = IncidentDesk(records, archive, self._diary, wishes.data / "incidents")
        self._desk = Desk(
            records, archive, self._retrier, self._decider, self._lane, self._diary, of_incidents
        )
        with records.writing() as connection:
            token = log.secret(connection, secrets.token_urlsafe(32))
        places = Places(
            incidents=wishes.data / "incidents",
            data=wishes.data,
            token=token,
            ask_guard=guard.ask,
            write_down=self._write_down,
            version=importlib.metadata.version("fieldstack-hardcore"),
        )
        table = [
            *page_routes(archive, self._desk, places),
            *api.routes(api.Api(archive, self._desk, places, guard)),
        ]
        app = Starlette(routes=table, exception_handlers={HTTPException: _not_so, Exception: _our_fault})
        self._gate = Gate(app, token)

    async def run(self, listener: socket.socket) -> None:
        """Take in what waits, then answer until it is time to end."""
        if self._records.put_aside is not None:
            name = self._records.put_aside.name
            _LOG.error("the archive was damaged; it is kept as %s and a new one is begun", name)
            self._diary.write("damaged", name, "", "a new archive was begun")
        await asyncio.to_thread(self._intake.begin)
        config = uvicorn.Config(
            self._gate,
            log_config=None,
            access_log=False,
            lifespan="off",
            ws="none",
            backlog=BACKLOG,
            timeout_keep_alive=SILENT_S,
            timeout_graceful_shutdown=ENDING_S,
            server_header=False,
        )
        server = uvicorn.Server(config)
        besides = [
            asyncio.create_task(one)
            for one in (
                self._look(),
                self._mend(),
                self._forget(),
                self._lane.run(),
                self._end_idle(server),
            )
        ]
        for one in besides:
            one.add_done_callback(lambda ended: _end_all(ended, server))
        try:
            await server.serve(sockets=[listener])
        finally:
            for one in besides:
                one.cancel()
            await asyncio.gather(*besides, return_exceptions=True)

    async def _look(self) -> None:
        while True:
            try:
                await asyncio.to_thread(self._intake.look)
            except SQLAlchemyError as error:
                # A full disk or a lock: what waits goes on waiting in its files.
                _LOG.warning("nothing was taken in: %s", error)
                await asyncio.sleep(MEND_S)
            await asyncio.sleep(LOOK_S)

    async def _mend(self) -> None:
        while True:
            try:
                await self._retrier.mend()
                await self._decider.mend()
            except SQLAlchemyError as error:
                _LOG.warning("nothing was mended: %s", error)
            await asyncio.sleep(MEND_S)

    async def _forget(self) -> None:
        while True:
            try:
                with self._records.writing() as connection:
                    gone = log.forget_old(connection, datetime.now(UTC))
            except SQLAlchemyError as error:
                gone = 0
                _LOG.warning("nothing was forgotten: %s", error)
            await asyncio.sleep(LOOK_S if gone else FORGET_S)

    async def _end_idle(self, server: uvicorn.Server) -> None:
        while True:
            await asyncio.sleep(min(1.0, self._wishes.idle_s / 4))
            if self._is_idle():
                break
        _LOG.info("nobody has asked for %g s", self._wishes.idle_s)
        server.should_exit = True

    def _is_idle(self) -> bool:
        silent_s = (time.monotonic_ns() - self._gate.asked_ns) / 1e9
        at_work = self._gate.open or self._lane.busy or self._retrier.in_hand
        return silent_s > self._wishes.idle_s and not at_work

    async def _do(self, verb: str, letter_id: str, reason: str) -> Letter | Refusal:
        return await do_one(self._desk, verb, letter_id, reason)

    async def _write_down(self, verb: str, what: str, reason: str, outcome: str) -> None:
        self._diary.write(verb, what, reason, outcome)


def _end_all(ended: "asyncio.Task[None]", server: uvicorn.Server) -> None:
    """A part that ended by a fault of ours takes the process with it: half an investigator would look like a whole one."""
    if not ended.cancelled() and (fault := ended.exception()) is not None:
        _LOG.error("the investigator ends by a fault of its own", exc_info=fault)
        server.should_exit = True


async def _not_so(request: Request, fault: Exception) -> Response:
    """Answer what no address or no body fits; a page that asks wants to read it all the same."""
    assert isinstance(fault, HTTPException)
    code = "not_found" if fault.status_code == 404 else "not_readable"
    return _problem(request, Refusal(code, {}), fault.status_code)


async def _our_fault(request: Request, fault: Exception) -> Response:
    _LOG.error("%s %s", request.method, request.url.path, exc_info=fault)
    return _problem(request, Refusal("our_fault", {}), 500)


def _problem(request: Request, refused: Refusal, status: int) -> Response:
    lang = "ko" if request.headers.get("accept-language", "").lower().startswith("ko") else "en"
    _, told = as_told.refusal(refused, lang)
    return api.as_json({**told, "status": status}, status, "application/problem+json")


@contextlib.contextmanager
def _alone(path: Path) -> Iterator[bool]:
    """Hold the lock of the one investigator; False: somebody else has it."""
    handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            yield False
        else:
            yield True
    finally:
        os.close(handle)


def _heard(path: Path) -> bool:
    """Tell whether the first one listens within its time."""
    deadline_ns = time.monotonic_ns() + int(FIRST_S * 1e9)
    while time.monotonic_ns() < deadline_ns:
        with socket.socket(socket.AF_UNIX) as probe:
            try:
                probe.connect(str(path))
            except OSError:
                time.sleep(0.05)
            else:
                return True
    return False


def _listen(path: Path) -> socket.socket:
    """Bind the socket, for its owner only from the first moment. Raises OSError."""
    with contextlib.suppress(FileNotFoundError):
        if stat.S_ISSOCK(path.lstat().st_mode):
            path.unlink()  # of one that died: we hold the lock
    listener = socket.socket(socket.AF_UNIX)
    before = os.umask(0o177)
    try:
        listener.bind(str(path))
    except OSError:
        listener.close()
        raise
    finally:
        os.umask(before)
    listener.listen(BACKLOG)
    return listener


def _fail(sentence: str) -> int:
    sys.stderr.write(f"{sentence}\n")
    return FAILED
