"""What stands on a person's screen in an outage, and when; and what the ledger's pages weigh in peace.

A real Chromium has the page open (`eyes`). The core is killed from outside. An overlay is there only where an outage
outlasts the first sign, so those are made to last: the next core is stopped by the kernel as it starts, as on a
machine without time for it. Times begin where the promise does: at the moment in which the guard learned of the end,
by its own log, which is before the gateway was told; or in which the incident calls the next core `ready`. Nothing is
known of earlier outages in the first houses, so that the overlay keeps its usual distance; the second one remembers
outages of seconds, where the first sign is the overlay.
"""

import contextlib
import http.client
import json
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path

import psutil
from playwright.sync_api import Browser, Page, Response

from bench.eyes import (
    KB,
    PATIENCE_MS,
    Loaded,
    ahead_ms,
    chromium,
    joined,
    open_eyes,
    open_page,
    seen,
    until,
    visit,
)
from bench.figures import Figure, Target
from bench.instance import TRANSACTIONS as BOOK
from bench.instance import Watched, fill, transaction
from examples.guarded import GuardError, Held

TRANSACTIONS = 40
ALONE = {"spare": False}
#: Outages that a house may see until it knows how long they last.
UNKNOWING = 4
#: What the second house remembers: outages of two seconds, more than are needed for an estimate.
REMEMBERED = [{"total_ms": 2_000, "reached_ms": [0, 5, 10, 1_900], "way": "cold"}] * 20
LASTS_S = 1.6
HELD_AT = "/register?q=kimchi"
PHONE = {"width": 390, "height": 844}
HOLD_MS = 400

SPARED_MS = Target(100)
SIGN_MS = Target(50)
OVERLAY_MS = Target(450)
AT_ONCE_MS = Target(100)
GONE_MS = Target(300)
FIRST_BYTE_MS = Target(50)
REOPENED_MS = Target(500)
ANSWERED_MS = Target(300)
RECOVERY_KB = Target(20)
FIRST_LOAD_KB = Target(100)
NO_SHIFT = Target(0)


class Moments:
    """What was seen in rounds, by name."""

    def __init__(self) -> None:
        self.of: dict[str, list[float]] = {}

    def note(self, name: str, value: float) -> None:
        """One more."""
        self.of.setdefault(name, []).append(value)

    def figure(self, name: str, words: str, unit: str, target: Target | None = None) -> Figure:
        """All of one name."""
        return Figure(words, unit, tuple(self.of[name]), target=target)


def measure(folder: Path, *, rounds: int, visits: int) -> list[Figure]:
    """Look at so many outages of each kind, and at so many first visits."""
    found = Moments()
    with chromium() as browser:
        _spared(folder, browser, rounds, found)
        _unknown(folder, browser, rounds, found)
        _known_to_last(folder, browser, rounds, visits, found)
    moments = [
        ("spared", "kill -9, a spare behind it -> first sign", SPARED_MS),
        ("sign", "guard knows -> first sign (cold start)", SIGN_MS),
        ("overlay", "guard knows -> overlay, no history", OVERLAY_MS),
        ("at_once", "guard knows -> overlay, known to last", AT_ONCE_MS),
        ("gone", "core ready -> overlay gone", GONE_MS),
        ("byte", f"F5 in an outage: first byte after the {HOLD_MS} ms", FIRST_BYTE_MS),
        ("reopened", "core ready -> the page behind the F5 painted", REOPENED_MS),
        ("answered", "core ready -> held POST answered", ANSWERED_MS),
    ]
    return [
        *(found.figure(name, words, "ms", target) for name, words, target in moments),
        found.figure("shifts", "the open page over an outage: layout shift", "", NO_SHIFT),
        found.figure("page_kb", "recovery page as sent, gzip", "kB", RECOVERY_KB),
        found.figure("kb", "first load of /, all files, with heads", "kB", FIRST_LOAD_KB),
        found.figure("kb_most", "the heaviest of the other pages", "kB", FIRST_LOAD_KB),
        found.figure("first", "/: first contentful paint", "ms"),
        found.figure("largest", "/: largest contentful paint", "ms"),
        found.figure("longest", "/: longest task of the page", "ms"),
        found.figure("moved", "any first load: layout shift", "", NO_SHIFT),
    ]


# -- outages -------------------------------------------------------------------------------------------


