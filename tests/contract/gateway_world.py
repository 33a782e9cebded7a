"""A real gateway process between a scripted core and a scripted sentinel, for the contract tests.

Everything here is real sockets: the gateway is started as the sentinel starts it, the core is a small HTTP
server whose every answer a test chooses, and the feed is a socket that says what a test tells it to say.
"""

import contextlib
import hashlib
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from tests.waiting import until

DEADLINE_S = 20.0


def key_hash(key: str) -> str:
    return hashlib.sha256(key.encode()).digest()[:16].hex()


class Watched:
    """A list that can be waited for."""

    def __init__(self) -> None:
        self._items: list[Any] = []
        self._changed = threading.Condition()

    def append(self, item: Any) -> None:
        with self._changed:
            self._items.append(item)
            self._changed.notify_all()

    def all(self) -> list[Any]:
        with self._changed:
            return list(self._items)

    def wait(self, wanted: Callable[[Any], bool], count: int = 1) -> list[Any]:
        def found() -> list[Any]:
            return [item for item in self._items if wanted(item)]

        with self._changed:
            if not self._changed.wait_for(lambda: len(found()) >= count, DEADLINE_S):
                raise AssertionError(f"never came; there was {self._items!r}")
            return found()


@dataclass(frozen=True)
class Request:
    method: str
    target: str
    headers: tuple[tuple[str, str], ...]
    body: bytes

    def header(self, name: str) -> str | None:
        return next((v for n, v in self.headers if n.lower() == name.lower()), None)


@dataclass
class Call:
    """One connection to the core with the request that came on it."""

    connection: socket.socket
    request: Request
    epoch: int
    ended: threading.Event

    def wait_closed(self) -> None:
        """Until the gateway has closed this connection."""
        assert self.ended.wait(DEADLINE_S), "the gateway keeps a connection that is of no use"

    def answer(
        self, status: int = 200, body: bytes = b"", *, epoch: int | None = -1, headers: tuple[str, ...] = ()
    ) -> None:
        lines = [f"HTTP/1.1 {status} X", f"Content-Length: {len(body)}", *headers]
        named = self.epoch if epoch == -1 else epoch
        if named is not None:
            lines.append(f"X-Core-Epoch: {named}")
        self.raw("\r\n".join([*lines, "", ""]).encode() + body)

    def raw(self, data: bytes) -> None:
        with contextlib.suppress(OSError):
            self.connection.sendall(data)

    def hang_up(self) -> None:
        with contextlib.suppress(OSError):
            self.connection.shutdown(socket.SHUT_RDWR)


Script = Callable[[Call], None]


def echo(call: Call) -> None:
    body = json.dumps({"epoch": call.epoch, "target": call.request.target}).encode()
    call.answer(200, body, headers=("Content-Type: application/json",))


def silent(_: Call) -> None:
    """Never answer."""


class Core:
    """A core of one life. `script` decides every answer but that to /healthz."""

    def __init__(
        self, path: Path, epoch: int, script: Script = echo, *, health: Script | None = None
    ) -> None:
        self.path = path
        self.epoch = epoch
        self.script = script
        self.health = health or (lambda call: call.answer(200, b"{}"))
        self.at_head: Script | None = None  # answers before the body is read, and reads no more
        self.calls = Watched()
        self.connections = 0
        self._open: set[socket.socket] = set()
        self._lock = threading.Lock()
        self._threads: list[threading.Thread] = []
        self._listener = socket.socket(socket.AF_UNIX)
        self._listener.bind(str(path))
        self._listener.listen(128)
        self._spawn(self._accept)

    def _spawn(self, target: Callable[..., None], *args: object) -> None:
        thread = threading.Thread(target=target, args=args, daemon=True)
        self._threads.append(thread)
        thread.start()

    def _accept(self) -> None:
        while True:
            try:
                connection, _ = self._listener.accept()
            except OSError:
                return
            with self._lock:
                self._open.add(connection)
                self.connections += 1
            self._spawn(self._serve, connection)

    def _serve(self, connection: socket.socket) -> None:
        stream = connection.makefile("rb")
        ended = threading.Event()
        try:
            while (request := read_request(stream, lambda: self.at_head is not None)) is not None:
                call = Call(connection, request, self.epoch, ended)
                if request.target == "/healthz":
                    self.health(call)
                    continue
                self.calls.append(call)
                if self.at_head is not None:
                    self.at_head(call)
                    stream.read()  # as servers do: closing on unread bytes would take the answer back
                    return
                self.script(call)
        except (OSError, ValueError):
            pass
        finally:
            with self._lock:
                self._open.discard(connection)
            stream.close()
            connection.close()
            ended.set()

    def wait(self, target: str, count: int = 1) -> list[Call]:
        return self.calls.wait(lambda call: call.request.target == target, count)

    def targets(self) -> list[str]:
        return [call.request.target for call in self.calls.all()]

    def refuse(self) -> None:
        """Take no new connection; those that are open stay."""
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self.path.unlink(missing_ok=True)

    def die(self) -> None:
        """As a kill -9 does: every connection ends at once."""
        self.refuse()
        with self._lock:
            for connection in self._open:
                with contextlib.suppress(OSError):
                    connection.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        self.die()
        for thread in self._threads:
            thread.join(DEADLINE_S)


