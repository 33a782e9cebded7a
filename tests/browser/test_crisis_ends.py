"""How an outage ends on a page: what is said of its length and of the ledger, for how long, and what may follow."""

from collections.abc import Mapping, Sequence
from typing import Any

import pytest
from playwright.sync_api import Page, expect

from tests import waiting
from tests.browser.scripted_gateway import SERVING, ScriptedGateway, back, down
from tests.browser.scripted_pages import OpenLedger, is_over, marks, overlay, shows


def table(page: Page, told: Sequence[tuple[Mapping[str, Any], int]]) -> Any:
    """The view after frames at their moments, by the table alone."""
    return page.evaluate(
        """async (told) => {
          const { CALM, next } = await import("/source/outage.js");
          const view = told.reduce((before, [said, at_ms]) => next(before, said, at_ms), CALM);
          return { ...view, stays: view.due_ms === Infinity };
        }""",
        [list(one) for one in told],
    )


def test_a_switch_that_was_asked_for_and_is_over_at_once_is_not_shown(
    open_ledger: OpenLedger, gateway: ScriptedGateway
) -> None:
    page = open_ledger()
    said = """async ([view, now_ms]) => {
      const { face } = await import("/source/wording.js");
      const { words } = await import("/__hc/words.en.js");
      const facts = { pending: 1, receipt: null, draft: null, slow: false, alive: true, unheard: false, request: null };
      const { strip, card, title } = face(view, facts, now_ms, words);
      return [strip, card && card.head, title];
    }"""
    asked = down("R2", phase="DRAINING", stage=2, eta={"low_s": 2, "high_s": 4, "samples": 7}, samples=7)
    ended = {**back(380), "planned": True}
    for end in ([ended, SERVING], [SERVING, ended]):
        for so_far in range(4):
            told: list[tuple[Mapping[str, Any], int]] = [
                (SERVING, 0),
                (asked, 1000),
                (end[0], 1380),
                (end[1], 1381),
            ]
            view = table(page, told[: so_far + 1])
            assert page.evaluate(said, [view, 1390]) == [None, None, None]
    late = table(page, [(SERVING, 0), (asked, 1000), ({"type": "tick"}, 1400)])
    assert page.evaluate(said, [late, 1400])[1] == "The administrator is restarting the server"
    assert (
        table(page, [(SERVING, 0), (asked, 1000), ({**ended, "verified": False}, 1380)])["mode"] == "unsound"
    )
    page.evaluate("window.told = []; document.addEventListener('hc:back', () => window.told.push('back'))")
    gateway.say(asked)
    gateway.say(ended)
    gateway.say(SERVING)
    waiting.until(lambda: page.evaluate("told") == ["back"], "the page to be told that it may send again")


def test_a_ledger_that_is_not_whole_is_said_however_late_and_until_it_is_put_aside(
    open_ledger: OpenLedger, gateway: ScriptedGateway
) -> None:
    page = open_ledger()
    bad: Mapping[str, Any] = {"type": "verified", "ok": False}
    late: list[tuple[Mapping[str, Any], int]] = [
        (SERVING, 0), (down(), 100), ({"type": "tick"}, 600), (back(900), 1000), (SERVING, 1001),
        ({"type": "tick"}, 60_000), (bad, 90_000), ({"type": "tick"}, 900_000),
    ]  # fmt: skip
    view = table(page, late)
    assert (view["mode"], view["stays"]) == ("unsound", True)
    assert table(page, [(SERVING, 0), (down(), 9), (back(9, verified=False), 20)])["mode"] == "unsound"
    aside: list[tuple[Mapping[str, Any], int]] = [*late, ({"type": "dismiss"}, 900_001)]
    assert table(page, [*aside, ({**SERVING, "sound": False}, 900_002)])["mode"] == "calm"
    gateway.say({"v": 1, **bad})
    shows(page, "A balance does not match")


def test_a_page_that_is_opened_later_learns_that_the_ledger_is_not_whole(
    open_ledger: OpenLedger, gateway: ScriptedGateway
) -> None:
    gateway.say({**SERVING, "sound": False})
    page = open_ledger()
    shows(page, "A balance does not match")
    page.get_by_role("button", name="Close").click()
    expect(page.get_by_text("A balance does not match", exact=True)).to_be_hidden()
    page.goto("/en?again")
    marks(page, "serving")
    shows(open_ledger("/ko"), "잔액이 맞지 않는 부분을 찾았어요")
    expect(page.get_by_text("A balance does not match", exact=True)).to_be_hidden()


def test_an_outage_that_goes_on_after_a_person_acted_takes_the_page_again(
    open_ledger: OpenLedger, gateway: ScriptedGateway
) -> None:
    page = open_ledger()
    gateway.say(down("R8", phase="FATAL"))
    expect(overlay(page)).to_be_visible()
    marks(page, "stopped")
    assert page.title() == "(Stopped) Ledger"
    page.keyboard.press("Escape")
    expect(overlay(page)).to_have_count(0)
    gateway.say(down("R1"))
    expect(overlay(page)).to_be_visible()
    marks(page, "down")


def test_a_stage_that_was_not_seen_is_not_called_done(
    open_ledger: OpenLedger, gateway: ScriptedGateway
) -> None:
    page = open_ledger()
    gateway.say(down("R7b", stage=1))
    shows(page, "Problem found")
    gateway.say(down("R7b", stage=3))
    words = overlay(page).locator("li .word")
    expect(words).to_contain_text(["done", "passed", "now", "next"])


def test_a_server_that_is_off_is_not_called_recovering(
    open_ledger: OpenLedger, gateway: ScriptedGateway
) -> None:
    page = open_ledger()
    gateway.say(down("OFF", phase="STOPPED"))
    marks(page, "off")
    assert page.title() == "(Off) Ledger"


def test_a_length_that_nobody_measured_is_not_said(open_ledger: OpenLedger, gateway: ScriptedGateway) -> None:
    page = open_ledger()
    gateway.say(down("R7b"))
    is_over(gateway, back(None))
    shows(page, "You are back")
    assert page.get_by_text("It took").locator("visible=true").count() == 0


@pytest.mark.parametrize(("told_ms", "said_ms"), [(30, 318), (None, 318), (900, 900)])
def test_the_length_is_never_shorter_than_our_own_line_was_gone(
    open_ledger: OpenLedger, told_ms: int | None, said_ms: int
) -> None:
    page = open_ledger()
    hello = {"type": "hello", "overlay_after_ms": 400}
    in_an_outage: list[tuple[Mapping[str, Any], int]] = [
        ({**hello, "gap_ms": 300}, 1300),
        (down(), 1300),
        (back(told_ms), 1318),
    ]
    in_peace: list[tuple[Mapping[str, Any], int]] = [
        ({"type": "lost"}, 1200),
        ({**hello, "gap_ms": 318}, 1318),
        (back(told_ms), 1318),
    ]
    assert table(page, in_an_outage)["back"]["outage_ms"] == said_ms
    assert table(page, in_peace)["back"]["outage_ms"] == said_ms