def _spared(folder: Path, browser: Browser, rounds: int, found: Moments) -> None:
    """Kills with a spare behind the core: over before anybody could say more than that it happened."""
    with Watched(folder / "spared") as instance:
        fill(instance, TRANSACTIONS)
        page = open_page(browser, instance.url)
        for _ in range(rounds):
            instance.quiet()
            ahead = _look(page)
            with _killed(instance) as at_ns:
                pass
            until(page, "window.eyes.sign !== null")
            joined(page)
            found.note("spared", seen(page)["sign"] - ahead - _wall_ms(at_ns))
            page.reload()  # its eyes are closed, and what is still said of this outage is gone
        page.context.close()


def _unknown(folder: Path, browser: Browser, rounds: int, found: Moments) -> None:
    """Cold starts of a house that does not know yet how long they take."""
    for first in range(0, rounds, UNKNOWING):
        with Watched(folder / f"unknown-{first}", ALONE) as instance:
            fill(instance, TRANSACTIONS)
            page = open_page(browser, instance.url)
            for _ in range(min(UNKNOWING, rounds - first)):
                instance.quiet()
                ahead = _look(page)
                with _slow_outage(instance):
                    until(page, "window.eyes.overlay !== null")
                _over(page, instance)
                saw, known_ms = seen(page), _wall_ms(instance.last_exit_ns())
                for name in ("sign", "overlay"):
                    found.note(name, saw[name] - ahead - known_ms)
                found.note("gone", saw["gone"] - ahead - _ready_at_ms(instance))
                found.note("shifts", saw["shifts"])
                page.reload()
            page.context.close()


def _known_to_last(folder: Path, browser: Browser, rounds: int, visits: int, found: Moments) -> None:
    """Outages that are known to last: one page is open, one is loaded anew meanwhile, and one request waits."""
    state = folder / "lasting" / "state"
    state.mkdir(parents=True)
    (state / "recoveries.json").write_text(json.dumps({"recoveries": REMEMBERED}))
    with Watched(folder / "lasting", ALONE) as instance:
        fill(instance, TRANSACTIONS)
        for _ in range(visits):
            _visits(browser, instance.url, found)
        page, other = (open_page(browser, instance.url + path) for path in ("", HELD_AT))
        for number in range(rounds):
            instance.quiet()
            ahead = _look(page)
            joined(other)
            with _slow_outage(instance):
                ends_at = time.monotonic() + LASTS_S
                found.note("page_kb", _recovery_page_kb(instance))
                post = _Waiting(instance, f"held-{number}")
                found.note("byte", _reload_ms(other) - HOLD_MS)
                until(page, "window.eyes.overlay !== null")
                page.wait_for_timeout(max(0.0, ends_at - time.monotonic()) * 1000)
            painted_ms = _painted_ms(other, HELD_AT)
            _over(page, instance)
            ready_ms = _ready_at_ms(instance)
            found.note("at_once", seen(page)["overlay"] - ahead - _wall_ms(instance.last_exit_ns()))
            found.note("reopened", painted_ms - ready_ms)
            found.note("answered", post.answered_ms() - ready_ms)
            page.reload()


def _look(page: Page) -> float:
    """Open the page's eyes; return how far its clock is ahead."""
    joined(page)
    ahead = ahead_ms(page)
    open_eyes(page)
    return ahead


@contextmanager
def _killed(instance: Watched) -> Iterator[int]:
    """Kill the core; gives the moment before."""
    core = instance.core()
    at_ns = core.hit(signal.SIGKILL)
    core.let_go()
    yield at_ns


@contextmanager
def _slow_outage(instance: Watched) -> Iterator[None]:
    """Kill the core, and stop the one that follows as soon as it is there, until the block ends."""
    core = instance.core()
    core.hit(signal.SIGKILL)
    successor = _successor(instance, core)
    core.let_go()
    successor.suspend()
    try:
        yield
    finally:
        successor.resume()


def _successor(instance: Watched, old: Held) -> psutil.Process:
    guard = psutil.Process(int(instance.status()["sentinel"]["pid"]))
    give_up_at = time.monotonic() + PATIENCE_MS / 1000
    while not (found := [child for child in guard.children() if child.pid != old.pid and _is_core(child)]):
        if time.monotonic() > give_up_at:
            raise GuardError("No core follows on the one that was killed.")
    return found[0]


