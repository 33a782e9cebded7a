"""One real Chromium for all of these tests, a fresh profile for each of them, and a house to look at.

The browser is the machine's own (`scripts/browser` finds it); Playwright downloads nothing. Where there is none
the tests are skipped with the sentence that says how to get one, unless BROWSER_TESTS=required, as on the
machine that checks every change: there a missing browser is a failure.
"""

import os
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import pytest
from playwright.sync_api import Browser, BrowserContext, Page, expect, sync_playwright
from psutil import Process

from tests import leftovers, waiting
from tests.browser.scripted_pages import gateway, open_ledger  # noqa: F401 - fixtures, found by their names
from tests.browser.tabs import Watch
from tests.integration import houses
from tests.integration.house import House

ARGUMENTS: Final = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
LEAVING_S: Final = 5.0
#: What a page may take to show what is waited for, on a machine that does much else.
PATIENCE_MS: Final = 20_000

#: The house of the module whose tests are running, if they use one.
_standing: Final[list[House]] = []

MakeHouse = houses.MakeHouse
OpenTab = Callable[..., Page]

house = houses.house
new_house = houses.new_house


@pytest.fixture(scope="session")
def browser_path() -> str:
    """The machine's own browser."""
    found = subprocess.run(
        ["sh", str(Path(__file__).parents[2] / "scripts" / "browser")],
        capture_output=True,
        text=True,
        check=False,
    )
    if found.returncode:
        missing = pytest.fail if os.environ.get("BROWSER_TESTS") == "required" else pytest.skip
        missing(found.stderr.strip())
    return found.stdout.strip()


@pytest.fixture(scope="package")
def chromium(browser_path: str) -> Iterator[Browser]:
    """The browser, for the tests of this folder: while Playwright is there, no other test of this process can
    run an event loop of its own."""
    expect.set_options(timeout=PATIENCE_MS)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=browser_path, args=ARGUMENTS)
        yield browser
        browser.close()


@pytest.fixture
def scriptless(chromium: Browser, browser_path: str) -> Iterator[Browser]:
    """A browser that runs no scripts.

    Playwright's own switch comes after a page was read as one with scripts, noscript and all; this is the browser's.
    """
    without = [*ARGUMENTS, "--blink-settings=scriptEnabled=false"]
    browser = chromium.browser_type.launch(executable_path=browser_path, args=without)
    yield browser
    browser.close()


@pytest.fixture(autouse=True)
def nothing_is_left_behind(request: pytest.FixtureRequest, chromium: Browser) -> Iterator[None]:
    """As for all tests, but the browser's own processes and the house that a module shares stay. That house is not
    asked for here: a module that needs none is spared the start of one."""
    assert chromium.is_connected()
    folder = request.getfixturevalue("tmp_path") if "tmp_path" in request.fixturenames else None
    yield

    def left() -> set[Process]:
        found = leftovers.children() | (leftovers.at_work_in(folder) if folder else set())
        stays = {process for one in _standing for process in leftovers.at_work_in(one.data)}
        return {process for process in found - stays if not _is_the_browsers(process)}

    try:
        waiting.until(lambda: not left(), "everything the test started to end", LEAVING_S)
    except AssertionError:
        told = leftovers.end(left())
        pytest.fail("left running after the test: " + "; ".join(told), pytrace=False)


@pytest.fixture(scope="module")
def shared_house(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[House]:
    """The house of a module, with the module's own POLICY. Without one it has no spare: an outage can then be looked
    at, because the next core is one that a test can stop."""
    policy = getattr(request.module, "POLICY", {"spare": False})
    house = House(tmp_path_factory.mktemp("house") / "data", policy)
    _standing.append(house)
    try:
        yield house.up()
    finally:
        house.end()
        _standing.remove(house)


@pytest.fixture
def watch() -> Iterator[Watch]:
    """What the tabs of this test complain about; nothing, or the test fails."""
    watch = Watch()
    yield watch
    assert watch.troubles == []
    assert watch.dialogs == []


@pytest.fixture
def open_tab(chromium: Browser, watch: Watch) -> Iterator[OpenTab]:
    """Open tabs of a house, each in a profile of its own unless one is given; options are Playwright's.

    `of`: another browser than the usual one.
    """
    contexts: list[BrowserContext] = []

    def open_one(
        house: House,
        path: str = "/",
        *,
        lang: str = "en",
        beside: Page | None = None,
        of: Browser = chromium,
        **options: Any,
    ) -> Page:
        if beside is not None:
            page = beside.context.new_page()
        else:
            contexts.append(of.new_context(base_url=house.url, locale=lang, **options))
            contexts[-1].set_default_timeout(PATIENCE_MS)
            page = contexts[-1].new_page()
        watch.on(page)
        page.goto(path)
        return page

    yield open_one
    for context in contexts:
        context.close()


def _is_the_browsers(process: Process) -> bool:
    """Whether it is the browser, Playwright's driver, or one of theirs."""
    try:
        names = [process.name(), *(parent.name() for parent in process.parents())]
    except leftovers._GONE:
        return True  # it has ended
    return any(name.startswith(("chrom", "node", "google-chrome")) for name in names)
