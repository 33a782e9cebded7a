"""The dashboard in a real browser on a real house: an incident, a deadlock, a letter from its death to its end."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from playwright.sync_api import Browser, Page, expect

from tests.browser.outages import outage
from tests.integration.house import House, transaction
from tests.integration.poisoning import armed, letter_of

OpenTab = Callable[..., Page]


def settled(house: House, count: int) -> dict[str, Any]:
    """Wait until so many incidents are over; the newest one."""
    story = house.closed(count)
    house.running()
    return story


def set_aside(house: House, description: str) -> str:
    """Have a request kill its core and be set aside; the number of its letter."""
    key = armed(house)
    with ThreadPoolExecutor(1) as pool:
        pool.submit(house.ask, "POST", "/api/ledger/transactions", transaction(description), key=key)
        return letter_of(house, key)


def test_the_dashboard_tells_of_an_outage_while_it_lasts_and_explains_it_afterwards(
    open_tab: OpenTab, shared_house: House
) -> None:
    count = len(shared_house.incidents())
    page = open_tab(shared_house, "/admin/")  # its process is started when somebody asks
    with outage(shared_house):
        expect(page.locator("html")).to_have_attribute("data-hc", "down")
        expect(page.locator("#state .word")).to_contain_text("Recovering")
        page.reload()  # and the page comes whole while no core lives
        expect(page.locator("#state .word")).to_contain_text("Recovering")
        expect(page.locator("dialog[open], script[src^='/__hc/']")).to_have_count(0)
    expect(page.locator("#state .word")).to_contain_text("Working")
    expect(page.locator("html")).to_have_attribute("data-hc", "serving")
    story = settled(shared_house, count + 1)
    page.goto("/admin/incidents?view=all")
    page.locator(f"a[href='/admin/incidents/{story['id']}']").click()
    expect(page.locator("h1")).to_contain_text("killed from outside")
    expect(page.locator("#course svg.drawing")).to_be_visible()


def test_a_deadlock_is_drawn_as_a_ring(open_tab: OpenTab, shared_house: House) -> None:
    count = len(shared_house.incidents())
    assert shared_house.order("drill", fault="deadlock", yes=True)["ok"]
    story = settled(shared_house, count + 1)
    page = open_tab(shared_house, f"/admin/incidents/{story['id']}")
    expect(page.locator("#ring svg.drawing path.d-wait")).to_have_count(2)
    page.locator("#ring summary").click()
    expect(page.locator("#ring table")).to_be_visible()


def test_a_letter_is_tried_retried_and_resolved_and_another_is_discarded_with_a_reason(
    open_tab: OpenTab, shared_house: House
) -> None:
    if not shared_house.ask("GET", "/api/ledger/accounts").body["items"]:
        shared_house.open_accounts()
    first = set_aside(shared_house, "first")
    second = set_aside(
        shared_house, "second"
    )  # the drill is another request's now: the first one is harmless
    page = open_tab(shared_house, f"/admin/dlq/{first}")
    page.get_by_role("button", name="Dry run").click()
    expect(page.locator(".ordeal-survived")).to_be_visible()
    page.get_by_role("button", name="Retry", exact=True).click()
    asked = page.locator("dialog[open]")
    expect(asked).to_contain_text("A dry run within the last 10 minutes went well.")
    asked.get_by_role("button", name="Retry").click()
    expect(page.locator(".letter-RESOLVED")).to_be_visible()

    page.goto("/admin/dlq?state=QUARANTINED")
    page.locator(f"#l-{second} input").check()
    expect(page.locator("[data-paused]")).to_be_visible()
    page.goto(f"/admin/dlq/{second}")
    page.get_by_role("button", name="Discard").click()
    asked = page.locator("dialog[open]")
    expect(asked).to_contain_text("No money moves. It stays on record.")
    asked.get_by_role("textbox").fill("sent by mistake")
    asked.get_by_role("button", name="Discard").click()
    expect(page.locator(".letter-DISCARDED")).to_be_visible()
    page.get_by_role("button", name="Undo").click()
    expect(page.locator(".letter-QUARANTINED")).to_be_visible()
    page.goto("/admin/settings")
    expect(page.locator("#audit")).to_contain_text("sent by mistake")


def test_without_scripts_a_question_is_a_page_and_a_wrong_word_restarts_nothing(
    open_tab: OpenTab, shared_house: House, scriptless: Browser
) -> None:
    page = open_tab(shared_house, "/admin/", of=scriptless)
    page.get_by_role("button", name="Restart the core").click()
    expect(page.locator("#confirm h1")).to_have_text("Restart the core?")
    page.get_by_role("textbox").fill("reboot")
    page.get_by_role("button", name="Restart the core").click()
    expect(page.locator("#confirm-fault")).to_be_visible()
    page.get_by_role("link", name="Keep as it is").click()
    expect(page.locator("#state")).to_be_visible()
