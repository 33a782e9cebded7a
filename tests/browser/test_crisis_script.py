"""The browser's half of a takeover, moment by moment: what is shown, what is claimed, what is kept.

The gateway here is scripted (scripted_gateway.py), because most of these moments last for milliseconds with the
real one; that the real one says the same is shown beside this, with a house.
"""

import json
from typing import Any

import pytest
from playwright.sync_api import expect

from tests.browser.scripted_gateway import SERVING, ScriptedGateway, back, down
from tests.browser.scripted_pages import OpenLedger, is_over, marks, overlay, shows

# -- the life of an outage -----------------------------------------------------------------------------


def test_every_event_has_its_move_in_every_mode(open_ledger: OpenLedger) -> None:
    moves = open_ledger().evaluate(
        """async () => Object.entries((await import("/source/outage.js")).MOVES)
        .map(([mode, row]) => [mode, Object.keys(row).sort().join()])"""
    )
    events = ",".join(sorted(["down", "serving", "back", "verified", "lost", "out", "tick", "dismiss"]))
    modes = "calm sign card result short lost again unsound out"
    assert {mode for mode, _ in moves} == set(modes.split())
    assert {row for _, row in moves} == {events}


def test_the_first_sign_comes_before_the_overlay(open_ledger: OpenLedger, gateway: ScriptedGateway) -> None:
    page = open_ledger()
    page.evaluate("addEventListener('keydown', () => {}); window.seen = []")
    page.evaluate("document.addEventListener('hc:down', (event) => seen.push(event.detail.text))")
    gateway.say(down())
    shows(page, "Restarting the server")
    assert page.evaluate("seen") == ["R1"]
    marks(page, "down")
    assert page.title() == "(Recovering) Ledger"
    expect(overlay(page)).to_be_visible()
    shows(page, "Starting the server")


def test_a_break_that_is_over_at_once_shows_no_overlay_and_claims_nothing_unproven(
    open_ledger: OpenLedger, gateway: ScriptedGateway
) -> None:
    page = open_ledger()
    gateway.say(down())
    is_over(gateway, back(212))
    shows(page, "Interrupted for 212 ms")
    assert overlay(page).count() == 0
    assert page.get_by_text("Nothing was lost.").count() == 0
    gateway.say({"v": 1, "type": "verified", "ok": True})
    shows(page, "Nothing was lost.")


def test_the_overlay_comes_at_once_when_history_says_that_it_lasts(
    open_ledger: OpenLedger, gateway: ScriptedGateway
) -> None:
    page = open_ledger()
    gateway.say(down(eta={"low_s": 2, "high_s": 4, "samples": 7}, samples=7))
    expect(overlay(page)).to_be_visible()
    shows(page, "Usually 2-4 seconds")


def test_the_overlay_waits_a_second_when_history_says_that_it_is_brief(open_ledger: OpenLedger) -> None:
    due = open_ledger().evaluate(
        """async ([brief, unknown]) => {
          const { CALM, next } = await import("/source/outage.js");
          return [brief, unknown].map((frame) => next(CALM, frame, 5000).due_ms - 5000);
        }""",
        [down(elapsed_ms=20, eta={"low_s": 0, "high_s": 1, "samples": 9}), down(elapsed_ms=20)],
    )
    assert due == [980, 400]


def test_a_proof_that_comes_later_turns_the_neutral_card_into_the_proven_one(
    open_ledger: OpenLedger, gateway: ScriptedGateway
) -> None:
    page = open_ledger("/ko")
    gateway.say(down("R7b", elapsed_ms=2000))
    expect(overlay(page)).to_be_visible()
    is_over(gateway, back(3210))
    shows(page, "다시 사용할 수 있어요")
    shows(page, "잔액 확인은 뒤에서 계속하고 있어요.")
    assert overlay(page).count() == 0
    gateway.say({"v": 1, "type": "verified", "ok": True})
    shows(page, "모든 잔액이 맞는 것을 확인했어요.")
    assert page.title() == "✓ Ledger"
    page.get_by_role("button", name="닫기").click()
    expect(page.get_by_text("다시 사용할 수 있어요")).to_be_hidden()
    assert page.title() == "Ledger"


