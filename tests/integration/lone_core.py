"""A core as a process for tests: started, asked over real HTTP, and gone afterwards."""

import http.client
import json
import os
import resource
import socket
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tests import stores, waiting

ROOT = Path(__file__).parents[2]


@dataclass
class Answer:
    status: int
    headers: dict[str, str]
    body: Any


class UnixConnection(http.client.HTTPConnection):
    def __init__(self, path: Path) -> None:
        super().__init__("core", timeout=waiting.WAIT_S)
        self._path = path

    def connect(self) -> None:
        self.sock = socket.socket(socket.AF_UNIX)
        self.sock.settimeout(self.timeout)
        self.sock.connect(str(self._path))


@dataclass
class Core:
    process: "subprocess.Popen[bytes]"
    log: Path
    socket: Path | None = None
    port: int = 0
    connections: list[http.client.HTTPConnection] = field(default_factory=list)

    def connect(self) -> http.client.HTTPConnection:
        made: http.client.HTTPConnection
        if self.socket is not None:
            made = UnixConnection(self.socket)
        else:
            made = http.client.HTTPConnection("127.0.0.1", self.port, timeout=waiting.WAIT_S)
        self.connections.append(made)
        return made

    def ask(self, method: str, path: str, body: Any = None, **headers: str) -> Answer:
        connection = self.connect()
        data = body if isinstance(body, bytes) or body is None else json.dumps(body).encode()
        named = {name.replace("_", "-"): value for name, value in headers.items()}
        connection.request(method, path, data, {"Content-Type": "application/json", **named})
        response = connection.getresponse()
        raw = response.read()
        connection.close()
        told = {name.lower(): value for name, value in response.getheaders()}
        return Answer(response.status, told, json.loads(raw) if raw else None)

    def raw(self, method: str, path: str, body: bytes | None = None, **headers: str) -> bytes:
        """Ask for anything, and return the bytes of the answer, whatever it is."""
        connection = self.connect()
        connection.request(
            method, path, body, {name.replace("_", "-"): text for name, text in headers.items()}
        )
        try:
            return connection.getresponse().read()
        finally:
            connection.close()

    def open(self, name: str, kind: str = "asset", currency: str = "KRW", *, locked: bool = False) -> Answer:
        body = {"id": name, "name": name, "type": kind, "currency": currency, "no_overdraft": locked}
        return self.ask("POST", "/api/ledger/accounts", body)

    def move(self, amount: int, to: str, source: str, **headers: str) -> Answer:
        return self.ask("POST", "/api/ledger/transactions", moving(amount, to, source), **headers)

    def ends_with(self) -> int:
        return self.process.wait(waiting.WAIT_S)

    def said(self) -> str:
        return self.log.read_text()


def moving(amount: int, to: str, source: str) -> dict[str, Any]:
    lines = [
        {"account": to, "amount": str(amount), "currency": "KRW"},
        {"account": source, "amount": str(-amount), "currency": "KRW"},
    ]
    return {"date": "2026-11-21", "description": "moved", "postings": lines}


@contextmanager
def started(
    data: Path,
    *,
    sock: Path | None = None,
    arguments: Sequence[str] = (),
    before: Sequence[str] = (),
    file_bytes_max: int | None = None,
    **environ: str,
) -> Iterator[Core]:
    """Start a core: on loopback, or on `sock` as under a guard. It is gone afterwards, whatever happens.

    `before` stands before its command line and must become it.
    """
    log = data.parent / f"core-{len(list(data.parent.glob('core-*.log')))}.log"
    named = {"HARDCORE_SOCKET": str(sock)} if sock else {}
    if "CORE_STORE" not in environ:
        stores.prepare(data)

    with log.open("wb") as out:
        process = subprocess.Popen(
            [*before, sys.executable, "-m", "core", "serve", "--data", str(data), "--port", "0", *arguments],
            cwd=ROOT,
            env={**clean_environment(), **named, **environ},
            stdout=out,
            stderr=out,
        )
    core = Core(process, log, sock)
    try:
        if file_bytes_max is not None:
            resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (file_bytes_max, file_bytes_max))
        yield core
    finally:
        process.kill()
        process.wait(waiting.WAIT_S)
        for connection in core.connections:
            connection.close()


def clean_environment() -> dict[str, str]:
    return {
        name: value
        for name, value in os.environ.items()
        if not name.startswith(("HARDCORE_", "CORE_", "NOTIFY_", "WATCHDOG_"))
    }


def ready(core: Core) -> Core:
    def look() -> bool:
        assert core.process.poll() is None, core.said()
        return "Serving the ledger" in core.said()

    waiting.until(look, "the core to serve")
    if core.socket is None:
        core.port = int(core.said().split("http://127.0.0.1:")[1].split(",")[0])
    return core


def verify(data: Path, *arguments: str) -> "subprocess.CompletedProcess[bytes]":
    command = [sys.executable, "-m", "core", "verify", "--data", str(data), *arguments]
    return subprocess.run(
        command, cwd=ROOT, env=clean_environment(), capture_output=True, timeout=waiting.WAIT_S, check=False
    )
