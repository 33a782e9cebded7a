"""The recovery page, which stands at the address of another: it waits, tells, and gives the address back."""

from typing import Any

import pytest
from playwright.sync_api import Browser, Request, Route, expect

from tests import waiting
from tests.browser.scripted_gateway import ScriptedGateway, back, down
from tests.browser.scripted_pages import OpenLedger, is_over, shows


def test_the_recovery_page_opens_the_address_again_by_itself(
    open_ledger: OpenLedger, gateway: ScriptedGateway
) -> None:
    gateway.recovering = ("ko", "recovering", "get")
    gateway.say(down(stage=1, phase="SNAPSHOT_LIVE"))
    page = open_ledger("/ko?month=10")
    before = page.evaluate("history.length")
    shows(page, "문제 발견")
    assert page.title() == "(복구 중) 서버를 다시 켜고 있어요"
    gateway.recovering = None
    is_over(gateway, back(2000))
    expect(page.get_by_role("heading", name="October")).to_be_visible()
    assert page.url.endswith("/ko?month=10")
    assert page.evaluate("history.length") == before


@pytest.mark.parametrize("outcome", ["not_done", "unknown"])
def test_a_recovery_page_for_a_form_sends_nothing_and_shows_the_way_back(
    open_ledger: OpenLedger, gateway: ScriptedGateway, outcome: Any
) -> None:
    gateway.recovering = ("en", "recovering", outcome)
    gateway.say(down())
    page = open_ledger("/en")
    shows(page, {"not_done": "was not done", "unknown": "It is not known whether"}[outcome])
    asked = len(gateway.asked)
    is_over(gateway, back(2000))
    expect(page.get_by_role("link", name="Open the page again")).to_be_visible()
    assert [path for path in gateway.asked[asked:] if path == "/en"] == []


def test_a_recovery_page_that_can_keep_a_form_offers_it_in_the_card_and_after_the_end(
    open_ledger: OpenLedger, gateway: ScriptedGateway
) -> None:
    gateway.recovering = ("ko", "recovering", "keepable")
    gateway.say(down())
    page = open_ledger("/ko")
    kept: list[str | None] = []

    def keep(route: Route, request: Request) -> None:
        kept.append(request.method)
        route.fulfill(status=200, body="kept")

    page.route("**/__hc/keep", keep)
    shows(page, "방금 보낸 요청은 아직 처리하지 않았어요.")
    offer = page.locator("section.card form[action='/__hc/keep'] button")
    expect(offer).to_have_text("요청 맡겨 두기")
    page.get_by_role("button", name="English").click()
    expect(offer).to_have_text("Keep it for me")
    is_over(gateway, back(2000))
    shows(page, "Leave it here and it will be handled once, now.")
    offer.click()
    waiting.until(lambda: kept == ["POST"], "the form to be posted")


def test_what_became_of_a_form_is_said_also_after_the_line_was_lost(
    open_ledger: OpenLedger, gateway: ScriptedGateway
) -> None:
    gateway.recovering = ("en", "recovering", "unknown")
    gateway.say(down())
    page = open_ledger("/en")
    page.context.set_offline(True)
    gateway.hang_up()
    shows(page, "No connection to the server")
    shows(page, "It is not known whether what you just sent was done.")
    page.context.set_offline(False)
    shows(page, "Restarting the server")
    is_over(gateway, back(2000))
    shows(page, "Please check the records first.")
    page.context.set_offline(True)
    gateway.hang_up()
    shows(page, "No connection to the server")
    page.context.set_offline(False)
    shows(page, "Connected again")
    shows(page, "Please check the records first.")


def test_the_recovery_page_changes_its_language_and_remembers_it(
    open_ledger: OpenLedger, gateway: ScriptedGateway
) -> None:
    gateway.recovering = ("ko", "stopped_trying", "get")
    gateway.say(down("R8", phase="FATAL"))
    page = open_ledger("/ko")
    shows(page, "자동 복구를 멈췄어요")
    page.get_by_role("button", name="English").click()
    shows(page, "Automatic recovery has stopped")
    assert page.evaluate("document.cookie") == "lang=en"


def test_the_recovery_page_reopens_without_a_script(scriptless: Browser, gateway: ScriptedGateway) -> None:
    gateway.recovering = ("en", "recovering", "get")
    scriptless.new_page().goto(f"{gateway.url}/en", wait_until="commit")
    waiting.until(lambda: gateway.asked.count("/en") > 1, "the page to be opened again", 15)
    assert "/__hc/live" not in gateway.asked
