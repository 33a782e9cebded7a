"""The open page while the server behind it dies, freezes and comes back."""

import json
import re
import signal
import subprocess
import sys

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.browser.conftest import MakeHouse, OpenTab
from tests.browser.outages import cores, held_start, lost_answer, outage
from tests.browser.readers import (
    a_bank,
    booked,
    first_sign,
    is_down,
    is_joined,
    is_saved,
    is_serving,
    overlay,
    post_entry,
    save,
    send_now,
    told,
    write_entry,
)
from tests.integration.house import House
from tests.waiting import until

TYPED = "점심 김치찌개 half typed"


def typing(page: Page) -> None:
    """Type into the form of an entry, and stand in the middle of the text with a part of it selected."""
    write_entry(page, TYPED, "8000")
    field = page.locator("form#entry [name=description]")
    field.focus()
    field.evaluate("field => field.setSelectionRange(3, 7)")
    page.evaluate("scrollTo(0, 40); window.sameDocument = true")


def is_where_it_was(page: Page) -> None:
    """Everything typed is there, the field has the focus and the selection, and nothing was loaded anew."""
    field = page.locator("form#entry [name=description]")
    expect(field).to_have_value(TYPED)
    expect(page.locator("form#entry [name=amount]")).to_have_value("8,000")
    expect(field).to_be_focused()
    assert field.evaluate("field => [field.selectionStart, field.selectionEnd]") == [3, 7]
    assert page.evaluate("window.sameDocument") is True


@pytest.mark.parametrize("blow", [signal.SIGKILL, signal.SIGSTOP])
def test_whoever_types_while_the_core_is_hit_is_told_by_the_page_and_finds_everything_as_it_was(
    house: House, open_tab: OpenTab, blow: signal.Signals
) -> None:
    a_bank(house)
    page = open_tab(house)
    is_joined(page)
    typing(page)
    with outage(house, blow):
        is_down(page)
        expect(overlay(page)).to_be_visible()
        expect(page).to_have_title(re.compile(r"^\(Recovering\)"))
        assert "Restarting the server" in told(page)
        assert "Starting the server" in told(page)
        page.keyboard.press("Escape")
        expect(overlay(page)).to_be_visible()
    is_serving(page)
    is_where_it_was(page)
    page.keyboard.press("End")
    page.keyboard.type("!")
    expect(page.locator("form#entry [name=description]")).to_have_value(TYPED + "!")


def test_a_core_that_is_back_at_once_is_a_strip_and_never_an_overlay(house: House, open_tab: OpenTab) -> None:
    a_bank(house)
    page = open_tab(house)
    is_joined(page)
    typing(page)
    page.evaluate(
        "window.told = [];"
        "for (const name of ['hc:down', 'hc:back']) document.addEventListener(name, () => window.told.push(name))"
    )
    house.hit("core")
    until(lambda: "hc:back" in page.evaluate("window.told"), "the page to be told that it is back")
    assert page.evaluate("window.told") == ["hc:down", "hc:back"]
    is_serving(page)
    is_where_it_was(page)


def test_a_request_sent_into_the_outage_is_answered_once(house: House, open_tab: OpenTab) -> None:
    a_bank(house)
    page = open_tab(house)
    is_joined(page)
    form = write_entry(page, "Into the outage", "4500")
    with outage(house):
        send_now(form)
        is_down(page)
        expect(overlay(page).get_by_text("1 waiting", exact=True)).to_be_visible()
    is_serving(page)
    expect(page.locator("[data-live]").get_by_text("Into the outage").first).to_be_visible()
    expect(form.locator("[name=description]")).to_have_value("")
    assert booked(house, "Into the outage") == 1


def test_a_reload_during_the_outage_shows_the_recovery_page_on_the_same_address_and_comes_back_alone(
    house: House, open_tab: OpenTab
) -> None:
    a_bank(house)
    page = open_tab(house, "/register?q=anything")
    with outage(house):
        answer = page.reload()
        assert answer is not None
        assert (answer.status, answer.headers["retry-after"].isdigit()) == (503, True)
        assert page.url == f"{house.url}/register?q=anything"
        expect(page.get_by_role("heading", name="Restarting the server")).to_be_visible()
    expect(page.locator("form[role=search]")).to_be_visible()
    assert page.url == f"{house.url}/register?q=anything"


def test_text_typed_before_a_reload_in_the_outage_is_restored_and_said_not_to_be_sent(
    house: House, open_tab: OpenTab
) -> None:
    a_bank(house)
    page = open_tab(house)
    is_joined(page)
    typing(page)
    with outage(house):
        is_down(page)
        page.reload()
    expect(page.locator("form#entry [name=description]")).to_have_value(TYPED)
    expect(page.get_by_text("It has not been sent.")).to_be_visible()
    assert booked(house, TYPED) == 0


def test_the_recovery_page_works_in_korean_and_without_javascript(
    house: House, open_tab: OpenTab, scriptless: Browser
) -> None:
    page = open_tab(house, lang="ko-KR", of=scriptless)
    with outage(house):
        page.reload()
        expect(page.get_by_role("heading", name="서버를 다시 켜고 있어요")).to_be_visible()
        refresh = page.locator("meta[http-equiv=refresh]").get_attribute("content")
        assert refresh == "5"
        expect(page.locator("noscript p")).to_be_visible()  # Playwright finds no text in there
    expect(page.locator("form#entry, form[action='/start']").first).to_be_visible()


