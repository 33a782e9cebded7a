"""What a person sees and does on the ledger's pages, named once: where a page changes, one line here does too."""

import re
from typing import Any, Final

from playwright.sync_api import Locator, Page, expect

from tests.integration.house import House

BANK: Final = "assets:test:bank"


def a_bank(house: House, name: str = "Test bank") -> str:
    """An account to book on; a second time nothing changes. Returns its id."""
    body = {"id": BANK, "name": name, "type": "asset", "currency": "KRW"}
    answer = house.ask("POST", "/api/ledger/accounts", body, key=f"open-{BANK}")
    assert answer.status in {201, 422}, answer
    return BANK


def booked(house: House, what: str) -> int:
    """How many entries of this description are in the ledger."""
    answer = house.ask("GET", "/api/ledger/entries?limit=500")
    assert answer.status == 200, answer
    return sum(item["description"] == what for item in answer.body["items"])


def post_entry(house: House, what: str, amount: int = -1000) -> None:
    """Book an entry as another program would."""
    body = {
        "date": "2026-11-21",
        "amount": str(amount),
        "currency": "KRW",
        "account": BANK,
        "description": what,
    }
    answer = house.ask("POST", "/api/ledger/entries", body, key="key-" + what.replace(" ", "-"))
    assert answer.status == 201, answer


def write_entry(page: Page, what: str, amount: str = "12000") -> Locator:
    """Fill in the form of an entry on the page, and send nothing. Returns the form."""
    form = page.locator("form#entry")
    form.locator("[name=description]").fill(what)
    form.locator("[name=amount]").fill(amount)
    return form


def save(form: Locator) -> None:
    """Press the button that books."""
    form.locator("button.primary").click()


def is_saved(form: Locator) -> None:
    """Wait until the page says that it is booked: where it can be taken back, or, of an answer that was lost, below the form."""
    said = form.page.locator("#toast [data-undo]").or_(form.locator("[data-said].good"))
    expect(said).to_be_visible()


def send_now(form: Locator) -> None:
    """Send it as its button would, also where an overlay is already over it. Waits for nothing."""
    form.evaluate("form => form.requestSubmit()")


def overlay(page: Page) -> Locator:
    """The crisis overlay, open."""
    return page.locator("dialog[open]:has(#hc-head)")


def first_sign(page: Page) -> Locator:
    """The first thing a page says of an outage: the strip, or the overlay right away."""
    return page.locator(".strip:popover-open, dialog[open]:has(#hc-head)").first


def is_down(page: Page) -> None:
    """Wait until the page itself says that the server is away."""
    expect(page.locator("html")).to_have_attribute("data-hc", "down")


def is_serving(page: Page) -> None:
    """Wait until the page itself says that the server is there."""
    expect(page.locator("html")).to_have_attribute("data-hc", "serving")
    expect(overlay(page)).to_have_count(0)


def is_joined(page: Page) -> None:
    """Wait until the page has opened its channel to the gateway; before that it can be told nothing."""
    expect(page.locator("html")).to_have_attribute("data-hc", "serving")


def told(page: Page) -> str:
    """All that the overlay or the strip says now."""
    text = first_sign(page).inner_text()
    return re.sub(r"\s+", " ", text)


def answer_of(house: House, path: str) -> Any:
    """What the API says."""
    answer = house.ask("GET", path)
    assert answer.status == 200, answer
    return answer.body
