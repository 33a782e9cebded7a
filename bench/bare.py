"""The bare start: the same application on the same kind of book, started by uvicorn alone, without a guard.

It is the yardstick of a cold start: nobody who starts this application, with whatever supervisor, can be
faster than this. `python -m uvicorn --factory bench.bare:app`; the data folder stands in HARDCORE_DATA.
"""

import asyncio
import http.client
import os
import socket
import subprocess
import sys
import time
from pathlib import Path

from starlette.types import ASGIApp

from core.departure import Departure
from core.guarded.beacon import Beacon
from core.guarded.recorder import NoRecorder
from core.imports.desk import Desk
from core.journal.store import LEDGER_FILE, open_reading
from core.journal.writer import Writer
from core.opening import Telling, Terms, open_book
from core.service import Service
from core.settings import Settings
from core.web.app import make_app

ANSWER_S = 30.0


def app() -> ASGIApp:
    """Open the book as the core does and return the application in front of it."""
    data, settings, recorder = Path(os.environ["HARDCORE_DATA"]), Settings(), NoRecorder()
    book = open_book(data, Terms(None, (), None, shared=False), settings, Telling(recorder, Beacon(None)))
    assert not isinstance(book, Departure), book
    loop = asyncio.get_running_loop()
    writer = Writer(
        book.journal, recorder, loop, on_failed=print, on_fenced=print, on_bug=print, on_shut=print
    )
    writer.start()
    readers = open_reading(data / LEDGER_FILE, settings.readers + 1, settings.write_busy_ms)
    service = Service(writer, readers, recorder, settings, book.epoch)
    return make_app(service, Desk(service, recorder, data))


def bare_start_ms(data: Path, folder: Path, question: str) -> float:
    """Return the milliseconds from the start of a bare uvicorn to its first good answer, then end it."""
    path = folder / "bare.sock"
    listener = socket.socket(socket.AF_UNIX)
    listener.bind(str(path))
    listener.listen()
    fd = listener.fileno()
    argv = [
        sys.executable,
        "-m",
        "uvicorn",
        "--factory",
        "bench.bare:app",
        "--fd",
        str(fd),
        "--loop",
        "uvloop",
    ]
    argv += [
        "--http",
        "httptools",
        "--ws",
        "none",
        "--lifespan",
        "off",
        "--no-access-log",
        "--log-level",
        "error",
    ]
    environment = {"PATH": os.environ["PATH"], "HARDCORE_DATA": str(data)}
    began_ns = time.monotonic_ns()
    with subprocess.Popen(argv, env=environment, pass_fds=(fd,), start_new_session=True) as server:
        try:
            listener.close()  # ours: who waits must hear when the server's is gone
            assert _asked(path, question) == 200, "the bare start answered something else"
            return (time.monotonic_ns() - began_ns) / 1e6
        finally:
            server.kill()
            path.unlink()


def _asked(path: Path, question: str) -> int:
    """Ask over a Unix socket; wait as long as the start takes."""
    connection = http.client.HTTPConnection("localhost", timeout=ANSWER_S)
    connection.sock = socket.socket(socket.AF_UNIX)
    connection.sock.settimeout(ANSWER_S)
    connection.sock.connect(str(path))
    try:
        connection.request("GET", question)
        response = connection.getresponse()
        response.read()
        return response.status
    finally:
        connection.close()
