"""The ledger's pages as a person uses them, in both languages."""

from typing import Final

import pytest
from playwright.sync_api import Browser, expect

from tests.browser.conftest import MakeHouse, OpenTab
from tests.browser.readers import a_bank, answer_of, booked, is_joined, post_entry, save, write_entry
from tests.integration.house import House

HOSTILE = "<script>alert(1)</script><img src=x onerror=alert(2)>\"'><b>굵게</b>"


@pytest.mark.parametrize(
    ("lang", "empty", "accounts"), [("ko-KR", "비어 있어요", "계좌"), ("en-US", "nothing here", "Accounts")]
)
def test_an_empty_ledger_teaches_and_opens_example_accounts_in_the_readers_language(
    new_house: MakeHouse, open_tab: OpenTab, lang: str, empty: str, accounts: str
) -> None:
    house = new_house().up()
    page = open_tab(house, lang=lang)
    assert page.locator("html").get_attribute("lang") == lang[:2]
    assert empty in page.locator("h1").inner_text().lower()
    page.locator("form[action='/start'] button").click()
    expect(page.locator("form#entry")).to_be_visible()
    opened = answer_of(house, "/api/ledger/accounts?limit=500")["items"]
    assert len(opened) >= 3
    page.locator("nav a[href='/accounts']").click()
    expect(page.locator("h1")).to_have_text(accounts)
    for account in opened:
        if account["type"] in {"asset", "liability"}:
            expect(page.get_by_text(account["name"], exact=True).first).to_be_visible()


def test_the_language_can_be_changed_on_the_page_and_stays_changed(house: House, open_tab: OpenTab) -> None:
    page = open_tab(house, lang="en-US")
    page.locator("button[name=lang][value=ko]").click()
    expect(page.locator("html")).to_have_attribute("lang", "ko")
    page.goto("/register")
    expect(page.locator("html")).to_have_attribute("lang", "ko")


def test_an_entry_typed_in_is_booked_and_seen_in_place_without_a_reload(
    house: House, open_tab: OpenTab
) -> None:
    a_bank(house)
    page = open_tab(house)
    page.evaluate("window.sameDocument = true")
    save(write_entry(page, "Typed lunch", "12,500"))
    expect(page.locator("[data-live]").get_by_text("Typed lunch").first).to_be_visible()
    assert page.evaluate("window.sameDocument") is True
    assert booked(house, "Typed lunch") == 1
    (entry,) = [
        e for e in answer_of(house, "/api/ledger/entries")["items"] if e["description"] == "Typed lunch"
    ]
    assert (entry["amount"], entry["currency"]) == ("-12500", "KRW")


def test_an_entry_is_booked_by_keyboard_alone(house: House, open_tab: OpenTab) -> None:
    a_bank(house)
    page = open_tab(house)
    page.locator("form#entry [name=description]").focus()
    page.keyboard.type("By keyboard")
    page.keyboard.press("Tab")
    page.keyboard.type("3000")
    page.keyboard.press("Enter")
    expect(page.locator("[data-live]").get_by_text("By keyboard").first).to_be_visible()
    assert booked(house, "By keyboard") == 1


def test_an_entry_is_booked_without_javascript(house: House, open_tab: OpenTab, scriptless: Browser) -> None:
    a_bank(house)
    page = open_tab(house, of=scriptless)
    save(write_entry(page, "Plain form"))
    expect(page.get_by_text("Plain form").first).to_be_visible()
    assert booked(house, "Plain form") == 1


def test_what_is_wrong_is_said_at_its_field_and_the_text_is_kept(house: House, open_tab: OpenTab) -> None:
    a_bank(house)
    page = open_tab(house)
    form = write_entry(page, "Wrong amount", "12.5")
    save(form)
    expect(form.locator("[data-fault=amount]")).not_to_be_empty()
    expect(form.locator("[name=description]")).to_have_value("Wrong amount")
    assert booked(house, "Wrong amount") == 0


