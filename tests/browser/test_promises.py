"""Wishes that were promised to be carried out later: what their own page says, and any other page of that browser."""

import re
from collections.abc import Callable
from typing import Any, Final

import pytest
from playwright.sync_api import Browser, Page, Request, Route, expect

from tests.browser.conftest import MakeHouse, OpenTab
from tests.browser.outages import outage
from tests.browser.readers import (
    a_bank,
    answer_of,
    booked,
    is_joined,
    is_saved,
    overlay,
    save,
    send_now,
    write_entry,
)
from tests.browser.tabs import Watch
from tests.integration.house import House
from tests.waiting import until

#: A request is promised soon, so that an outage need not last as long as people's patience.
POLICY: Final = {"spare": False, "gateway": {"hold_ms": 1_000, "drain_ms": 1_000}}

#: Old for a promise, and long for the moment between a person's word and its deed.
OLD_MS: Final = 3_000

_RECEIPT: Final = re.compile(r"/__hc/receipts/([^/?]+)(?:/(\w+))?$")
_KEPT_AT: Final = "2026-11-21T09:30:00Z"


class Receipts:
    """Receipts as a test wants them, in place of the gateway's; `words` are those that a person gave."""

    def __init__(self, page: Page) -> None:
        self.page = page
        self.told: dict[str, dict[str, Any]] = {}
        self.words: list[tuple[str, str]] = []
        self.away = False
        self.keys: list[str] = []
        page.route(_RECEIPT, self._answer)

    def promise(self) -> None:
        """Promise every entry from now on; `keys` are theirs."""
        self.page.route("**/entries", self._promise)

    def _promise(self, route: Route, request: Request) -> None:
        assert request.headers["prefer"] == "respond-async"
        key = request.headers["idempotency-key"]
        self.keys.append(key)
        self.told[key] = {"key": key, "outcome": "waiting", "seen": False}
        headers = {"Preference-Applied": "respond-async", "Location": f"/__hc/receipts/{key}"}
        route.fulfill(status=202, headers=headers, json={"receipt": key, "outcome": "waiting"})

    def say(self, key: str, outcome: str, **more: Any) -> None:
        """Change one, and tell the page."""
        receipt = {"key": key, "method": "POST", "path": "/entries", "status": None, "answer": None}
        self.told[key] = {**receipt, "kept_at": _KEPT_AT, "seen": False, "outcome": outcome, **more}
        self.page.evaluate(
            "(detail) => document.dispatchEvent(new CustomEvent('hc:receipt', {detail}))",
            {"key": key, "outcome": outcome},
        )

    def _answer(self, route: Route, request: Request) -> None:
        asked = _RECEIPT.search(request.url)
        assert asked is not None, "the route lets nothing else in"
        if self.away:
            route.fulfill(status=503, json={"type": "/problems/receipts-away"})
            return
        if asked[2]:
            self.words.append((asked[1], asked[2]))
        route.fulfill(status=202 if asked[2] else 200, json=self.told[asked[1]])


def card(page: Page, head: str) -> Any:
    """The card that says so."""
    return page.locator("#receipts section").filter(has=page.get_by_role("heading", name=head, exact=True))


def heard(page: Page, holds: Callable[[], bool], what: str) -> None:
    """Wait for what a route of ours hears: it hears nothing while nobody asks the browser anything."""
    until(lambda: page.evaluate("true") and holds(), what)


def test_what_became_of_wishes_whose_pages_have_gone_is_told_once_and_counted(
    house: House, open_tab: OpenTab
) -> None:
    a_bank(house)
    page = open_tab(house)
    is_joined(page)
    receipts = Receipts(page)
    receipts.say("key-done", "done", status=201, answer={})
    receipts.say("key-there", "already_done", status=201, answer={})
    receipts.say("key-no", "refused", status=422, answer={"detail": "There is not enough money in it."})
    receipts.say("key-cancelled", "not_done")
    result = card(page, "What happened to your requests")
    expect(result).to_contain_text("Done 1 / Was already done 1 / Not done 2")
    expect(result).to_contain_text("There is not enough money in it.")
    expect(result.get_by_role("link", name="View")).to_have_attribute("href", "/register")
    result.get_by_role("button", name="Close").click()
    expect(result).to_have_count(0)
    heard(page, lambda: len(receipts.words) == 4, "each of them to be called seen")
    assert {word for _, word in receipts.words} == {"seen"}
    receipts.say("key-done", "done", seen=True)
    receipts.say("key-old", "ask")  # the next to be told: until it is there, nothing else was
    expect(card(page, "Things changed meanwhile")).to_be_visible()
    expect(result).to_have_count(0)


