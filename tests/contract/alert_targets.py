"""Targets of alerts, played by the test: a web server and a mail server with one behaviour each, on loopback."""

import datetime as dt
import ipaddress
import json
import socket
import ssl
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec

from hardcore.host import clock
from hardcore.host.folders import Folders
from hardcore.host.ids import new_id
from tests.waiting import until


@dataclass
class Came:
    """One request as it came."""

    target: str
    headers: Mapping[str, str]
    body: bytes

    @property
    def json(self) -> Any:
        return json.loads(self.body)


@dataclass
class Web:
    """A web server. `answers` are said one after the other, the last one for ever; an empty one hangs."""

    port: int
    answers: list[bytes]
    came: list[Came] = field(default_factory=list)
    accepted: int = 0

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    @property
    def texts(self) -> list[str]:
        return [str(one.json.get("text") or one.json.get("message")) for one in self.came]

    def answer(self) -> bytes:
        return self.answers.pop(0) if len(self.answers) > 1 else self.answers[0]


def status(code: int, *headers: str, body: bytes = b"ok") -> bytes:
    lines = [f"HTTP/1.1 {code} X", f"Content-Length: {len(body)}", "Connection: close", *headers]
    return "\r\n".join(lines).encode() + b"\r\n\r\n" + body


OK = status(200)
HANGS = b""


@contextmanager
def web(*answers: bytes, tls: ssl.SSLContext | None = None) -> Iterator[Web]:
    """Serve until the test is over."""
    with listening() as (server, open_ones):
        played = Web(server.getsockname()[1], list(answers) or [OK])

        def serve(line: socket.socket) -> None:
            played.accepted += 1
            talk = tls.wrap_socket(line, server_side=True) if tls is not None else line
            came = _request(talk)
            if came is None:
                return
            answer = played.answer()
            played.came.append(came)
            if answer:
                talk.sendall(answer)
                talk.close()

        threading.Thread(target=_accept, args=(server, open_ones, serve), daemon=True).start()
        yield played


@contextmanager
def listening() -> Iterator[tuple[socket.socket, list[socket.socket]]]:
    """A listener, and the lines that are open; all closed in the end."""
    open_ones: list[socket.socket] = []
    with socket.create_server(("127.0.0.1", 0)) as server:
        try:
            yield server, open_ones
        finally:
            server.shutdown(socket.SHUT_RDWR)
            for one in open_ones:
                one.close()


def _accept(
    server: socket.socket, open_ones: list[socket.socket], serve: Callable[[socket.socket], None]
) -> None:
    while True:
        try:
            line, _ = server.accept()
        except OSError:
            return  # the test is over
        open_ones.append(line)
        threading.Thread(target=_quietly, args=(serve, line), daemon=True).start()


def _quietly(serve: Callable[[socket.socket], None], line: socket.socket) -> None:
    try:
        serve(line)
    except (OSError, ValueError):
        line.close()  # the sender hung up: that is its answer


def _request(talk: socket.socket) -> Came | None:
    data = b""
    while b"\r\n\r\n" not in data:
        piece = talk.recv(65536)
        if not piece:
            return None
        data += piece
    head, _, body = data.partition(b"\r\n\r\n")
    first, *lines = head.decode("latin-1").split("\r\n")
    headers = {name.lower(): value.strip() for name, _, value in (line.partition(":") for line in lines)}
    while len(body) < int(headers.get("content-length", "0")):
        body += talk.recv(65536)
    return Came(first.split(" ")[1], headers, body)


@dataclass
class Post:
    """A mail server. `refuses` is the beginning of a command that it answers with 550; `leaves` its answer to QUIT."""

    port: int
    refuses: str
    offers: tuple[str, ...]
    mails: list[bytes] = field(default_factory=list)
    heard: list[str] = field(default_factory=list)
    leaves: bytes = b"221 bye\r\n"


@contextmanager
def post(refuses: str = "", offers: tuple[str, ...] = ("AUTH PLAIN LOGIN",)) -> Iterator[Post]:
    """Take mails until the test is over."""
    with listening() as (server, open_ones):
        played = Post(server.getsockname()[1], refuses, offers)
        threading.Thread(
            target=_accept, args=(server, open_ones, lambda line: _take_mail(played, line)), daemon=True
        ).start()
        yield played