def read_request(stream: Any, heads_only: Callable[[], bool]) -> Request | None:
    first = stream.readline()
    if not first:
        return None
    method, target, _ = first.decode("latin-1").split(" ")
    headers = []
    while (line := stream.readline()) not in {b"\r\n", b""}:
        name, _, value = line.decode("latin-1").rstrip("\r\n").partition(": ")
        headers.append((name, value))
    names = {n.lower(): v for n, v in headers}
    body = b""
    if heads_only():
        pass
    elif names.get("transfer-encoding") == "chunked":
        while size := int(stream.readline(), 16):
            body += stream.read(size)
            stream.readline()
        stream.readline()
    elif "content-length" in names:
        length = int(names["content-length"])
        body = stream.read(length)
        if len(body) < length:
            return None
    return Request(method, target, tuple(headers), body)


class Feed:
    """The sentinel's side of the control socket."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.heard = Watched()
        self.orders = Watched()
        self.says: dict[str, Any] | None = {"ok": True}  # to an order; None: it hangs up
        self.generation = 1
        self._subscribed = Watched()
        self._listener: socket.socket | None = None
        self._connection: socket.socket | None = None
        self._threads: list[threading.Thread] = []

    def open(self) -> None:
        self.path.unlink(missing_ok=True)
        self._listener = socket.socket(socket.AF_UNIX)
        self._listener.bind(str(self.path))
        self._listener.listen(4)
        thread = threading.Thread(target=self._accept, args=(self._listener,), daemon=True)
        self._threads.append(thread)
        thread.start()

    def _accept(self, listener: socket.socket) -> None:
        while True:
            try:
                connection, _ = listener.accept()
            except OSError:
                return
            thread = threading.Thread(target=self._read, args=(connection,), daemon=True)
            self._threads.append(thread)
            thread.start()

    def _read(self, connection: socket.socket) -> None:
        with connection.makefile("rb") as stream, contextlib.suppress(OSError, ValueError):
            for line in stream:
                fields = json.loads(line)
                if fields.get("verb") == "subscribe":
                    self._connection = connection
                    self._subscribed.append(fields)
                elif "verb" in fields:
                    self.orders.append(fields)
                    if self.says is not None:
                        connection.sendall(json.dumps(self.says).encode() + b"\n")
                    break
                else:
                    self.heard.append(fields)
        connection.close()

    @property
    def subscribed(self) -> list[Any]:
        return self._subscribed.all()

    def wait_subscribed(self, count: int = 1) -> dict[str, Any]:
        return dict(self._subscribed.wait(lambda _: True, count)[-1])

    def wait(self, kind: str, wanted: Callable[[Any], bool] = lambda _: True, count: int = 1) -> list[Any]:
        return self.heard.wait(lambda line: line["type"] == kind and wanted(line), count)

    def raw(self, data: bytes) -> None:
        assert self._connection is not None
        self._connection.sendall(data)

    def say(self, kind: str, **fields: Any) -> None:
        self.raw(json.dumps({"type": kind, "generation": self.generation, **fields}).encode() + b"\n")

    def phase(self, face: str, *, phase: str = "RUNNING", state: str = "OPERATIONAL", **fields: Any) -> None:
        line = {"stage": None, "since_ns": time.monotonic_ns(), "incident": None, "planned": False, **fields}
        self.say("phase", phase=phase, state=state, face=face, **line)

    def hold(self, incident: str | None = "i1") -> None:
        self.phase("HOLD", phase="STARTING", state="RECOVERY", incident=incident)

    def serve(self, core: Core, *, incident: str | None = None, suspects: tuple[str, ...] = ()) -> None:
        """As the sentinel says it after a proof."""
        self.say("suspects", keys=list(suspects))
        self.say("serving", socket=str(core.path), epoch=core.epoch)
        self.say("release", epoch=core.epoch, incident=incident)
        self.phase("FORWARD")

    def close(self) -> None:
        """As a sentinel's death does."""
        if self._listener is not None:
            with contextlib.suppress(OSError):
                self._listener.shutdown(socket.SHUT_RDWR)
            self._listener.close()
        if self._connection is not None:
            with contextlib.suppress(OSError):
                self._connection.shutdown(socket.SHUT_RDWR)
        for thread in self._threads:
            thread.join(DEADLINE_S)


@dataclass(frozen=True)
class Response:
    status: int
    headers: tuple[tuple[str, str], ...]
    body: bytes

    def header(self, name: str) -> str | None:
        return next((v for n, v in self.headers if n.lower() == name.lower()), None)

    def json(self) -> Any:
        return json.loads(self.body)


