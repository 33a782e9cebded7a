"""What a person at the page waits for: until it says that something is wrong, and until the overlay is gone.

A real Chromium has the page open; in it a loop looks once in every frame at what is shown, as an eye would, and
writes down the first frame with a sign and the first one without the overlay. The page's clock is tied to this
process's by asking it for its time between two looks at ours and keeping the tightest of many answers; the kill
is stamped right before the system call. An overlay is there only where an outage outlasts the first sign, so its
going is measured on outages whose next core is stopped as it starts, as on a machine without time for it, until
the overlay is there; the clock runs from the moment that the incident names as `ready`.
"""

import contextlib
import http.client
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Any

import psutil
from playwright.sync_api import Browser, Error, Page, Request, Response, sync_playwright

from bench.figures import Figure, Target
from bench.instance import Watched, fill
from examples.guarded import GuardError

SCRIPT = Path(__file__).parents[1] / "scripts" / "browser"
ARGUMENTS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
]
TRANSACTIONS = 40
SIGN_MS_MAX = 100
GONE_MS_MAX = 300
RECOVERY_KB_MAX = 20
FIRST_LOAD_KB_MAX = 100
PATIENCE_MS = 20_000
CLOCK_ASKED = 60
LOOK_EVERY_MS = 10
KB = 1000

#: Looks at every frame: is a sign shown, is the overlay shown, is the page said to be served.
_EYES = """() => {
  const shown = (selector) => [...document.querySelectorAll("*")].some(
    (host) => host.shadowRoot?.querySelector(selector));
  const eyes = window.eyes = { sign: null, overlay: null, gone: null };
  const now = () => performance.timeOrigin + performance.now();
  const look = () => {
    const overlay = shown("dialog[open]");
    if (eyes.sign === null && (overlay || shown(".strip:popover-open"))) eyes.sign = now();
    if (eyes.overlay === null && overlay) eyes.overlay = now();
    if (eyes.overlay !== null && eyes.gone === null && !overlay) eyes.gone = now();
    requestAnimationFrame(look);
  };
  look();
}"""


def measure(folder: Path, *, kills: int, slow_starts: int, reloads: int) -> list[Figure]:
    """Kill the core under an open page, reload into outages, and return what a person saw."""
    with Watched(folder / "page") as instance:
        fill(instance, TRANSACTIONS)
        with _chromium() as browser:
            load = [_first_load_kb(browser, instance.url) for _round in range(min(kills, 5))]
            page = _open(browser, instance.url)
            signs = [_first_sign_ms(page, instance) for _round in range(kills)]
            gone = [_overlay_gone_ms(page, instance) for _round in range(slow_starts)]
            waits, sizes = [], []
            for _round in range(reloads):
                waits.append(_reload_ms(page, instance))
                sizes.append(_recovery_page_kb(instance))
    return [
        Figure("kill -9 -> first sign in the open page", "ms", tuple(signs), None, Target(SIGN_MS_MAX)),
        Figure("core ready -> overlay gone (slow start)", "ms", tuple(gone), None, Target(GONE_MS_MAX)),
        Figure("F5 right after kill -STOP -> first byte", "ms", tuple(waits)),
        Figure("recovery page as sent, gzip", "kB", tuple(sizes), None, Target(RECOVERY_KB_MAX)),
        Figure("first load of /, all files, with heads", "kB", tuple(load), None, Target(FIRST_LOAD_KB_MAX)),
    ]


@contextmanager
def _chromium() -> Iterator[Browser]:
    found = subprocess.run(["sh", str(SCRIPT)], capture_output=True, text=True, check=False)
    if found.returncode:
        raise GuardError(found.stderr.strip())
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=found.stdout.strip(), args=ARGUMENTS)
        yield browser
        browser.close()


def _open(browser: Browser, url: str) -> Page:
    page = browser.new_context(locale="en-US").new_page()
    page.set_default_timeout(PATIENCE_MS)
    page.goto(url)
    _joined(page)
    return page


def _joined(page: Page) -> None:
    _until(page, "document.documentElement.dataset.hc === 'serving'")


def _until(page: Page, holds: str) -> None:
    """Ask the page until something holds; from outside, because its own policy forbids it to evaluate a text."""
    give_up_at = time.monotonic() + PATIENCE_MS / 1000
    while time.monotonic() < give_up_at:
        with contextlib.suppress(Error):  # the recovery page is just being left for the page behind it
            if page.evaluate(holds):
                return
        page.wait_for_timeout(LOOK_EVERY_MS)
    raise GuardError(f"The page did not come so far that {holds}.")