def _take_mail(played: Post, line: socket.socket) -> None:
    with line, line.makefile("rb") as said:
        line.sendall(b"220 post\r\n")
        for raw in said:
            command = raw.decode("latin-1").strip()
            played.heard.append(command)
            word = command.split(" ")[0].upper()
            if played.refuses and command.upper().startswith(played.refuses):
                line.sendall(b"550 CANARY-of-the-server no\r\n")
            elif word == "EHLO":
                lines = ["post", *played.offers]
                replies = [f"250{' ' if one is lines[-1] else '-'}{one}\r\n" for one in lines]
                line.sendall("".join(replies).encode())
            elif word == "DATA":
                line.sendall(b"354 go on\r\n")
                played.mails.append(_mail(said))
                line.sendall(b"250 taken\r\n")
            elif word == "AUTH":
                line.sendall(b"235 welcome\r\n")
            elif word == "QUIT":
                line.sendall(played.leaves)
                return
            else:
                line.sendall(b"250 ok\r\n")


def _mail(said: Any) -> bytes:
    lines = []
    for raw in said:
        if raw == b".\r\n":
            break
        lines.append(raw)
    return b"".join(lines)


# ---- the guard's side ----


@dataclass
class Outgoing:
    """A data folder with channels, into which the test puts what is to be told."""

    folders: Folders
    _last: str = ""

    def channels(self, *channels: Mapping[str, object]) -> None:
        self.folders.good_policy.write_text(json.dumps({"version": 1, "alerts": channels}), "utf-8")

    def put(self, stage: str = "opened", **told: object) -> str:
        name = self._next()
        value: dict[str, object] = {
            "version": 1,
            "at": clock.wall(clock.now_ns()),
            "stage": stage,
            "diagnosis": "CRASHED",
            "incident": None,
            "fingerprint": "CRASHED",
            "text": "the core ended by SIGSEGV",
            "outcome": "",
            "outage_ms": None,
            "url": "http://127.0.0.1:3000",
            "lang": ["ko", "en"],
        }
        (self.folders.outbox / f"{name}.json").write_text(json.dumps({**value, **told}), "utf-8")
        return name

    def _next(self) -> str:
        """A name of a later millisecond than the one before: within one, names have no order."""
        while (name := new_id())[:13] <= self._last[:13]:
            pass
        self._last = name
        return name

    def report(self, incident: str, **facts: object) -> None:
        folder = self.folders.incidents / incident
        folder.mkdir(parents=True)
        (folder / "report.json").write_text(json.dumps(facts), "utf-8")

    @property
    def book(self) -> Any:
        return json.loads(self.folders.alerts.read_text("utf-8"))

    @property
    def waiting(self) -> list[Path]:
        return list(self.folders.outbox.iterdir())


def outgoing(place: Path) -> Outgoing:
    folders = Folders(place / "data", place / "run")
    for folder in (folders.state, folders.outbox, folders.incidents, folders.logs, folders.run):
        folder.mkdir(parents=True)
    return Outgoing(folders)


def comes(played: Web, count: int) -> list[Came]:
    until(lambda: len(played.came) >= count, f"{count} messages")
    return played.came


def own_certificate(place: Path) -> ssl.SSLContext:
    """A server's side of TLS under a certificate that nobody vouches for."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, "127.0.0.1")])
    today = dt.datetime.now(dt.UTC)
    made = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(1)
        .not_valid_before(today - dt.timedelta(days=1))
        .not_valid_after(today + dt.timedelta(days=1))
        .add_extension(
            x509.SubjectAlternativeName([x509.IPAddress(ipaddress.ip_address("127.0.0.1"))]), critical=False
        )
        .sign(key, hashes.SHA256())
    )
    path = place / "own.pem"
    form = serialization.PrivateFormat.PKCS8
    held = key.private_bytes(serialization.Encoding.PEM, form, serialization.NoEncryption())
    path.write_bytes(held + made.public_bytes(serialization.Encoding.PEM))
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(path)
    return context
