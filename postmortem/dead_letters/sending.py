"""Sends a letter's request through the gateway under its own key, and looks a key up.

By the same door as everybody's requests, so that a retry that kills a core again is held, tried and convicted like any
other. What came of it is a value: `Sent`, or `Lost` where nobody can say. A client library was not chosen: two kinds of
requests to our own loopback address need none.
"""

import http.client
import json
import socket
from collections.abc import Mapping
from typing import Any, Final
from urllib.parse import quote, urlsplit

import msgspec

from postmortem.dead_letters.payload import body_of, headers

#: Longer than the gateway's own deadline for one request, and a trial on top of it.
SEND_S: Final = 60.0
LOOK_UP_S: Final = 15.0
ANSWER_BYTES_MAX: Final = 1 << 20


class Sent(msgspec.Struct, frozen=True):
    """The answer to a request. `problem`: the slug of its problem, `outcome` as it says, empty where it says none."""

    status: int
    problem: str
    outcome: str
    detail: str
    letter: str
    replayed: bool


class Lost(msgspec.Struct, frozen=True):
    """No answer: what became of the request is not known. `why` in a few words."""

    why: str


class _Local(http.client.HTTPConnection):
    """A connection to a Unix socket."""

    def __init__(self, path: str, timeout_s: float) -> None:
        super().__init__("localhost", timeout=timeout_s)
        self._path = path
        self._timeout_s = timeout_s

    def connect(self) -> None:
        self.sock = socket.socket(socket.AF_UNIX)
        self.sock.settimeout(self._timeout_s)
        self.sock.connect(self._path)


def _connection(url: str, door: str, timeout_s: float) -> http.client.HTTPConnection:
    if door:
        return _Local(door, timeout_s)
    place = urlsplit(url)
    assert place.hostname is not None, url
    return http.client.HTTPConnection(place.hostname, place.port, timeout=timeout_s)


class Ledger(msgspec.Struct, frozen=True):
    """The ledger behind the gateway at one address, such as http://127.0.0.1:3000. `door`: its socket for this machine's
    owner, if there is one; the address is then what the request says it is for.
    """

    url: str
    door: str = ""

    def send(self, case: Mapping[str, Any], key: str) -> Sent | Lost:
        """Send a case's request under its key. Blocks for SEND_S at most."""
        request = case["request"]
        given = {name: value for name, value in headers(request) if name.lower() != "idempotency-key"}
        # A form is answered as a program is: a page for people would say its outcome in words alone.
        given |= {"Accept": "application/json", "Idempotency-Key": key}
        return self._ask(request["method"], request["path"], body_of(case), given, SEND_S)

    def is_done(self, key: str) -> bool | None:
        """Tell whether a key is in the ledger; None: nobody could say it now."""
        found = self._ask("GET", f"/api/ledger/commands/{quote(key, safe='')}", None, {}, LOOK_UP_S)
        match found:
            case Sent(status=200, outcome="done"):
                return True
            case Sent(status=404, outcome="not_done"):
                return False
            case _:
                return None

    def _ask(
        self, method: str, path: str, body: bytes | None, given: Mapping[str, str], timeout_s: float
    ) -> Sent | Lost:
        given = {**given, "Host": urlsplit(self.url).netloc} if self.door else given
        connection = _connection(self.url, self.door, timeout_s)
        try:
            connection.request(method, path, body, dict(given))
            answer = connection.getresponse()
            data = answer.read(ANSWER_BYTES_MAX)
            return _sent(answer.status, data, replayed=answer.getheader("Idempotent-Replayed") == "true")
        except (OSError, http.client.HTTPException, ValueError) as error:
            # ValueError: a path or a header that no request can carry.
            return Lost(str(error) or type(error).__name__)
        finally:
            connection.close()


def _sent(status: int, data: bytes, *, replayed: bool) -> Sent:
    try:
        told = json.loads(data)
    except (ValueError, RecursionError):
        told = {}
    told = told if isinstance(told, dict) else {}
    kind, outcome, detail, letter = (
        value if isinstance(value := told.get(name), str) else ""
        for name in ("type", "outcome", "detail", "letter")
    )
    problem = kind.removeprefix("/problems/") if kind.startswith("/problems/") else ""
    return Sent(status, problem, outcome, detail[:512], letter, replayed)