def test_a_proof_that_failed_is_said(open_ledger: OpenLedger, gateway: ScriptedGateway) -> None:
    page = open_ledger()
    gateway.say(down("R7b"))
    is_over(gateway, back(3000))
    gateway.say({"v": 1, "type": "verified", "ok": False})
    shows(page, "A balance does not match")
    assert page.get_by_text("All balances were checked").count() == 0


def test_escape_does_not_close_the_overlay_while_it_recovers_and_does_when_nobody_tries(
    open_ledger: OpenLedger, gateway: ScriptedGateway
) -> None:
    page = open_ledger()
    gateway.say(down("R7b"))
    expect(overlay(page)).to_be_visible()
    for _ in range(4):
        page.keyboard.press("Escape")
    expect(overlay(page)).to_be_visible()
    gateway.say(down("R8", phase="FATAL"))
    shows(page, "Automatic recovery has stopped")
    page.get_by_text("Details").click()
    shows(page, "hardcore resume")
    page.keyboard.press("Escape")
    expect(overlay(page)).to_have_count(0)
    shows(page, "Automatic recovery has stopped")


def test_the_page_is_told_that_it_is_back_once_also_when_only_the_state_says_so(
    open_ledger: OpenLedger, gateway: ScriptedGateway
) -> None:
    page = open_ledger()
    page.evaluate(
        "window.seen = []; document.addEventListener('hc:back', (event) => seen.push(event.detail.type))"
    )
    for frames in ([back(100), SERVING], [SERVING, back(100)], [SERVING]):
        gateway.say(down())
        marks(page, "down")
        for frame in frames:
            gateway.say(frame)
        marks(page, "serving")
    assert page.evaluate("seen") == ["back"] * 3


# -- the page underneath -------------------------------------------------------------------------------


def test_the_overlay_waits_for_a_pause_of_whoever_is_typing(
    open_ledger: OpenLedger, gateway: ScriptedGateway
) -> None:
    page = open_ledger()
    page.evaluate(
        """document.addEventListener("hc:down", () => {
          window.seen = [document.activeElement.name, document.querySelectorAll("dialog:modal").length];
        })"""
    )
    page.focus("[name=memo]")
    page.keyboard.type("half")
    gateway.say(down("R7b"))
    marks(page, "down")
    assert page.evaluate("seen") == ["memo", 0]
    expect(overlay(page)).to_be_visible()
    assert page.input_value("[name=memo]") == "half"


def test_the_wait_for_a_pause_ends_and_never_in_the_middle_of_a_syllable(open_ledger: OpenLedger) -> None:
    page = open_ledger()
    page.evaluate(
        """async () => {
          window.now = 10000; performance.now = () => now;
          const { watchTyping } = await import("/source/typing.js");
          window.typing = watchTyping();
        }"""
    )
    page.focus("[name=memo]")
    pause = "(at_ms) => { now = at_ms; return typing.pause(at_ms); }"
    assert page.evaluate(pause, 10000) == 10000
    page.keyboard.press("a")
    assert page.evaluate(pause, 10100) == 10600
    page.evaluate("now = 11400")
    page.keyboard.press("b")
    assert page.evaluate(pause, 11500) == 11600
    assert page.evaluate(pause, 11600) == 11600
    page.evaluate("typing.rest(); now = 20000")
    keys = page.context.new_cdp_session(page)
    keys.send("Input.imeSetComposition", {"text": "하", "selectionStart": 1, "selectionEnd": 1})
    assert page.evaluate(pause, 20100) == 20600
    page.evaluate("now = 21900")
    keys.send("Input.imeSetComposition", {"text": "한", "selectionStart": 1, "selectionEnd": 1})
    assert page.evaluate(pause, 22000) == 22500