def _is_core(process: psutil.Process) -> bool:
    with contextlib.suppress(psutil.Error):  # it may be gone by now
        return "core serve" in " ".join(process.cmdline())
    return False


def _over(page: Page, instance: Watched) -> None:
    until(page, "window.eyes.gone !== null")
    joined(page)
    instance.quiet()


def _wall_ms(monotonic_ns: int) -> float:
    """A moment of the monotonic clock by the wall clock."""
    return (time.time_ns() - time.monotonic_ns() + monotonic_ns) / 1e6


def _ready_at_ms(instance: Watched) -> float:
    """When the last incident's core was ready, by the wall clock."""
    told = instance.hardcore("incidents", "show", str(instance.status()["last_incident"]))
    (at,) = [step["at"] for step in told["timeline"] if step["step"] == "ready"]
    return datetime.fromisoformat(at).timestamp() * 1000


# -- who comes meanwhile -------------------------------------------------------------------------------


class _Waiting:
    """An entry that is sent into an outage, and waits at the gateway for its answer."""

    def __init__(self, instance: Watched, key: str) -> None:
        self._instance = instance
        self._key = key
        self._done_ns = 0
        self._status = 0
        self._thread = threading.Thread(target=self._send)
        self._thread.start()

    def _send(self) -> None:
        connection = http.client.HTTPConnection(*self._instance.address, timeout=PATIENCE_MS / 1000)
        heads = {"Content-Type": "application/json", "Idempotency-Key": self._key}
        connection.request("POST", BOOK, json.dumps(transaction(self._key)), heads)
        answer = connection.getresponse()
        self._done_ns = time.time_ns()
        self._status = answer.status
        connection.close()

    def answered_ms(self) -> float:
        """When its answer began, by the wall clock. Raises GuardError where it was none."""
        self._thread.join(PATIENCE_MS / 1000)
        if self._status != 201:
            raise GuardError(f"A held entry was answered {self._status or 'by nobody'}.")
        return self._done_ns / 1e6


def _reload_ms(page: Page) -> float:
    """Press F5 in an outage; return how long the first byte of the recovery page took."""
    answer = page.reload()
    assert isinstance(answer, Response), "a reload has an answer"
    if answer.status != 503:
        raise GuardError(f"A page that was loaded anew in an outage was answered {answer.status}.")
    timing = answer.request.timing
    return float(timing["responseStart"] - timing["requestStart"])


def _painted_ms(page: Page, path: str) -> float:
    """When the address that the recovery page stood on was painted as itself again, by the wall clock."""
    joined(page)
    if not page.url.endswith(path):
        raise GuardError(f"The recovery page led to {page.url} and not back to {path}.")
    painted = "performance.getEntriesByName('first-contentful-paint')[0]?.startTime"
    until(page, f"{painted} > 0")
    at_ms = float(page.evaluate(f"performance.timeOrigin + {painted}"))
    return at_ms - ahead_ms(page)


def _recovery_page_kb(instance: Watched) -> float:
    """Ask as a browser would, in an outage; return the size of the recovery page as it was sent."""
    heads = {
        "Accept": "text/html",
        "Accept-Encoding": "gzip",
        "Sec-Fetch-Mode": "navigate",
        "Sec-Fetch-Dest": "document",
    }
    connection = http.client.HTTPConnection(*instance.address, timeout=PATIENCE_MS / 1000)
    connection.request("GET", "/", headers=heads)
    answer = connection.getresponse()
    size = len(answer.read())
    connection.close()
    if answer.status != 503:
        raise GuardError(
            f"A navigation into an outage was answered {answer.status}, not with the recovery page."
        )
    return size / KB


# -- in peace ------------------------------------------------------------------------------------------


def _visits(browser: Browser, url: str, found: Moments) -> None:
    """A first visit of each page, the overview also on a phone."""
    home = visit(browser, url)
    for name, value in (
        ("kb", home.kb), ("first", home.first_ms), ("largest", home.largest_ms), ("longest", home.longest_ms),
    ):  # fmt: skip
        found.note(name, value)
    others: list[Loaded] = [visit(browser, url + path) for path in ("/register", "/accounts", "/import")]
    found.note("kb_most", max(one.kb for one in others))
    others.append(visit(browser, url, viewport=PHONE))
    found.note("moved", max(one.shifts for one in (home, *others)))
