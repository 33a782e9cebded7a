"""One line to the ledger: a kept connection over which a client asks, waits, and takes down what it was told.

It is an ordinary client: HTTP/1.1 with keep-alive, patient as long as a gateway may hold a request, and it asks
each thing once. It does not repeat anything by itself, because whoever counts failures must see them all.
"""

import http.client
import json
import time
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Self

#: Longer than the gateway holds a request (10 s), so that its answer is heard and not our own impatience.
PATIENCE_S = 15.0


@dataclass(frozen=True, slots=True)
class Answer:
    """What was told, and the monotonic times in ns of asking and of having the whole answer."""

    status: int
    body: Any
    asked_ns: int
    told_ns: int

    @property
    def good(self) -> bool:
        """Whether it was done or shown."""
        return 200 <= self.status < 300

    def __str__(self) -> str:
        detail = self.body.get("detail", "") if isinstance(self.body, dict) else ""
        return f"{self.status} {detail}".strip()


@dataclass(frozen=True, slots=True)
class Broken:
    """No answer: the connection failed, or nobody spoke for too long. Times as in an answer."""

    reason: str
    asked_ns: int
    told_ns: int

    @property
    def good(self) -> bool:
        """Never."""
        return False

    def __str__(self) -> str:
        return self.reason


class Line:
    """A connection that is made when it is needed and kept. Not for two threads at once."""

    def __init__(self, address: tuple[str, int]) -> None:
        self._connection = http.client.HTTPConnection(*address, timeout=PATIENCE_S)

    def __enter__(self) -> Self:
        """Nothing is opened before the first question."""
        return self

    def __exit__(
        self, _type: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        """Close the connection."""
        self._connection.close()

    def get(self, path: str) -> Answer | Broken:
        """Ask to be shown something."""
        return self._ask("GET", path, None, {})

    def post(self, path: str, body: object, key: str) -> Answer | Broken:
        """Ask for something to be done, under a key that stays the same however often it is asked."""
        headers = {"Content-Type": "application/json", "Idempotency-Key": key}
        return self._ask("POST", path, json.dumps(body).encode(), headers)

    def _ask(self, method: str, path: str, body: bytes | None, headers: dict[str, str]) -> Answer | Broken:
        asked_ns = time.monotonic_ns()
        try:
            self._connection.request(method, path, body, headers)
            response = self._connection.getresponse()
            told = json.loads(response.read())
            return Answer(response.status, told, asked_ns, time.monotonic_ns())
        except (OSError, http.client.HTTPException, ValueError) as error:
            self._connection.close()
            reason = f"no answer ({type(error).__name__}: {error})"
            return Broken(reason, asked_ns, time.monotonic_ns())