def test_text_selection_and_place_are_as_they_were(open_ledger: OpenLedger, gateway: ScriptedGateway) -> None:
    page = open_ledger()
    page.fill("[name=memo]", "half of a sentence")
    page.evaluate("document.querySelector('[name=memo]').setSelectionRange(5, 7); scrollTo(0, 300)")
    gateway.say(down("R7b"))
    expect(overlay(page).get_by_role("heading")).to_be_focused()
    is_over(gateway, back(1500))
    expect(page.locator("[name=memo]")).to_be_focused()
    place = "(({selectionStart, selectionEnd, value}) => [selectionStart, selectionEnd, value, scrollY])"
    assert page.evaluate(f"{place}(document.querySelector('[name=memo]'))") == [
        5,
        7,
        "half of a sentence",
        300,
    ]
    page.keyboard.type("X")
    assert page.input_value("[name=memo]") == "half X a sentence"


def test_a_dialog_of_the_page_stays_open_underneath(
    open_ledger: OpenLedger, gateway: ScriptedGateway
) -> None:
    page = open_ledger()
    page.evaluate("document.getElementById('own').showModal()")
    page.fill("#inside", "kept")
    gateway.say(down("R7b"))
    expect(overlay(page)).to_be_visible()
    is_over(gateway, back(900))
    expect(overlay(page)).to_have_count(0)
    expect(page.locator("#inside")).to_be_focused()
    assert page.input_value("#inside") == "kept"
    shows(page, "You are back")


def test_a_restart_that_was_asked_for_speaks_of_no_problem(
    open_ledger: OpenLedger, gateway: ScriptedGateway
) -> None:
    page = open_ledger()
    gateway.say(down("R2", stage=2, phase="STOPPING", eta={"low_s": 2, "high_s": 3, "samples": 6}))
    shows(page, "Nothing is broken.")
    shows(page, "Restart asked for")
    assert page.get_by_text("Problem found").count() == 0


def test_the_language_can_be_switched_on_the_overlay(
    open_ledger: OpenLedger, gateway: ScriptedGateway
) -> None:
    page = open_ledger("/ko")
    gateway.say(down("R7b"))
    page.get_by_role("button", name="English").click()
    shows(page, "Taking longer than usual")


def test_what_was_typed_can_be_copied_out_of_the_overlay(
    open_ledger: OpenLedger, gateway: ScriptedGateway
) -> None:
    page = open_ledger(permissions=["clipboard-read", "clipboard-write"])
    page.fill("#entry [name=what]", "tea")
    page.fill("[name=secret]", "hunter2")
    gateway.say(down("R7b"))
    page.get_by_role("button", name="Copy my text").click()
    shows(page, "Copied")
    assert page.evaluate("navigator.clipboard.readText()") == "what: tea"


@pytest.mark.parametrize("lang", ["ko", "en"])
@pytest.mark.parametrize("scale", ["100%", "200%"])
def test_nothing_is_cut_off_on_a_phone(
    open_ledger: OpenLedger, gateway: ScriptedGateway, lang: str, scale: str
) -> None:
    page = open_ledger(f"/{lang}", viewport={"width": 390, "height": 700})
    page.evaluate("(scale) => { document.documentElement.style.fontSize = scale }", scale)
    page.fill("#entry [name=what]", "tea")
    for text, phase in (("R1", "STARTING"), ("R7b", "KILLING"), ("R8", "FATAL"), ("OFF", "STOPPED")):
        gateway.say(down(text, phase=phase, held=3, eta={"low_s": 1, "high_s": 2, "samples": 9}))
        expect(overlay(page)).to_be_visible()
        wide = overlay(page).evaluate(
            "(dialog) => [...dialog.querySelectorAll('*')].filter((one) => !one.closest('.unseen')"
            " && one.getBoundingClientRect().right > 391).map((one) => one.outerHTML)"
        )
        assert wide == []


