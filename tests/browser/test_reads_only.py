"""A server that takes no changes for now, as a page shows it: nothing covered, nothing lost, nothing sent by itself."""

from typing import Any

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from frontend.catalogue_crisis import CRISIS
from frontend.catalogue_pages import TEXTS
from tests.browser.conftest import OpenTab
from tests.browser.readers import a_bank, booked, is_joined, overlay, save, write_entry
from tests.browser.scripted_gateway import SERVING, ScriptedGateway, back, down
from tests.browser.scripted_pages import OpenLedger, marks, shows
from tests.integration.house import House

SAFE = {**SERVING, "state": "SAFE_MODE"}


def safe(why: str, **fields: Any) -> dict[str, Any]:
    """A state frame of a core that serves reads only."""
    return {**SAFE, "safe": why, **fields}


def bar(page: Page) -> Locator:
    """The bar at the head of the page."""
    return page.locator(".bar")


@pytest.mark.parametrize(("lang", "which"), [("ko", 0), ("en", 1)])
@pytest.mark.parametrize("why", ["DISK_FULL", "DISK_READ_ONLY", "DISK_STALLED"])
def test_the_bar_says_why_nothing_can_be_changed_and_goes_away_by_itself(
    open_ledger: OpenLedger, gateway: ScriptedGateway, lang: str, which: int, why: str
) -> None:
    page = open_ledger(f"/{lang}")
    gateway.say(safe(why))
    for code in ("R9", f"R9.{why}", "R9.line"):
        expect(bar(page)).to_contain_text(CRISIS[code][which])
    marks(page, "safe")
    assert page.title() == "Ledger"
    assert overlay(page).count() == 0
    gateway.say(SERVING)
    expect(bar(page)).to_have_count(0)
    marks(page, "serving")


@pytest.mark.parametrize("width", [390, 1280])
def test_the_bar_takes_its_own_room_and_covers_nothing(
    open_ledger: OpenLedger, gateway: ScriptedGateway, width: int
) -> None:
    page = open_ledger("/ko", viewport={"width": width, "height": 800})
    page.locator("[name=what]").first.fill("typed")
    gateway.say(safe("DISK_READ_ONLY"))
    expect(bar(page)).to_be_visible()
    margin = 8  # the page of these tests has the browser's own
    shown, head = bar(page).bounding_box(), page.locator("h1").bounding_box()
    assert shown is not None
    assert head is not None
    assert (shown["x"], shown["y"], shown["width"]) == (margin, margin, width - 2 * margin)
    assert shown["y"] + shown["height"] <= head["y"]
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    assert page.locator("[name=what]").first.input_value() == "typed"


@pytest.mark.parametrize("frame", [safe("STORE_CORRUPT"), safe("STORE_CORRUPT", sound=False)])
def test_a_damaged_ledger_is_named_as_such_and_nothing_is_said_of_what_can_be_seen(
    open_ledger: OpenLedger, gateway: ScriptedGateway, frame: dict[str, Any]
) -> None:
    page = open_ledger()
    gateway.say(frame)
    for code in ("R10", "R10.safe", "R10.line"):
        expect(bar(page)).to_contain_text(CRISIS[code][1])
    assert CRISIS["R9.line"][1] not in bar(page).inner_text()
    assert page.locator(".corner:popover-open").count() == 0


def test_a_reason_that_this_script_does_not_know_is_not_made_up(
    open_ledger: OpenLedger, gateway: ScriptedGateway
) -> None:
    page = open_ledger()
    gateway.say(safe("SOMETHING_NEW"))
    expect(bar(page)).to_contain_text(f"{CRISIS['R9'][1]} {CRISIS['R9.line'][1]}")


def test_in_an_outage_the_outage_is_told_and_reading_only_again_after_it(
    open_ledger: OpenLedger, gateway: ScriptedGateway
) -> None:
    page = open_ledger()
    gateway.say(safe("DISK_FULL"))
    expect(bar(page)).to_be_visible()
    gateway.say(down(safe="DISK_FULL"))
    shows(page, "Restarting the server")
    expect(bar(page)).to_have_count(0)
    gateway.say(back(300))
    gateway.say(safe("DISK_FULL"))
    expect(bar(page)).to_be_visible()
    marks(page, "safe")


def test_a_screen_reader_hears_it_once(open_ledger: OpenLedger, gateway: ScriptedGateway) -> None:
    page = open_ledger()
    gateway.say(safe("DISK_FULL"))
    expect(page.locator("[role=status]").first).to_contain_text(CRISIS["R9.DISK_FULL"][1])


def test_an_entry_that_was_refused_stays_typed_and_is_sent_once_when_a_person_presses_again(
    house: House, open_tab: OpenTab
) -> None:
    a_bank(house)
    page = open_tab(house)
    is_joined(page)
    form = write_entry(page, "Typed on a full disk", "12000")
    house.running()
    assert house.order("drill", fault="diskfull", yes=True)["ok"]
    expect(bar(page)).to_be_visible()
    marks(page, "safe")
    save(form)
    expect(form.locator("[data-said]")).to_contain_text("disk that holds the ledger is full")
    expect(form.locator("[data-said]")).to_contain_text(TEXTS["safe_kept"]["en"])
    assert form.locator("[name=description]").input_value() == "Typed on a full disk"
    key = form.locator("[name=_idempotency_key]").input_value()
    expect(bar(page)).to_have_count(0)
    expect(form.locator("[data-said]")).to_have_text(TEXTS["safe_over"]["en"])
    assert booked(house, "Typed on a full disk") == 0
    assert form.locator("[name=_idempotency_key]").input_value() == key
    save(form)
    expect(page.locator("[data-live]").get_by_text("Typed on a full disk").first).to_be_visible()
    assert booked(house, "Typed on a full disk") == 1
    house.running()


def test_without_scripts_the_page_says_it_and_the_form_comes_back_with_what_was_typed(
    house: House, open_tab: OpenTab, scriptless: Browser
) -> None:
    a_bank(house)
    page = open_tab(house, of=scriptless)
    form = write_entry(page, "Typed without scripts", "3000")
    house.running()
    assert house.order("drill", fault="diskfull", yes=True)["ok"]
    house.until(lambda status: status["safe"] == "DISK_FULL", "the core to read only")
    save(form)
    expect(page.locator(".readonly")).to_contain_text("disk that holds the ledger is full")
    expect(page.locator("form#entry [data-said]")).to_contain_text(TEXTS["safe_kept"]["en"])
    assert page.locator("form#entry [name=description]").input_value() == "Typed without scripts"
    house.until(lambda status: status["safe"] is None, "the core to take changes again")
    save(page.locator("form#entry"))
    expect(page.locator(".readonly")).to_have_count(0)
    assert booked(house, "Typed without scripts") == 1
    house.running()
