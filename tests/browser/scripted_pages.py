"""A page of a scripted gateway: what the tests of the crisis script open, and how they look at it."""

from collections.abc import Callable, Iterator
from typing import Any, Final

import pytest
from playwright.sync_api import Browser, BrowserContext, Locator, Page, expect

from tests import waiting
from tests.browser.scripted_gateway import SERVING, ScriptedGateway
from tests.browser.tabs import Watch

PAGE: Final = """<!doctype html><html lang="{lang}"><head><meta charset="utf-8"><title>Ledger</title>
<link rel="icon" href="data:,"></head><body><h1>October</h1>
<form id="entry" data-hc-draft>
<input name="what"><input name="amount" value="0"><input name="secret" type="password">
<input name="code" autocomplete="one-time-code"><input name="mine" data-hc-nodraft>
<textarea name="memo"></textarea><button>Save</button></form>
<form id="other" data-hc-draft><input name="what"></form>
<input id="loose"><dialog id="own"><input id="inside"></dialog>
{lines}</body></html>"""
PATIENCE_MS: Final = 10_000

OpenLedger = Callable[..., Page]


@pytest.fixture
def gateway() -> Iterator[ScriptedGateway]:
    """A scripted gateway with the same page in both languages."""
    lines = "<p>a line</p>" * 80
    pages = {f"/{lang}": PAGE.format(lang=lang, lines=lines) for lang in ("ko", "en")}
    with ScriptedGateway(pages) as gateway:
        yield gateway


@pytest.fixture
def open_ledger(chromium: Browser, watch: Watch, gateway: ScriptedGateway) -> Iterator[OpenLedger]:
    """Open that page, each in a profile of its own; options are Playwright's."""
    contexts: list[BrowserContext] = []

    def open_one(path: str = "/en", **options: Any) -> Page:
        contexts.append(chromium.new_context(base_url=gateway.url, **options))
        contexts[-1].set_default_timeout(PATIENCE_MS)
        page = contexts[-1].new_page()
        watch.on(page)
        page.goto(path)
        if gateway.recovering is None:
            marks(page, "serving")
        waiting.until(lambda: gateway.refuses_sockets or gateway.listeners > 0, "the page to listen")
        return page

    yield open_one
    for context in contexts:
        context.close()


def shows(page: Page, text: str) -> None:
    """Wait until a text can be seen somewhere on the page."""
    expect(page.get_by_text(text, exact=False).locator("visible=true").first).to_be_visible()


def overlay(page: Page) -> Locator:
    """The overlay of the crisis script, while it is modal."""
    return page.locator("dialog:modal:not(#own)")


def is_over(gateway: ScriptedGateway, frame: dict[str, Any]) -> None:
    """Say that a core serves again."""
    gateway.say(frame)
    gateway.say(SERVING)


def marks(page: Page, mark: str) -> None:
    """Wait until the page's own mark says so."""
    expect(page.locator("html")).to_have_attribute("data-hc", mark)
