"""The scripts of the ledger's own pages, where only a browser can say whether they are right."""

import json
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Request, Route, expect

from tests.browser.conftest import OpenTab
from tests.browser.outages import outage
from tests.browser.readers import a_bank, booked, is_down, is_joined, is_saved, is_serving, save, write_entry
from tests.browser.tabs import Watch
from tests.integration.house import House

ROOT = Path(__file__).parents[2]
LOST = 45
AMOUNTS = (ROOT / "frontend" / "static" / "amounts.js").read_text()
CASES = json.loads((ROOT / "tests" / "unit" / "frontend" / "amount_cases.json").read_text())


def test_the_browser_reads_and_groups_amounts_exactly_as_the_server_does(chromium: Browser) -> None:
    page = chromium.new_page()
    told = page.evaluate(
        """async ([source, cases]) => {
            const amounts = await import(URL.createObjectURL(new Blob([source], {type: "text/javascript"})));
            return {
                read: cases.read.map(([typed]) => [typed, amounts.readAmount(typed)]),
                group: cases.group.map(([plain]) => [plain, amounts.groupAmount(plain)]),
            };
        }""",
        [AMOUNTS, CASES],
    )
    page.close()
    assert told == CASES


def test_digits_are_grouped_under_the_caret(house: House, open_tab: OpenTab) -> None:
    a_bank(house)
    page = open_tab(house)
    amount = page.locator("form#entry [name=amount]")
    amount.press_sequentially("1234567")
    assert amount.input_value() == "1,234,567"
    for _ in range(3):
        amount.press("ArrowLeft")
    amount.press_sequentially("89")
    assert amount.input_value() == "123,489,567"


def test_the_same_text_sent_again_after_a_reload_in_an_outage_is_one_entry(
    house: House, open_tab: OpenTab
) -> None:
    a_bank(house)
    page = open_tab(house)
    is_joined(page)
    with outage(house):
        is_down(page)
        # The form's own way of sending, as the overlay is over it: the wish waits for the server.
        form = write_entry(page, "Sent twice", "7000")
        form.evaluate("form => form.requestSubmit()")
        expect(page.locator("html")).to_have_attribute("data-hc", "down")
        page.reload()
    is_serving(page)
    form = write_entry(page, "Sent twice", "7000")
    save(form)
    is_saved(form)
    assert booked(house, "Sent twice") == 1


def forgive(watch: Watch, *meant: str) -> None:
    """Take what a test has brought about itself from what a tab complained about."""
    watch.troubles = [one for one in watch.troubles if not any(text in one for text in meant)]


@pytest.mark.parametrize("storage", [True, False], ids=["storage", "none"])
def test_a_corrected_text_is_another_wish_and_is_sent_only_if_the_first_was_not_saved_after_all(
    house: House, open_tab: OpenTab, watch: Watch, *, storage: bool
) -> None:
    a_bank(house)
    page = open_tab(house)
    is_joined(page)
    if not storage:
        page.evaluate(
            "() => { Storage.prototype.setItem = Storage.prototype.getItem = () => { throw new Error(); }; }"
        )
    keys: list[str] = []

    def saved_without_a_word(route: Route, request: Request) -> None:
        keys.append(request.headers["idempotency-key"])
        answer = route.fetch()
        if len(keys) == 1:
            route.fulfill(status=500, json={"detail": "Something broke."})
        else:
            route.fulfill(response=answer)

    page.route("**/entries", saved_without_a_word)
    name = f"Corrected {storage}"
    form = write_entry(page, name, "7000")
    said = form.locator("[data-said]")
    save(form)
    expect(said).to_have_text("Something broke.")
    form.locator("[name=amount]").fill("7100")
    save(form)
    expect(said).to_contain_text("What you sent before was saved after all.")
    assert (len(keys), booked(house, name)) == (1, 1)
    save(form)
    is_saved(form)
    assert len(set(keys)) == 2
    assert booked(house, name) == 2
    forgive(watch, "status of 500")


def test_what_is_corrected_after_a_fault_goes_out_under_a_key_of_its_own(
    house: House, open_tab: OpenTab, watch: Watch
) -> None:
    a_bank(house)
    page = open_tab(house)
    is_joined(page)
    keys: list[str] = []

    def broken_at_first(route: Route, request: Request) -> None:
        keys.append(request.headers["idempotency-key"])
        if len(keys) == 1:
            route.fulfill(status=500, json={"detail": "Something broke."})
        else:
            route.continue_()

    page.route("**/entries", broken_at_first)
    form = write_entry(page, "Fault", "7000")
    save(form)
    expect(form.locator("[data-said]")).to_have_text("Something broke.")
    form.locator("[name=amount]").fill("7100")
    save(form)
    is_saved(form)
    assert len(set(keys)) == 2
    assert booked(house, "Fault") == 1
    forgive(watch, "status of 500", "/api/ledger/commands/")  # asked for in vain: it was not done


def test_a_wish_is_never_given_up_while_its_page_is_open(house: House, open_tab: OpenTab) -> None:
    a_bank(house)
    page = open_tab(house)
    is_joined(page)
    tries: list[Route] = []

    def lost_at_first(route: Route) -> None:
        tries.append(route)
        if len(tries) <= LOST:
            route.abort()
        else:
            route.continue_()

    page.route("**/entries", lost_at_first)
    form = write_entry(page, "Tried often", "7000")
    save(form)
    while len(tries) <= LOST:  # each time the page hears that the server is back, it asks again at once
        page.evaluate("document.dispatchEvent(new CustomEvent('hc:back', {detail: {}}))")
    is_saved(form)
    assert booked(house, "Tried often") == 1


def test_the_browser_asks_before_a_page_with_a_waiting_wish_is_left_and_only_then(
    house: House, open_tab: OpenTab, watch: Watch
) -> None:
    a_bank(house)
    page = open_tab(house)
    is_joined(page)
    form = write_entry(page, "Not left alone", "7000")
    page.mouse.click(5, 400)  # a browser asks only where somebody has used the page
    page.reload()
    assert watch.leaving == 0
    is_joined(page)
    form = write_entry(page, "Not left alone", "7000")
    with outage(house):
        is_down(page)
        page.mouse.click(5, 400)
        form.evaluate("form => form.requestSubmit()")
        expect(form.locator("[data-said]")).to_contain_text("Keep this window open")
        page.reload()
        assert watch.leaving == 1
    is_serving(page)
    form = write_entry(page, "Not left alone", "7000")
    save(form)
    is_saved(form)
    page.reload()
    assert watch.leaving == 1
    assert booked(house, "Not left alone") == 1
