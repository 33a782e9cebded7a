"""A gateway with receipts, and a ledger that outlives its cores, for the contract tests of promises."""

import contextlib
import hashlib
import json
import subprocess
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import pytest

from tests.contract.gateway_world import Call, Client, Core, Response, World, world
from tests.waiting import until

LOOK_UP = "/api/ledger/commands/"
ASYNC = "Prefer: respond-async"
COOKIE = "Cookie: __hc=me"
TAB = "Accept: text/html"
FORM = "Content-Type: application/x-www-form-urlencoded"


@contextlib.contextmanager
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A folder on a disk of 256 KiB, which is soon full."""
    place = tmp_path / "small"
    place.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=256k", "small", str(place)]
    if subprocess.run(mount, check=False, capture_output=True).returncode:
        pytest.skip("nothing can be mounted here")
    try:
        yield place
    finally:
        subprocess.run(["umount", str(place)], check=True)


@dataclass
class Ledger:
    """What a ledger keeps under its keys. `before` and `after` are called around the commit; one that returns True
    has taken the answer upon itself (or lets nobody answer).
    """

    booked: list[str] = field(default_factory=list)
    kept: dict[str, tuple[str, int, Any]] = field(default_factory=dict)
    before: Callable[[Call], bool] = lambda _: False
    after: Callable[[Call], bool] = lambda _: False
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def __call__(self, call: Call) -> None:
        """Answer as a core does."""
        target = call.request.target
        if target.startswith(LOOK_UP):
            self._look_up(call, unquote(target.removeprefix(LOOK_UP)))
        elif call.request.method == "GET":
            call.answer(200, b"{}")
        else:
            self._wish(call)

    def _look_up(self, call: Call, key: str) -> None:
        found = self.kept.get(key)
        if found is None:
            tell(call, 404, {"outcome": "not_done"})
        elif found[0] != call.request.header("X-Request-Digest"):
            tell(call, 200, {"key": key, "outcome": "unknown"})
        else:
            tell(call, 200, {"key": key, "outcome": "done", "status": found[1], "answer": found[2]})

    def _wish(self, call: Call) -> None:
        if self.before(call):
            return
        key = call.request.header("Idempotency-Key")
        assert key is not None
        with self._lock:
            known = self.kept.get(key)
            if known is None:
                self.booked.append(key)
                known = self.kept[key] = (digest(call), 201, {"id": f"t-{key}"})
        if not self.after(call):
            tell(call, known[1] if known[0] == digest(call) else 422, known[2])


def name_of(method: str, path: str, body: bytes) -> str:
    """The name of a request in a look-up."""
    return hashlib.sha256(f"{method} {path}\n".encode() + body).hexdigest()


def digest(call: Call) -> str:
    """The name of a request that came."""
    return name_of(call.request.method, call.request.target.split("?")[0], call.request.body)


def tell(call: Call, status: int, fields: Any, *headers: str) -> None:
    """Answer in JSON."""
    call.answer(status, json.dumps(fields).encode(), headers=("Content-Type: application/json", *headers))


def hangs_up(call: Call) -> bool:
    """As a core that dies does."""
    call.hang_up()
    return True


def saying(status: int, fields: Any) -> Callable[[Call], bool]:
    """A core that says this and does nothing."""

    def say(call: Call) -> bool:
        tell(call, status, fields)
        return True

    return say


def sent(core: Core, key: str) -> list[str]:
    """The requests themselves that a core was given under a key."""
    return [c.request.target for c in core.calls.all() if c.request.header("Idempotency-Key") == key]


@contextlib.contextmanager
def promising(folder: Path, file: Path | None = None, /, **limits: int) -> Iterator[World]:
    """A world whose gateway keeps receipts; short waits, unless a test says otherwise."""
    waits = {"hold_ms": 50, "receipt_pause_ms": 20, "probe_ms": 20, **limits}
    with world(folder, "--receipts", str(file or folder / "receipts.db"), **waits) as made:
        yield made


def wish(w: World, key: str, *headers: str, body: bytes = b'{"a":1}', path: str = "/api/ledger/t") -> Client:
    """Send a wish that takes a promise for an answer."""
    return w.client().ask("POST", path, f"Idempotency-Key: {key}", ASYNC, COOKIE, *headers, body=body)


def promised(w: World, key: str, *headers: str, body: bytes = b'{"a":1}') -> Response:
    """Have a wish promised in an outage."""
    answer = wish(w, key, *headers, body=body).read()
    assert (answer.status, answer.json()) == (202, {"receipt": key, "outcome": "waiting"}), answer.body
    return answer


def receipt(w: World, key: str) -> Any:
    """What the gateway says of a receipt."""
    return w.ask("GET", f"/__hc/receipts/{key}").json()


def becomes(w: World, key: str, outcome: str) -> Any:
    """Wait until a receipt has an outcome."""
    until(lambda: receipt(w, key).get("outcome") == outcome, f"{key} to be {outcome}")
    return receipt(w, key)


def kill(w: World) -> None:
    """The gateway dies as by kill -9."""
    assert w.process is not None
    w.process.kill()
    w.process.wait(20)


def reborn(w: World, core: Core | None = None) -> None:
    """Another gateway on the same listener; it is told what the sentinel tells whoever subscribes."""
    kill(w)
    known = len(w.feed.subscribed)
    w.start()
    w.feed.wait_subscribed(known + 1)
    has_read(w)
    if core is None:
        w.feed.hold()
    else:
        w.feed.serve(core)


def hold(w: World) -> None:
    """An outage, and a gateway that has read its receipts."""
    w.holding()
    has_read(w)


def has_read(w: World) -> None:
    """Wait until the gateway has read its receipts, or has given that up: only then is it asked for one."""
    assert w.ask("GET", "/__hc/receipts/none").status in {404, 503}


def serve(w: World, ledger: Callable[[Call], None], epoch: int, *suspects: str) -> Core:
    """Another core is released."""
    core = w.core(epoch, ledger)
    w.feed.serve(core, incident="i1", suspects=suspects)
    return core