def test_a_card_leaves_a_phone_its_bottom_bar(open_ledger: OpenLedger, gateway: ScriptedGateway) -> None:
    page = open_ledger(viewport={"width": 390, "height": 700})
    gateway.say(down("R7b"))
    is_over(gateway, back(3000))
    shows(page, "You are back")
    expect(page.locator(".corner")).to_be_visible()
    page.evaluate("Promise.all(document.getAnimations().map((one) => one.finished))")
    box = page.locator(".corner").bounding_box()
    assert box is not None
    assert box["y"] + box["height"] <= 700 - 64
    assert box["height"] <= 140


# -- what waits ----------------------------------------------------------------------------------------


def test_waiting_requests_of_the_page_are_counted(open_ledger: OpenLedger, gateway: ScriptedGateway) -> None:
    page = open_ledger()
    gateway.say(down("R7b"))
    page.evaluate("document.dispatchEvent(new CustomEvent('hc:pending', {detail: {count: 2}}))")
    shows(page, "2 waiting in this window")
    shows(page, "Keep this window open")
    assert page.get_by_text("2 waiting", exact=True).count() == 0
    page.evaluate("document.dispatchEvent(new CustomEvent('hc:pending', {detail: {count: 0}}))")
    expect(page.get_by_text("2 waiting in this window", exact=True)).to_be_hidden()


def test_what_the_gateway_holds_and_what_waits_in_the_page_are_two_sentences(
    open_ledger: OpenLedger, gateway: ScriptedGateway
) -> None:
    page = open_ledger()
    page.evaluate("document.dispatchEvent(new CustomEvent('hc:pending', {detail: {count: 2}}))")
    gateway.say(down("R7b", held=1))
    shows(page, "2 waiting in this window")
    expect(overlay(page).get_by_text("1 waiting", exact=True)).to_be_visible()


def test_a_request_that_may_carry_a_file_is_never_called_slow(open_ledger: OpenLedger) -> None:
    counted = open_ledger().evaluate(
        """async () => {
          window.fetch = () => new Promise(() => {});
          const { watchRequests } = await import("/source/slowness.js?bench");
          watchRequests(() => {});
          let timers = 0;
          window.setTimeout = () => { timers += 1; };
          const body = new FormData();
          void fetch(new Request("/upload", { method: "POST", body }));
          void fetch("/upload", { method: "POST", body });
          const uploads = timers;
          void fetch(new Request("/list"));
          return [uploads, timers];
        }"""
    )
    assert counted == [0, 1]


def test_a_slow_answer_is_said_while_the_page_stays_usable(open_ledger: OpenLedger) -> None:
    page = open_ledger()
    held: list[Any] = []
    page.route("**/slow", lambda route: held.append(route))  # noqa: PLW0108 - it is asked for its parameters
    page.evaluate("void fetch('/slow').catch(() => {})")
    shows(page, "The server is slow to answer")
    marks(page, "slow")
    page.fill("#loose", "still typing")
    held[0].fulfill(status=200, body="")
    expect(page.get_by_text("The server is slow to answer", exact=True)).to_be_hidden()
    marks(page, "serving")


# -- the line ------------------------------------------------------------------------------------------


def test_a_lost_line_is_told_apart_from_a_server_that_is_out(
    open_ledger: OpenLedger, gateway: ScriptedGateway
) -> None:
    page = open_ledger()
    page.context.set_offline(True)
    gateway.hang_up()
    shows(page, "No connection to the server")
    marks(page, "down")
    assert overlay(page).count() == 0
    page.context.set_offline(False)
    shows(page, "Connected again")
    marks(page, "serving")


def test_a_server_that_said_it_is_switched_off_is_not_taken_for_a_bad_network(
    open_ledger: OpenLedger, gateway: ScriptedGateway
) -> None:
    page = open_ledger()
    gateway.say(down("OFF", phase="STOPPED"))
    # A socket that is tried again and fails: by then the line was found to be lost.
    with page.expect_console_message(lambda message: "WebSocket" in message.text):
        page.context.set_offline(True)
        gateway.hang_up()
    shows(page, "The server is switched off")
    assert page.get_by_text("No connection to the server").count() == 0
    page.context.set_offline(False)
    gateway.say(SERVING)
    shows(page, "You are back")


