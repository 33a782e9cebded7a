"""A real Chromium with eyes: what stands on its screen, frame by frame, told in this process's time.

In the page a loop looks once in every frame at what is shown, as an eye would, and writes down the first frame with
a sign, with the overlay, and without it again. The page's clock is tied to this process's by asking it for its time
between two looks at ours and keeping the tightest of many answers. Recording the screen as a film was not chosen:
the film's own work would be the slowest part of what it shows.
"""

import contextlib
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec
from playwright.sync_api import Browser, Error, Page, Request, sync_playwright

from examples.guarded import GuardError

SCRIPT = Path(__file__).parents[1] / "scripts" / "browser"
ARGUMENTS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
]
PATIENCE_MS = 20_000
CLOCK_ASKED = 60
LOOK_EVERY_MS = 10
KB = 1000

#: Looks at every frame: is a sign shown, is the overlay shown; `shifts` is how far the page beneath moved by itself,
#: of which our own strip and card, in their shadow roots, are no part.
_EYES = """() => {
  const shown = (selector) => [...document.querySelectorAll("*")].some(
    (host) => host.shadowRoot?.querySelector(selector));
  const eyes = window.eyes = { sign: null, overlay: null, gone: null, shifts: 0 };
  const isOfPage = ({ sources }) => sources.some(({ node }) => node !== null);
  new PerformanceObserver((list) => list.getEntries().filter(isOfPage).forEach((one) => { eyes.shifts += one.value; }))
    .observe({ type: "layout-shift" });
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
#: From a page's first moment: what was painted and when, what moved by itself, what kept everything else waiting.
_METER = """() => {
  const meter = window.meter = { first: null, largest: null, shifts: 0, longest: 0 };
  const on = (type, note) => new PerformanceObserver((list) => list.getEntries().forEach(note))
    .observe({ type, buffered: true });
  on("paint", (one) => { if (one.name === "first-contentful-paint") meter.first = one.startTime; });
  on("largest-contentful-paint", (one) => { meter.largest = one.startTime; });
  on("layout-shift", (one) => { meter.shifts += one.value; });
  on("longtask", (one) => { meter.longest = Math.max(meter.longest, one.duration); });
}"""


class Loaded(msgspec.Struct, frozen=True):
    """A first visit: bytes as sent with their heads, when something could be seen, what moved, what held it up."""

    kb: float
    requests: int
    first_ms: float
    largest_ms: float
    shifts: float
    longest_ms: float


@contextmanager
def chromium() -> Iterator[Browser]:
    """The machine's own browser. Raises GuardError where there is none."""
    found = subprocess.run(["sh", str(SCRIPT)], capture_output=True, text=True, check=False)
    if found.returncode:
        raise GuardError(found.stderr.strip())
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=found.stdout.strip(), args=ARGUMENTS)
        yield browser
        browser.close()


def open_page(browser: Browser, url: str) -> Page:
    """A page that listens to the gateway, in a profile of its own."""
    page = browser.new_context(locale="en-US").new_page()
    page.set_default_timeout(PATIENCE_MS)
    page.goto(url)
    joined(page)
    return page


def joined(page: Page) -> None:
    """Wait until the page says that it is served."""
    until(page, "document.documentElement.dataset.hc === 'serving'")


def until(page: Page, holds: str) -> None:
    """Ask the page until something holds; from outside, because its own policy forbids it to evaluate a text."""
    give_up_at = time.monotonic() + PATIENCE_MS / 1000
    while time.monotonic() < give_up_at:
        with contextlib.suppress(Error):  # the recovery page is just being left for the page behind it
            if page.evaluate(holds):
                return
        page.wait_for_timeout(LOOK_EVERY_MS)
    raise GuardError(f"The page did not come so far that {holds}.")


def ahead_ms(page: Page) -> float:
    """How far the page's clock is ahead of our wall clock, by the tightest of many answers."""
    best = (float("inf"), 0.0)
    for _ in range(CLOCK_ASKED):
        before_ms = time.time_ns() / 1e6
        theirs_ms = page.evaluate("performance.timeOrigin + performance.now()")
        after_ms = time.time_ns() / 1e6
        best = min(best, (after_ms - before_ms, theirs_ms - (before_ms + after_ms) / 2))
    return best[1]


def open_eyes(page: Page) -> None:
    """Look at every frame from now on; a reload closes the eyes."""
    page.evaluate(_EYES)


def seen(page: Page) -> dict[str, Any]:
    """What the eyes saw so far, by the page's clock."""
    saw: dict[str, Any] = page.evaluate("window.eyes")
    return saw


def visit(browser: Browser, url: str, **options: Any) -> Loaded:
    """Everything that a new visitor's browser is sent until the page is at rest, and how it came onto the screen."""
    context = browser.new_context(locale="ko-KR", **options)
    context.add_init_script(f"({_METER})()")
    page = context.new_page()
    asked: list[Request] = []

    def finished(request: Request) -> None:
        asked.append(request)

    page.on("requestfinished", finished)
    page.goto(url, wait_until="networkidle")
    sizes = [request.sizes() for request in asked]
    meter = page.evaluate("window.meter")
    context.close()
    total = sum(size["responseBodySize"] + size["responseHeadersSize"] for size in sizes)
    return Loaded(total / KB, len(sizes), meter["first"], meter["largest"], meter["shifts"], meter["longest"])
