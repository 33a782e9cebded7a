"""Writing many entries quickly: by keys alone, with what was written before, and with a way back from each of them."""

import pytest
from playwright.sync_api import Page, expect

from tests.browser.conftest import OpenTab
from tests.browser.furniture import BANK, CARD, furnish
from tests.browser.readers import answer_of, booked, is_joined, save, write_entry
from tests.integration.house import House


@pytest.fixture(scope="module")
def home(shared_house: House) -> House:
    """A house that is lived in."""
    furnish(shared_house)
    return shared_house


def balance(house: House, account: str) -> int:
    told: dict[str, str] = answer_of(house, f"/api/ledger/accounts/{account}")["balances"]
    return int(told["posted"])


def toast(page: Page) -> str:
    """What the toast says, once it says something."""
    expect(page.locator("#toast span")).not_to_be_empty()
    return page.locator("#toast").inner_text()


def value(page: Page, name: str) -> str:
    found: str = page.locator("form#entry").evaluate("(form, name) => form.elements[name].value", name)
    return found


def test_an_entry_is_begun_filled_in_saved_and_taken_back_by_keys_alone(
    home: House, open_tab: OpenTab
) -> None:
    page = open_tab(home, "/register")
    is_joined(page)
    page.keyboard.press("n")
    expect(page.locator("form#entry [name=description]")).to_be_focused()
    with page.expect_response("**/api/ledger/entries?*"):
        page.locator("form#entry [name=description]").blur()
        page.keyboard.press("n")
    page.keyboard.type("동네 국숫집")
    expect(page.locator("form#entry [name=category]")).to_have_value("식비")
    assert (value(page, "account"), value(page, "kind")) == (CARD, "out")
    page.keyboard.press("Tab")
    page.keyboard.type("9500")
    page.keyboard.press("Enter")
    assert "동네 국숫집" in toast(page)
    expect(page.locator("form#entry [name=description]")).to_be_focused()
    assert booked(home, "동네 국숫집") == 2
    page.locator("form#entry [name=description]").blur()
    page.keyboard.press("u")
    expect(page.locator("#toast span")).to_contain_text("Undone")
    assert booked(home, "동네 국숫집") == 1
    # To be corrected, not to be written again.
    assert (value(page, "description"), value(page, "amount")) == ("동네 국숫집", "9,500")


def test_words_that_nobody_knows_leave_the_form_as_its_writer_left_it(home: House, open_tab: OpenTab) -> None:
    page = open_tab(home)
    before = value(page, "account")
    what = page.locator("form#entry [name=description]")
    with page.expect_response("**/api/ledger/entries?*"):
        what.focus()
    page.keyboard.type("동네 국숫집")
    expect(page.locator("form#entry [name=category]")).to_have_value("식비")
    page.keyboard.type(" 2호점")
    expect(page.locator("form#entry [name=category]")).to_have_value("")
    assert value(page, "account") == before
    page.locator("form#entry [name=category]").fill("외식")
    what.fill("동네 국숫집")
    assert value(page, "account") == CARD
    expect(page.locator("form#entry [name=category]")).to_have_value("외식")


def test_what_was_changed_elsewhere_meanwhile_is_not_taken_back(home: House, open_tab: OpenTab) -> None:
    page = open_tab(home)
    save(write_entry(page, "Changed before the undo"))
    assert "Changed before the undo" in toast(page)
    items = answer_of(home, "/api/ledger/entries?limit=500")["items"]
    (entry,) = [one for one in items if one["description"] == "Changed before the undo"]
    body = {"date": entry["date"], "amount": "-1", "account": entry["account"], "description": "Now this"}
    assert home.ask("PUT", f"/api/ledger/entries/{entry['id']}", body, key="other-hand").status == 200
    page.locator("#toast [data-undo]").click()
    expect(page.locator("#toast span")).to_contain_text("changed it first")
    assert booked(home, "Now this") == 1


def test_money_is_moved_between_two_accounts_in_one_step_and_moved_back(
    home: House, open_tab: OpenTab
) -> None:
    page = open_tab(home)
    was = balance(home, BANK), balance(home, CARD)
    form = page.locator("form#entry")
    expect(form.locator("[name=to]")).to_be_hidden()
    form.locator("[value=move]").check()
    expect(form.locator("[name=category]")).to_be_hidden()
    write_entry(page, "카드 대금", "10000")
    form.locator("[name=account]").select_option(BANK)
    form.locator("[name=to]").select_option(f"{BANK} KRW")
    save(form)
    expect(form.locator("[data-fault=to]")).not_to_be_empty()
    form.locator("[name=to]").select_option(f"{CARD} KRW")
    save(form)
    assert "카드 대금" in toast(page)
    assert (balance(home, BANK), balance(home, CARD)) == (was[0] - 10_000, was[1] + 10_000)
    page.locator("#toast [data-undo]").click()
    expect(page.locator("#toast span")).to_contain_text("Undone")
    assert (balance(home, BANK), balance(home, CARD)) == was


def test_keys_rest_while_somebody_types_and_can_be_switched_off(home: House, open_tab: OpenTab) -> None:
    page = open_tab(home, "/accounts")
    page.locator("#account-name").focus()
    page.keyboard.type("nu/2")
    expect(page.locator("#account-name")).to_have_value("nu/2")
    page.locator("#account-name").blur()
    page.keyboard.press("?")
    page.locator("#keys[open] input").uncheck()
    page.keyboard.press("Escape")
    page.keyboard.press("2")
    page.keyboard.press("?")
    expect(page.locator("#keys")).to_be_hidden()
    assert page.url.endswith("/accounts")
    page.locator("[data-keys]").click()
    page.locator("#keys[open] input").check()
    page.keyboard.press("Escape")
    page.keyboard.press("2")
    page.wait_for_url("**/register")


def test_what_a_page_did_is_said_on_the_page_that_it_leads_to(home: House, open_tab: OpenTab) -> None:
    page = open_tab(home)
    save(write_entry(page, "To be deleted"))
    page.locator("#recent a", has_text="To be deleted").click()
    page.locator("details.danger summary").click()
    page.locator("details.danger button").click()
    page.wait_for_url("**/register")
    assert "Deleted" in toast(page)
    page.reload()
    expect(page.locator("#toast")).to_be_empty()


def test_what_was_done_stays_until_it_could_be_read(home: House, open_tab: OpenTab) -> None:
    page = open_tab(home)
    page.clock.install()
    save(write_entry(page, "Behind something"))
    assert "Behind something" in toast(page)
    page.evaluate(
        """() => {
          const cover = document.body.appendChild(document.createElement("dialog"));
          cover.id = "cover";
          cover.showModal();
        }"""
    )
    page.clock.fast_forward(60_000)
    assert "Behind something" in toast(page)
    page.evaluate("document.getElementById('cover').remove()")
    page.clock.fast_forward(60_000)
    expect(page.locator("#toast")).to_be_empty()


def test_on_paper_there_is_what_was_found_and_nothing_to_press(home: House, open_tab: OpenTab) -> None:
    page = open_tab(home, f"/register?account={BANK}")
    page.emulate_media(media="print")
    page.set_viewport_size({"width": 700, "height": 1000})  # a sheet is as narrow as a tablet, and no tablet
    for gone in (".top", ".finder", "form#bank", ".taking", "footer"):
        expect(page.locator(gone)).to_be_hidden()
    expect(page.locator("table.register thead")).to_be_visible()
    expect(page.locator("#balance")).to_be_visible()
