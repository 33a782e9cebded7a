"""An investigator's process, with a guard and a ledger of a few lines beside it, over real sockets.

The guard answers as `docs/wires.md` sections 7 and 16 say, and the ledger as section 5 says of commands and keys; both
note what they were asked. What each answers is set by the test, and a request can be held until the test lets it go.
"""

import http.client
import json
import socket
import socketserver
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from postmortem.dead_letters import spool
from tests.waiting import until

Told = dict[str, Any]


class Guard:
    """A guard: `rules` that are in force, `asked` in their order, `serving` or not."""

    def __init__(self, path: Path, url: str) -> None:
        self.url = url
        self.rules: set[str] = set()
        self.asked: list[Told] = []
        self.serving = True
        self.epoch = 3
        self.refuses = False
        self.is_mute = False  # it does what it is asked, and its answer is lost
        outer = self

        class Handler(socketserver.StreamRequestHandler):
            def handle(self) -> None:
                told = json.loads(self.rfile.readline())
                answer = outer.answer(told)
                if not (outer.is_mute and told["verb"] != "status"):
                    self.wfile.write(json.dumps(answer).encode() + b"\n")

        self._server = socketserver.ThreadingUnixStreamServer(str(path), Handler)
        self._server.daemon_threads = True
        threading.Thread(target=self._server.serve_forever, args=(0.02,), daemon=True).start()

    def answer(self, told: Told) -> Told:
        match told["verb"]:
            case "status":
                core = {"ready": self.serving, "epoch": self.epoch, "pid": 1}
                return {"url": self.url, "phase": "RUNNING" if self.serving else "BACKOFF", "core": core}
            case "rule-add" if not self.refuses:
                self.asked.append(told)
                identity = told["rule"].get("id", f"rule-{len(self.asked)}")
                self.rules.add(identity)
                return {"ok": True, "id": identity}
            case "rule-remove" if not self.refuses:
                self.asked.append(told)
                self.rules.discard(told["id"])
                return {"ok": True}
            case _:
                return {"ok": False, "code": "bad-rule", "error": "It may not be."}

    def end(self) -> None:
        self._server.shutdown()
        self._server.server_close()


class Ledger:
    """A ledger: `done` by key, `answers` to what is asked; `held` requests wait for `release`."""

    def __init__(self) -> None:
        self.done: dict[str, int] = {}
        self.headers: list[dict[str, str]] = []
        self.bodies: list[bytes] = []
        self.answer: Callable[[str], tuple[int, Told]] = self.book
        self.held = threading.Event()
        self.release = threading.Event()
        self.release.set()
        outer = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                key = self.path.rpartition("/")[2]
                if key in outer.done:
                    self._say(200, {"key": key, "outcome": "done", "status": 201, "answer": {}})
                else:
                    self._say(404, {"type": "/problems/command-not-found", "outcome": "not_done"})

            def do_POST(self) -> None:
                outer.bodies.append(self.rfile.read(int(self.headers["Content-Length"] or 0)))
                outer.headers.append(dict(self.headers))
                outer.held.set()
                outer.release.wait(30)
                self._say(*outer.answer(self.headers["Idempotency-Key"]))

            def _say(self, status: int, told: Told) -> None:
                if status == 0:  # an answer that is lost
                    self.connection.shutdown(socket.SHUT_RDWR)
                    return
                body = json.dumps(told).encode()
                self.send_response(status)
                self.send_header("Content-Length", str(len(body)))
                if told.get("replayed"):
                    self.send_header("Idempotent-Replayed", "true")
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, *_: object) -> None:
                """Say nothing."""

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self._server.daemon_threads = True
        threading.Thread(target=self._server.serve_forever, args=(0.02,), daemon=True).start()

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self._server.server_address[1]}"

    def book(self, key: str) -> tuple[int, Told]:
        replayed = key in self.done
        self.done[key] = self.done.get(key, 0) + (not replayed)
        return 201, {"id": key, "replayed": replayed}

    def end(self) -> None:
        self.release.set()
        self._server.shutdown()
        self._server.server_close()


class World:
    """An investigator that runs, and what is around it."""

    def __init__(self, folder: Path) -> None:
        self.data = folder / "data"
        (self.data / "state").mkdir(parents=True)
        self.socket = folder / "i.sock"
        self.ledger = Ledger()
        self.guard = Guard(folder / "c.sock", self.ledger.url)
        self._control = folder / "c.sock"
        self.process: subprocess.Popen[bytes] | None = None
        self._token = ""

    def start(self, *more: str) -> None:
        argv = [sys.executable, "-I", "-m", "postmortem", "serve", "--data", str(self.data)]
        argv += ["--socket", str(self.socket), "--control", str(self._control), "--pace-s", "0.01", *more]
        self.process = subprocess.Popen(argv, stderr=subprocess.DEVNULL)
        until(self._listens, "the investigator to listen")

    def _listens(self) -> bool:
        assert self.process is not None
        assert self.process.poll() is None
        with socket.socket(socket.AF_UNIX) as probe:
            return probe.connect_ex(str(self.socket)) == 0

    def kill(self) -> None:
        assert self.process is not None
        self.process.kill()
        self.process.wait()

    def end(self) -> None:
        if self.process is not None:
            self.process.terminate()
            self.process.wait(10)
        self.ledger.end()
        self.guard.end()

    def put(self, kind: str, fields: Told) -> None:
        path = spool.write(self.data / "spool", kind, fields)
        assert isinstance(path, Path)
        until(lambda: not path.exists(), "the message to be taken in")

    def put_letter(self, fields: Told) -> str:
        self.guard.rules.add(fields["id"])
        self.put("letter", fields)
        return str(fields["id"])

    def ask(self, method: str, path: str, body: object = None, **headers: str) -> tuple[int, Told]:
        connection = http.client.HTTPConnection("localhost", timeout=30)
        connection.sock = socket.socket(socket.AF_UNIX)
        connection.sock.settimeout(30)
        try:
            connection.sock.connect(str(self.socket))
            data = None if body is None else json.dumps(body)
            connection.request(method, f"/admin/api/{path}", data, {"X-Admin": "1", **headers})
            answer = connection.getresponse()
            return answer.status, json.loads(answer.read() or b"{}")
        finally:
            connection.close()

    def get(self, path: str) -> Told:
        status, told = self.ask("GET", path)
        assert status == 200, told
        return told

    def post(self, path: str, body: object = None) -> tuple[int, Told]:
        self._token = self._token or self.get("token")["token"]
        return self.ask(
            "POST", path, body or {}, **{"X-CSRF": self._token, "Content-Type": "application/json"}
        )

    def state(self, letter: str) -> str:
        return str(self.get(f"letters/{letter}")["state"])


@contextmanager
def investigator_world(folder: Path) -> Iterator[World]:
    world = World(folder)
    try:
        world.start()
        yield world
    finally:
        world.end()