def test_an_old_wish_is_asked_about_and_runs_or_is_cancelled_by_a_persons_word(
    house: House, open_tab: OpenTab
) -> None:
    a_bank(house)
    page = open_tab(house, lang="ko-KR")
    is_joined(page)
    receipts = Receipts(page)
    receipts.say("key-a1b2c3d4", "ask")
    asked = card(page, "그사이 상황이 바뀌었어요")
    expect(asked).to_contain_text("이 요청을 지금 처리할까요?")
    expect(asked).to_contain_text("접수 번호: a1b2c3d4")
    asked.get_by_role("button", name="처리하기").click()
    expect(asked).to_have_count(0)
    receipts.say("key-a1b2c3d4", "ask")
    asked.get_by_role("button", name="취소하기").click()
    expect(asked).to_have_count(0)
    assert receipts.words == [("key-a1b2c3d4", "run"), ("key-a1b2c3d4", "cancel")]


def test_a_question_is_asked_though_the_gateway_was_away_for_a_moment_and_a_word_that_was_lost_is_told(
    house: House, open_tab: OpenTab
) -> None:
    a_bank(house)
    page = open_tab(house)
    is_joined(page)
    receipts = Receipts(page)
    receipts.away = True
    with page.expect_response(_RECEIPT):  # it is asked for in vain
        receipts.say("key-a1b2c3d4", "ask")
    receipts.away = False
    page.evaluate("document.dispatchEvent(new CustomEvent('hc:back', {detail: {}}))")
    asked = card(page, "Things changed meanwhile")
    expect(asked).to_be_visible()
    receipts.away = True
    asked.get_by_role("button", name="Run it").click()
    expect(asked).to_contain_text("That did not get through. Please press again in a moment.")
    receipts.away = False
    asked.get_by_role("button", name="Run it").click()
    expect(asked).to_have_count(0)
    assert receipts.words == [("key-a1b2c3d4", "run")]


def test_a_form_whose_wish_was_promised_needs_no_window_and_takes_no_second_press(
    house: House, open_tab: OpenTab, watch: Watch
) -> None:
    a_bank(house)
    page = open_tab(house)
    is_joined(page)
    receipts = Receipts(page)
    keys = receipts.keys
    receipts.promise()
    form = write_entry(page, "Promised", "7000")
    said = form.locator("[data-said]")
    save(form)
    expect(said).to_contain_text("You can close this window; the request stays.")
    expect(said).to_contain_text(f"Receipt: {keys[0][-8:]}")
    send_now(form)
    expect(said).to_have_text(f"Already received · Receipt: {keys[0][-8:]}")
    assert len(keys) == 1
    receipts.say(keys[0], "refused", status=422, answer={"detail": "There is not enough money in it."})
    expect(said).to_have_text("There is not enough money in it.")
    expect(form.locator("[name=description]")).to_have_value("Promised")
    send_now(form)
    heard(page, lambda: len(keys) == 2, "the corrected wish to be sent under a key of its own")
    assert keys[0] != keys[1]
    receipts.say(keys[1], "done", status=201, answer={"location": "/", "said": "Saved"})
    expect(said).to_have_text("Saved")
    expect(form.locator("[name=description]")).to_have_value("")
    heard(page, lambda: len(receipts.words) == 2, "both to be called seen")
    page.reload()
    assert watch.leaving == 0
    expect(page.locator("#receipts section")).to_have_count(0)


def test_a_wish_that_was_set_aside_says_so_where_it_was_written_and_its_page_has_its_number(
    house: House, open_tab: OpenTab
) -> None:
    a_bank(house)
    page = open_tab(house)
    is_joined(page)
    receipts = Receipts(page)
    receipts.say("key-a1b2c3d4", "set_aside", letter="01J000000000letter99")
    aside = card(page, "This request was set aside")
    expect(aside).to_contain_text("it will not be tried again by itself")
    expect(aside).to_contain_text("Number: letter99")
    expect(aside).to_contain_text("Receipt: a1b2c3d4")
    for claim in ("No money moved", "The administrator was told"):
        assert claim not in aside.inner_text()  # nobody knows it here
    aside.get_by_role("button", name="Cancel it").click()
    expect(aside).to_have_count(0)
    assert receipts.words == [("key-a1b2c3d4", "cancel")]


