"""HTTP over a Unix socket: how the owner's own programs speak to the gateway and the investigators.

Whoever may open the socket owns the data, so nothing is asked there for a password, and nothing travels over a network.
"""

import http.client
import json
import socket
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec


class Local(http.client.HTTPConnection):
    """A connection to a Unix socket."""

    def __init__(self, path: Path, timeout_s: float) -> None:
        super().__init__("localhost", timeout=timeout_s)
        self._path = path
        self._timeout_s = timeout_s

    def connect(self) -> None:
        """Dial the socket. OSError if nobody listens there."""
        self.sock = socket.socket(socket.AF_UNIX)
        self.sock.settimeout(self._timeout_s)
        self.sock.connect(str(self._path))


class Said(msgspec.Struct, frozen=True):
    """An answer: its status, and the object in it; empty where there is none."""

    status: int
    told: dict[str, Any]


def ask(
    path: Path, method: str, target: str, body: bytes | None, headers: Mapping[str, str], timeout_s: float
) -> Said:
    """Ask once. Raises OSError or http.client.HTTPException where no answer comes."""
    connection = Local(path, timeout_s)
    try:
        connection.request(method, target, body, dict(headers))
        answer = connection.getresponse()
        data = answer.read()
    finally:
        connection.close()
    try:
        told = json.loads(data)
    except ValueError:
        told = {}
    return Said(answer.status, told if isinstance(told, dict) else {})