def test_hostile_texts_are_shown_as_they_are_and_execute_nothing(house: House, open_tab: OpenTab) -> None:
    a_bank(house)
    body = {"id": "assets:test:hostile", "name": HOSTILE, "type": "asset", "currency": "KRW"}
    assert house.ask("POST", "/api/ledger/accounts", body, key="hostile-account").status == 201
    entry = {
        "date": "2026-11-21",
        "amount": "-100",
        "currency": "KRW",
        "account": "assets:test:hostile",
        "category": HOSTILE,
        "description": HOSTILE,
        "payment_method": HOSTILE,
    }
    assert house.ask("POST", "/api/ledger/entries", entry, key="hostile-entry").status == 201
    page = open_tab(house)
    form = write_entry(page, HOSTILE, "777")
    form.locator("[name=category]").fill(HOSTILE)
    save(form)
    expect(page.locator("[data-live]").get_by_text(HOSTILE).first).to_be_visible()
    for path in (
        "/",
        "/register",
        "/accounts",
        "/import",
        f"/register?q={HOSTILE}",
        "/register?account=assets:test:hostile",
    ):
        page.goto(path)
        expect(page.locator("main")).to_be_visible()
        assert page.locator("main img, main b:text-is('굵게')").count() == 0
    # that no dialog was opened and nothing was refused by the policy is asked after every test


def test_a_page_never_asks_for_anything_elsewhere(house: House, open_tab: OpenTab) -> None:
    a_bank(house)
    page = open_tab(house)
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    for path in ("/", "/register", "/accounts", "/import"):
        page.goto(path)
    assert asked
    assert [url for url in asked if not url.startswith((house.url, "data:"))] == []


def test_two_tabs_that_change_one_entry_see_each_others_change(house: House, open_tab: OpenTab) -> None:
    a_bank(house)
    post_entry(house, "Changed twice")
    items = answer_of(house, "/api/ledger/entries?limit=500")["items"]
    (entry,) = [one for one in items if one["description"] == "Changed twice"]
    path = f"/entries/{entry['id']}"
    first = open_tab(house, path)
    second = open_tab(house, path, beside=first)
    for page, amount in ((first, "101"), (second, "202")):
        expect(page.locator("#entry-now")).to_be_hidden()
        page.locator("[name=amount]").fill(amount)
    save(first.locator("form#entry-change"))
    first.wait_for_url("**/register")
    form = second.locator("form#entry-change")
    save(form)
    expect(form.locator("[data-said].wrong")).to_contain_text("Somebody changed it first")
    expect(second.locator("#entry-now")).to_contain_text("₩101")
    expect(second.locator("[name=amount]")).to_have_value("202")
    assert answer_of(house, f"/api/ledger/entries/{entry['id']}")["amount"] == "-101"
    save(form)
    second.wait_for_url("**/register")
    assert answer_of(house, f"/api/ledger/entries/{entry['id']}")["amount"] == "-202"


#: Adds up what moves by itself while a page is being loaded.
SHIFTS: Final = """window.moved = [];
  new PerformanceObserver((list) => moved.push(...list.getEntries().map((one) => one.sources.map(({ node }) => node?.outerHTML))))
    .observe({ type: "layout-shift", buffered: true });"""


@pytest.mark.parametrize("width", [390, 1280])
def test_nothing_moves_by_itself_while_a_page_is_loaded(house: House, open_tab: OpenTab, width: int) -> None:
    a_bank(house)
    post_entry(house, f"Stands still at {width}")
    page = open_tab(house, viewport={"width": width, "height": 800})
    page.add_init_script(SHIFTS)
    for path in ("/", "/register", "/accounts", "/import", "/plans"):
        page.goto(path)
        is_joined(page)
        assert page.evaluate("moved") == [], path


@pytest.mark.parametrize("lang", ["ko-KR", "en-US"])
def test_the_header_fits_a_phone_whatever_the_state_is_called(
    house: House, open_tab: OpenTab, lang: str
) -> None:
    page = open_tab(house, lang=lang, viewport={"width": 360, "height": 780})
    words = page.evaluate(
        """["serving", "slow", "safe", "down", "off", "stopped"].map((state) => {
            document.documentElement.dataset.hc = state;
            const right = document.querySelector(".tongues").getBoundingClientRect().right;
            return [document.querySelector(".state .words").innerText.trim(), right <= innerWidth];
        })"""
    )
    assert all(fits for _, fits in words)
    assert len({word for word, _ in words if word}) == len(words)