def test_what_is_booked_after_the_death_appears_in_the_open_page_once_and_without_a_reload(
    house: House, open_tab: OpenTab
) -> None:
    a_bank(house)
    page = open_tab(house, "/register")
    is_joined(page)
    page.evaluate("window.sameDocument = true")
    names = [f"Elsewhere {number}" for number in range(3)]
    post_entry(house, names[0])
    expect(page.get_by_text(names[0])).to_be_visible()
    house.hit("core")
    post_entry(house, names[1])
    house.running()
    post_entry(house, names[2])
    for name in names:
        expect(page.get_by_text(name)).to_have_count(1)
    assert page.evaluate("window.sameDocument") is True


def test_an_answer_that_died_with_the_gateway_is_asked_for_again_and_booked_once(
    house: House, open_tab: OpenTab
) -> None:
    a_bank(house)
    page = open_tab(house)
    is_joined(page)
    form = write_entry(page, "Lost answer", "4500")
    with lost_answer(house, "entry.record"):
        save(form)
    is_saved(form)
    expect(page.locator("[data-live]").get_by_text("Lost answer").first).to_be_visible()
    assert booked(house, "Lost answer") == 1


def test_a_form_whose_answer_died_with_the_gateway_is_booked_once_however_often_it_is_sent(
    house: House, open_tab: OpenTab, scriptless: Browser
) -> None:
    a_bank(house)
    page = open_tab(house, of=scriptless)
    form = write_entry(page, "Lost page", "4500")
    with page.expect_event("load"), lost_answer(house, "entry.record"):
        form.locator("button.primary").click(no_wait_after=True)
    # The browser sends a form again by itself where its connection had served before, else it shows its own page.
    if page.url.startswith("chrome-error:"):
        page.reload()
    expect(page.get_by_text("Lost page")).to_be_visible()
    assert booked(house, "Lost page") == 1


def test_a_planned_restart_is_called_one(house: House, open_tab: OpenTab) -> None:
    a_bank(house)
    page = open_tab(house)
    is_joined(page)
    known = cores(house)
    words = [sys.executable, "-m", "hardcore.cli", "--data", str(house.data), "restart", "--reason", "test"]
    with subprocess.Popen(words, env=house.environment(), stdout=subprocess.DEVNULL) as asking:
        with held_start(house, known):
            is_down(page)
            expect(overlay(page)).to_be_visible()
            assert "The administrator is restarting the server" in told(page)
            assert "Nothing is broken." in told(page)
        assert asking.wait(30) == 0
    is_serving(page)


def test_every_tab_is_told(house: House, open_tab: OpenTab) -> None:
    a_bank(house)
    first = open_tab(house)
    second = open_tab(house, "/register", beside=first)
    for page in (first, second):
        is_joined(page)
    with outage(house):
        for page in (first, second):
            is_down(page)
    for page in (first, second):
        is_serving(page)


def test_where_sockets_are_blocked_the_page_asks_and_says_the_same(house: House, open_tab: OpenTab) -> None:
    a_bank(house)
    page = open_tab(house)
    page.route_web_socket("**", lambda socket: socket.close())
    page.reload()
    is_joined(page)
    typing(page)
    with outage(house):
        is_down(page)
        expect(overlay(page)).to_be_visible()
        assert "Restarting the server" in told(page)
    is_serving(page)
    is_where_it_was(page)


def test_ones_own_network_is_told_apart_from_the_server_and_nothing_typed_is_lost(
    house: House, open_tab: OpenTab
) -> None:
    a_bank(house)
    page = open_tab(house)
    is_joined(page)
    typing(page)
    page.context.set_offline(True)
    is_down(page)
    expect(first_sign(page)).to_contain_text("No connection to the server")
    expect(first_sign(page)).to_contain_text("What you typed is still here.")
    expect(overlay(page)).to_have_count(0)
    is_where_it_was(page)
    page.context.set_offline(False)
    expect(first_sign(page)).to_contain_text("Connected again")
    is_serving(page)
    is_where_it_was(page)


def test_the_page_says_what_was_proven_once_it_is_proven(house: House, open_tab: OpenTab) -> None:
    a_bank(house)
    page = open_tab(house)
    is_joined(page)
    with outage(house):
        expect(overlay(page)).to_be_visible()
    expect(page.get_by_text("All balances were checked and match.", exact=True)).to_be_visible()
    until(lambda: house.status()["ledger_verified_at"], "the proof to be in the status")


def test_status_in_json_says_the_same(house: House, open_tab: OpenTab) -> None:
    page = open_tab(house)
    with outage(house):
        state = json.loads(page.request.get("/__hc/status.json").text())
        assert (state["type"], state["text"], state["stages"]) == ("state", "R1", 4)
    house.running()
    until(
        lambda: json.loads(page.request.get("/__hc/status.json").text())["text"] is None,
        "the ledger to be served",
    )


def test_where_nobody_tries_any_more_the_page_says_so_and_leads_to_the_administrators_page(
    new_house: MakeHouse, open_tab: OpenTab
) -> None:
    house = new_house(spare=False, max_restart_count=1, probation_ms=60_000).up_unproven()
    page = open_tab(house)
    is_joined(page)
    for _death in range(2):
        house.until(lambda s: s["core"]["pid"], "a core to be hit")
        house.hit("core")
        house.until(
            lambda s: s["core"]["pid"] is None or s["state"] == "MANUAL_INTERVENTION", "the core's end"
        )
    house.until(lambda s: s["state"] == "MANUAL_INTERVENTION", "the guard to wait for a person")
    expect(page.locator("html")).to_have_attribute("data-hc", "stopped")
    expect(overlay(page)).to_be_visible()
    assert "Automatic recovery has stopped" in told(page)
    assert "Saved records were not touched." in told(page)
    page.reload()
    expect(page).to_have_title(re.compile(r"^\(Stopped\)"))
    page.get_by_role("link", name="Administrator").click()
    page.wait_for_url("**/admin/")
    expect(page.get_by_role("heading", level=1).first).to_be_visible()
