"""A ledger behind a password, as a person meets it: the form, an outage, a session that ends under the fingers."""

import re
import signal
from collections.abc import Iterator

import pytest
from playwright.sync_api import Page, expect

from hardcore.access import files, passwords
from hardcore.access.people import OWNER, People, Person
from tests.browser.conftest import OpenTab
from tests.browser.outages import outage
from tests.browser.readers import a_bank, is_down, is_joined, is_serving, overlay, write_entry
from tests.integration.house import House
from tests.waiting import until

PASSWORD = "canary-long-enough"
OWNERS = Person(OWNER, passwords.kept(PASSWORD))


@pytest.fixture
def house(shared_house: House) -> Iterator[House]:
    """The shared house, with a password while the test lasts."""
    shared_house.running()
    a_bank(shared_house)
    keep(shared_house, People((OWNERS,)))
    until(
        lambda: shared_house.ask("GET", "/api/ledger/accounts").status == 401, "the password to be asked for"
    )
    yield shared_house
    keep(shared_house, People())
    until(lambda: shared_house.ask("GET", "/api/ledger/accounts").status == 200, "the door to be open again")


def keep(house: House, people: People) -> None:
    files.write_people(house.folders.state, people)


def sign_in(page: Page, password: str = PASSWORD) -> None:
    page.locator("[name=password]").fill(password)
    page.keyboard.press("Enter")


def test_who_opens_a_page_signs_in_and_is_where_he_wanted_to_be_and_an_outage_changes_nothing(
    house: House, open_tab: OpenTab
) -> None:
    page = open_tab(house, "/register?q=lunch")
    expect(page.locator("[name=password]")).to_be_focused()
    sign_in(page, "not this one")
    expect(page.get_by_role("alert")).to_have_text(re.compile("not right"))
    expect(page.locator("[name=password]")).to_be_focused()
    sign_in(page)
    expect(page).to_have_url(re.compile(r"/register\?q=lunch$"))
    is_joined(page)
    with outage(house, signal.SIGKILL):
        is_down(page)
        expect(overlay(page)).to_be_visible()
        page.reload()
        expect(page.locator("h2, h1").first).to_have_text(re.compile("Restarting"))
    expect(page.locator("html")).to_have_attribute("data-user", OWNER)
    expect(page).to_have_url(re.compile(r"/register\?q=lunch$"))


def test_a_session_that_ends_takes_nothing_of_what_was_typed_along(house: House, open_tab: OpenTab) -> None:
    page = open_tab(house)
    sign_in(page)
    is_joined(page)
    write_entry(page, "lunch, half typed", "9000")
    keep(house, People((Person(OWNER, passwords.kept(PASSWORD)),)))  # as a new password would
    bar = page.locator(".bar")
    expect(bar).to_contain_text("Please sign in again")
    expect(bar).to_contain_text("stored in this browser")
    bar.get_by_role("link").click()
    expect(page.locator("[name=password]")).to_be_focused()
    sign_in(page)
    expect(page.locator("form#entry [name=description]")).to_have_value("lunch, half typed")
    is_serving(page)


def test_who_signs_out_leaves_nothing_in_the_browser(house: House, open_tab: OpenTab) -> None:
    page = open_tab(house)
    sign_in(page)
    is_joined(page)
    write_entry(page, "nobody else's business", "9000")
    page.locator("details.state summary").click()
    page.get_by_role("button", name="Sign out").click()
    expect(page.get_by_role("heading")).to_have_text("You are signed out")
    assert page.evaluate("sessionStorage.length") == 0
    page.goto("/")
    sign_in(page)
    is_joined(page)
    expect(page.locator("form#entry [name=description]")).to_have_value("")


def test_whoever_follows_a_link_from_elsewhere_and_is_signed_in_is_let_in(
    house: House, open_tab: OpenTab
) -> None:
    page = open_tab(house)
    sign_in(page)
    is_joined(page)
    other = open_tab(house, "about:blank", beside=page)
    other.set_content(f'<a href="{house.url}/register">there</a>')
    other.get_by_role("link").click()
    expect(other.locator("html")).to_have_attribute("data-user", OWNER)


@pytest.mark.parametrize("lang", ["ko", "en"])
def test_the_form_works_without_scripts_and_in_both_languages(
    house: House, open_tab: OpenTab, scriptless: object, lang: str
) -> None:
    page = open_tab(house, lang=lang, of=scriptless)
    expect(page.get_by_role("heading")).to_have_text("로그인" if lang == "ko" else "Sign in")
    page.get_by_role("link").click()
    expect(page.get_by_role("heading")).to_have_text("Sign in" if lang == "ko" else "로그인")
    sign_in(page)
    expect(page.locator("html")).to_have_attribute("data-user", OWNER)
    assert page.locator("html").get_attribute("lang") == ("en" if lang == "ko" else "ko")