class Client:
    """One connection to the gateway."""

    def __init__(self, port: int) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), DEADLINE_S)
        self._stream = self.socket.makefile("rb")

    def send(self, data: bytes) -> Self:
        self.socket.sendall(data)
        return self

    def ask(self, method: str, target: str, *headers: str, body: bytes | None = None) -> Self:
        lines = [f"{method} {target} HTTP/1.1", "Host: localhost", *headers]
        if body is not None:
            lines.append(f"Content-Length: {len(body)}")
        return self.send("\r\n".join([*lines, "", ""]).encode("latin-1") + (body or b""))

    def read(self, *, head: bool = False) -> Response:
        line = self._stream.readline()
        assert line, "the connection was closed without an answer"
        status = int(line.split(b" ")[1])
        headers = []
        while (line := self._stream.readline()) not in {b"\r\n", b""}:
            name, _, value = line.decode("latin-1").rstrip("\r\n").partition(": ")
            headers.append((name, value))
        names = {n.lower(): v for n, v in headers}
        if head or status in {204, 304, 100}:
            body = b""
        elif names.get("transfer-encoding") == "chunked":
            body = self._chunks()
        elif "content-length" in names:
            body = self._stream.read(int(names["content-length"]))
        else:
            body = self._stream.read()
        return Response(status, tuple(headers), body)

    def _chunks(self) -> bytes:
        body = b""
        while True:
            line = self._stream.readline()
            assert line, "the connection was closed in the middle of an answer"
            size = int(line, 16)
            body += self._stream.read(size)
            self._stream.readline()
            if not size:
                return body

    def closed(self) -> bool:
        """Wait for the gateway to close; False if it says something instead."""
        try:
            return self._stream.read(1) == b""
        except ConnectionResetError:
            return True

    def close(self) -> None:
        self._stream.close()
        self.socket.close()


#: Most look at no page: none is made for them unless they ask for one of its files.
PAPER_NEVER_MS = 60_000


@dataclass
class World:
    """A gateway process, and everything around it."""

    folder: Path
    limits: dict[str, int] = field(default_factory=dict)
    options: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        self.feed = Feed(self.folder / "control.sock")
        self._cores: list[Core] = []
        self._clients: list[Client] = []
        self.process: subprocess.Popen[bytes] | None = None
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self.log = self.folder / "gateway.log"

    def start(self) -> Self:
        fd = self._listener.fileno()
        command = [sys.executable, "-m", "hardcore.crisis", "--listen-fd", str(fd)]
        command += ["--control", str(self.feed.path), *self.options]
        limits = {"paper_after_ms": PAPER_NEVER_MS, **self.limits}
        environment = {**os.environ, "HARDCORE_LIMITS": json.dumps(limits)}
        with self.log.open("wb") as log:
            self.process = subprocess.Popen(
                command, pass_fds=(fd,), env=environment, stdout=log, stderr=log, start_new_session=True
            )
        return self

    def serving(self, script: Script = echo, epoch: int = 1) -> Core:
        """A world at peace: feed subscribed, one core released and seen to serve."""
        core = self.core(epoch, script)
        self.feed.open()
        self.start()
        self.feed.wait_subscribed()
        self.feed.serve(core)
        self.feed.wait("served", lambda line: line["epoch"] == epoch)
        return core

    def holding(self) -> None:
        """A world in which no core serves yet."""
        self.feed.open()
        self.start()
        self.feed.wait_subscribed()
        self.feed.hold()
        self.feed.wait("holding")

    def die(self, core: Core) -> None:
        """The core dies, and the sentinel sees it."""
        core.die()
        self.feed.hold()

    def lose(self, *headers: str, method: str = "POST", body: bytes = b"abc") -> Client:
        """A request whose core dies before it answers; the client still waits."""
        core = self.serving(silent)
        client = self.client().ask(method, "/t", *headers, body=body)
        core.wait("/t")
        self.die(core)
        return client

    def core(self, epoch: int, script: Script = echo, **more: Any) -> Core:
        core = Core(self.folder / f"core-{epoch}-{len(self._cores)}.sock", epoch, script, **more)
        self._cores.append(core)
        return core

    def client(self) -> Client:
        client = Client(self.port)
        self._clients.append(client)
        return client

    def ask(self, method: str, target: str, *headers: str, body: bytes | None = None) -> Response:
        return self.client().ask(method, target, *headers, body=body).read(head=method == "HEAD")

    def wait_held(self, count: int) -> None:
        """Until the gateway says that so many requests wait in it."""
        until(lambda: self.feed.wait("stats")[-1]["held"] == count, f"{count} held")

    def terminate(self) -> None:
        assert self.process is not None
        self.process.send_signal(signal.SIGTERM)

    def close(self) -> None:
        for client in self._clients:
            client.close()
        if self.process is not None:
            self.process.kill()
            self.process.wait(DEADLINE_S)
        for core in self._cores:
            core.close()
        self.feed.close()
        self._listener.close()


@contextlib.contextmanager
def world(folder: Path, *options: str, **limits: int) -> Iterator[World]:
    """A world that is gone afterwards, whatever happens in it."""
    made = World(folder, limits, options)
    try:
        yield made
    except BaseException as error:
        error.add_note(made.log.read_text() if made.log.exists() else "the gateway wrote no log")
        raise
    finally:
        made.close()