def _ahead_ms(page: Page) -> float:
    """How far the page's clock is ahead of our wall clock, by the tightest of many answers."""
    best = (float("inf"), 0.0)
    for _ in range(CLOCK_ASKED):
        before_ms = time.time_ns() / 1e6
        theirs_ms = page.evaluate("performance.timeOrigin + performance.now()")
        after_ms = time.time_ns() / 1e6
        best = min(best, (after_ms - before_ms, theirs_ms - (before_ms + after_ms) / 2))
    return best[1]


def _under(page: Page, instance: Watched, *, long: bool) -> tuple[float, float, dict[str, Any]]:
    """Kill the core; return when (wall, ms), how far the page's clock is ahead, and what its eyes saw.

    `long`: the next core may not start before the overlay is there.
    """
    instance.quiet()
    _joined(page)
    ahead_ms = _ahead_ms(page)
    page.evaluate(_EYES)
    core = instance.core()
    at_ms = time.time_ns() / 1e6
    core.hit(signal.SIGKILL)
    core.let_go()
    if long:
        with _slow_start(instance, core.pid):
            _until(page, "window.eyes.overlay !== null")
        _until(page, "window.eyes.gone !== null")
    _until(page, "window.eyes.sign !== null")
    _joined(page)
    saw: dict[str, Any] = page.evaluate("window.eyes")
    page.reload()  # its eyes are closed, and what is still said of this outage is gone
    return at_ms, ahead_ms, saw


@contextmanager
def _slow_start(instance: Watched, old: int) -> Iterator[None]:
    """Stop the core that follows on `old` as soon as it is there, until the block ends."""
    guard = psutil.Process(int(instance.status()["sentinel"]["pid"]))
    give_up_at = time.monotonic() + PATIENCE_MS / 1000
    while not (found := [child for child in guard.children() if child.pid != old and _is_core(child)]):
        if time.monotonic() > give_up_at:
            raise GuardError("No core follows on the one that was killed.")
    found[0].suspend()
    try:
        yield
    finally:
        found[0].resume()


def _is_core(process: psutil.Process) -> bool:
    with contextlib.suppress(psutil.Error):  # it may be gone by now
        return "core serve" in " ".join(process.cmdline())
    return False


def _first_sign_ms(page: Page, instance: Watched) -> float:
    at_ms, ahead_ms, saw = _under(page, instance, long=False)
    return float(saw["sign"]) - ahead_ms - at_ms


def _overlay_gone_ms(page: Page, instance: Watched) -> float:
    _at_ms, ahead_ms, saw = _under(page, instance, long=True)
    instance.quiet()
    return float(saw["gone"]) - ahead_ms - _ready_at_ms(instance)


def _ready_at_ms(instance: Watched) -> float:
    """When the last incident's core was ready, by the wall clock."""
    told = instance.hardcore("incidents", "show", str(instance.status()["last_incident"]))
    (at,) = [step["at"] for step in told["timeline"] if step["step"] == "ready"]
    return datetime.fromisoformat(at).timestamp() * 1000


def _reload_ms(page: Page, instance: Watched) -> float:
    """Freeze the core and press F5 at once; return how long the first byte took."""
    instance.quiet()
    core = instance.core()
    core.hit(signal.SIGSTOP)
    core.let_go()
    answer = page.reload()
    assert isinstance(answer, Response), "a reload has an answer"
    timing = answer.request.timing
    _joined(page)
    return float(timing["responseStart"] - timing["requestStart"])


def _recovery_page_kb(instance: Watched) -> float:
    """Ask as a browser would, in an outage; return the size of the recovery page as it was sent."""
    instance.quiet()
    core = instance.core()
    core.hit(signal.SIGKILL)
    core.let_go()
    heads = {
        "Accept": "text/html",
        "Accept-Encoding": "gzip",
        "Sec-Fetch-Mode": "navigate",
        "Sec-Fetch-Dest": "document",
    }
    with _slow_start(instance, core.pid):
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


def _first_load_kb(browser: Browser, url: str) -> float:
    """Everything a new visitor's browser is sent until the page is at rest."""
    context = browser.new_context(locale="ko-KR")
    page = context.new_page()
    asked: list[Request] = []

    def finished(request: Request) -> None:
        asked.append(request)

    page.on("requestfinished", finished)
    page.goto(url, wait_until="networkidle")
    sizes = [request.sizes() for request in asked]
    context.close()
    return sum(size["responseBodySize"] + size["responseHeadersSize"] for size in sizes) / KB