@pytest.mark.parametrize(
    ("answer", "says"),
    [
        ({"outcome": "already_done", "status": 201, "answer": {}}, "This request was already done"),
        (
            {
                "outcome": "refused",
                "status": 409,
                "answer": {"detail": "One of its records has been set aside."},
            },
            "One of its records has been set aside.",
        ),
    ],
    ids=["R6b", "R9b"],
)
def test_what_became_of_a_promise_is_said_at_its_form_in_the_words_of_whoever_knows(
    house: House, open_tab: OpenTab, answer: dict[str, Any], says: str
) -> None:
    a_bank(house)
    page = open_tab(house)
    is_joined(page)
    receipts = Receipts(page)
    receipts.promise()
    form = write_entry(page, "Promised", "7000")
    save(form)
    expect(form.locator("[data-said]")).to_contain_text("You can close this window")
    receipts.say(receipts.keys[0], **answer)
    expect(form.locator("[data-said]")).to_contain_text(says)
    assert form.locator("[name=description]").input_value() == ("" if answer["status"] < 400 else "Promised")


def test_a_wish_sent_into_a_long_outage_is_done_once_though_its_tab_was_closed(
    house: House, open_tab: OpenTab
) -> None:
    a_bank(house)
    first = open_tab(house)
    is_joined(first)
    form = write_entry(first, "Kept over the outage", "4500")
    with outage(house):
        send_now(form)
        expect(overlay(first).get_by_text("1 waiting", exact=True)).to_be_visible()
        expect(overlay(first)).to_contain_text("You can close this window; the request stays.")
        expect(form.locator("[data-said]")).to_contain_text("You can close this window")
        first.close()
        second = open_tab(house, "/register", beside=first)
        expect(second.get_by_text("1 waiting", exact=True)).to_be_visible()
        expect(second.get_by_text("You can close this window; the request stays.")).to_be_visible()
    result = card(second, "What happened to your requests")
    expect(result).to_contain_text("Done 1 / Was already done 0 / Not done 0")
    expect(second.get_by_text("Kept over the outage")).to_be_visible()
    assert booked(house, "Kept over the outage") == 1
    result.get_by_role("button", name="Close").click()
    second.reload()
    is_joined(second)
    expect(result).to_have_count(0)


def test_a_form_posted_without_javascript_is_kept_by_the_button_and_done_once(
    house: House, open_tab: OpenTab, scriptless: Browser
) -> None:
    a_bank(house)
    page = open_tab(house, lang="ko-KR", of=scriptless)
    form = write_entry(page, "맡긴 요청", "4500")
    with outage(house):
        save(form)
        expect(page.get_by_text("방금 보낸 요청은 아직 처리하지 않았어요.")).to_be_visible()
        page.get_by_role("button", name="요청 맡겨 두기").click()
        expect(page.get_by_role("heading", name="기다리는 요청 1건")).to_be_visible()
        expect(page.get_by_text("이 창을 닫아도 요청은 남아 있어요.")).to_be_visible()
    expect(page.get_by_role("heading", name="요청을 처리했어요")).to_be_visible()
    page.get_by_role("link", name="내역 보기").click()
    expect(page.get_by_text("맡긴 요청")).to_be_visible()
    assert booked(house, "맡긴 요청") == 1


def test_a_wish_that_has_grown_old_is_asked_about_and_done_only_then(
    new_house: MakeHouse, open_tab: OpenTab
) -> None:
    house = new_house(
        spare=False, gateway={"hold_ms": 500, "drain_ms": 1_000, "receipt_ask_after_ms": OLD_MS}
    ).up()
    a_bank(house)
    page = open_tab(house)
    is_joined(page)
    form = write_entry(page, "Grown old", "4500")
    with outage(house):
        send_now(form)
        expect(form.locator("[data-said]")).to_contain_text("You can close this window")
        key = form.locator("[name=_idempotency_key]").input_value()
        until(lambda: answer_of(house, f"/__hc/receipts/{key}")["age_ms"] > OLD_MS, "the promise to grow old")
    asked = card(page, "Things changed meanwhile")
    expect(asked).to_be_visible()
    assert booked(house, "Grown old") == 0
    asked.get_by_role("button", name="Run it").click()
    is_saved(form)
    expect(asked).to_have_count(0)
    assert booked(house, "Grown old") == 1