def test_without_a_socket_the_state_is_asked_for(open_ledger: OpenLedger, gateway: ScriptedGateway) -> None:
    gateway.refuses_sockets = True
    page = open_ledger()
    gateway.say(down("R7b"))
    expect(overlay(page)).to_be_visible()
    gateway.say(SERVING)
    shows(page, "You are back")


def test_frames_that_cannot_be_read_change_nothing(open_ledger: OpenLedger, gateway: ScriptedGateway) -> None:
    page = open_ledger()
    for frame in ({"v": 2, "type": "state"}, {"v": 1, "type": "news"}, {"type": "back"}):
        gateway.say(frame)
    gateway.say(down())
    shows(page, "Restarting the server")


# -- drafts --------------------------------------------------------------------------------------------


def test_a_draft_survives_a_reload_and_secrets_are_never_kept(open_ledger: OpenLedger) -> None:
    page = open_ledger()
    for name, typed in {
        "what": "tea",
        "amount": "4500",
        "secret": "s3cret",
        "code": "123456",
        "mine": "m1ne",
    }.items():
        page.fill(f"#entry [name={name}]", typed)
    page.goto("/en?again")  # another address of the same path: a new page that restores nothing by itself
    shows(page, "Restored what you typed")
    shows(page, "It has not been sent.")
    assert [page.input_value(f"#entry [name={name}]") for name in ("what", "amount", "secret", "code", "mine")] == [
        "tea", "4500", "", "", "",
    ]  # fmt: skip
    kept = json.dumps(page.evaluate("({...sessionStorage})"))
    assert not any(secret in kept for secret in ("s3cret", "123456", "m1ne"))
    page.get_by_role("button", name="Undo").click()
    assert [page.input_value(f"#entry [name={name}]") for name in ("what", "amount")] == ["", "0"]


def test_a_password_that_is_shown_for_a_moment_is_not_kept(open_ledger: OpenLedger) -> None:
    page = open_ledger()
    page.focus("#entry [name=secret]")
    page.evaluate("document.querySelector('#entry [name=secret]').type = 'text'")
    page.keyboard.type("s3cret")
    page.fill("#entry [name=what]", "tea")
    page.goto("/en?again")
    shows(page, "Restored what you typed")
    kept = json.dumps(page.evaluate("({...sessionStorage})"))
    assert "tea" in kept
    assert "s3cret" not in kept


def test_a_draft_that_was_sent_is_forgotten_and_one_that_may_have_been_claims_nothing(
    open_ledger: OpenLedger,
) -> None:
    page = open_ledger()
    page.evaluate("document.addEventListener('submit', (event) => event.preventDefault())")
    page.fill("#other [name=what]", "kept")
    page.fill("#entry [name=what]", "tea")
    page.get_by_role("button", name="Save").click()
    page.goto("/en?again")
    shows(page, "Please check the records to see whether it was sent.")
    page.evaluate(
        "document.getElementById('entry').dispatchEvent(new CustomEvent('hc:sent', {bubbles: true}))"
    )
    page.evaluate("document.getElementById('entry').reset()")
    page.goto("/en?third")
    assert page.input_value("#entry [name=what]") == ""
    assert page.input_value("#other [name=what]") == "kept"


def test_stored_is_said_only_of_what_was_read_back(open_ledger: OpenLedger, gateway: ScriptedGateway) -> None:
    page = open_ledger()
    page.evaluate(
        "() => { Storage.prototype.setItem = () => { throw new DOMException('full', 'QuotaExceededError') } }"
    )
    page.fill("#entry [name=what]", "tea")
    gateway.say(down("R7b"))
    shows(page, "What you were typing is still on this page.")
    assert page.get_by_text("stored in this browser").count() == 0
