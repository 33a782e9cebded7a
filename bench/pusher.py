"""A client that does nothing but push: as many requests as a number of connections can carry, over plain sockets.

Run as a process of its own (two of them load two cores), so that the client is not what is measured. Each
connection asks again when it has its answer. It prints what it counted as JSON.
Usage: `python -m bench.pusher read|refused|book ADDRESS CONNECTIONS SECONDS NAME`; an address is host:port or a path.
"""

import json
import re
import selectors
import socket
import sys
import time
from dataclasses import dataclass, field

from bench.instance import ONE_ACCOUNT, TRANSACTIONS, transaction

_LENGTH = re.compile(rb"\r\ncontent-length: *([0-9]+)", re.IGNORECASE)
_CHUNK_BYTES = 1 << 16
#: A booking whose lines do not add up: taken apart and refused like any other, and the book is never asked.
UNEVEN = "1"


@dataclass(slots=True)
class Pushed:
    """What was counted: good answers, others, and the time it took."""

    good: int = 0
    bad: int = 0
    seconds: float = 0.0


@dataclass(slots=True)
class Connection:
    """One connection, its unread bytes, and how many requests it has sent."""

    plug: socket.socket
    number: int
    sent: int = 0
    received: bytearray = field(default_factory=bytearray)

    def ask(self, kind: str, name: str) -> None:
        """Send the next request; one always fits into an empty socket."""
        self.sent += 1
        match kind:
            case "read":
                self.plug.sendall(_get(ONE_ACCOUNT))
            case "refused":
                self.plug.sendall(_book(f"{name}-{self.number}-{self.sent}", UNEVEN))
            case _:
                self.plug.sendall(_book(f"{name}-{self.number}-{self.sent}"))

    def answer(self) -> bytes | None:
        """Take in what has come; return the answer's status once it is whole."""
        self.received += self.plug.recv(_CHUNK_BYTES)
        head, end, body = bytes(self.received).partition(b"\r\n\r\n")
        length = _LENGTH.search(head)
        if not end or length is None or len(body) < int(length[1]):
            return None
        self.received.clear()
        return head[9:12]


def _get(path: str) -> bytes:
    return f"GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode()


def _book(key: str, amount: str | None = None) -> bytes:
    wish = transaction(key)
    if amount is not None:
        wish["postings"][0]["amount"] = amount
    body = json.dumps(wish).encode()
    head = f"POST {TRANSACTIONS} HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
    return f"{head}Idempotency-Key: {key}\r\nContent-Length: {len(body)}\r\n\r\n".encode() + body


def connect(address: str) -> socket.socket:
    """Connect to host:port or to a path."""
    if address.startswith("/"):
        plug = socket.socket(socket.AF_UNIX)
        plug.connect(address)
        return plug
    host, _, port = address.rpartition(":")
    return socket.create_connection((host, int(port)))


def push(kind: str, address: str, connections: int, seconds: float, name: str) -> Pushed:
    """Push for so many seconds."""
    counted = Pushed()
    with selectors.DefaultSelector() as selector:
        for number in range(connections):
            each = Connection(connect(address), number)
            selector.register(each.plug, selectors.EVENT_READ, each)
            each.ask(kind, name)
        began = time.monotonic()
        while (passed := time.monotonic() - began) < seconds:
            for key, _events in selector.select(seconds - passed):
                status = key.data.answer()
                if status is not None:
                    is_good = status.startswith(b"422" if kind == "refused" else b"2")
                    counted.good += is_good
                    counted.bad += not is_good
                    key.data.ask(kind, name)
        counted.seconds = time.monotonic() - began
        for key in list(selector.get_map().values()):
            key.data.plug.close()
    return counted


def main() -> None:
    """Push, and print what was counted."""
    kind, address, connections, seconds, name = sys.argv[1:]
    counted = push(kind, address, int(connections), float(seconds), name)
    print(json.dumps({"good": counted.good, "bad": counted.bad, "seconds": counted.seconds}))


if __name__ == "__main__":
    main()
