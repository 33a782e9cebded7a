"""What stands on the screen at each moment after a fault, what a screen reader hears, and where a person is meanwhile.

Time belongs to the test here: the page's clock is stopped and moved on by hand, so that the screen is looked at 100 ms,
400 ms, a second and ten seconds after the fault, and not at about that time. Somebody is in the middle of a sentence in
each of them.
"""

from collections.abc import Callable, Mapping
from typing import Any, Final

import msgspec
import pytest
from playwright.sync_api import Page, expect

from frontend.catalogue_crisis import words
from frontend.render import Language
from tests import waiting
from tests.browser.scripted_gateway import SERVING, ScriptedGateway, back, down
from tests.browser.scripted_pages import OpenLedger, marks

EN: Final = words("en")
TYPED: Final = "half of a sent"
LASTING: Final[dict[str, Any]] = {"eta": {"low_s": 2, "high_s": 4, "samples": 7}, "samples": 7}
BRIEF: Final[dict[str, Any]] = {"eta": {"low_s": 0, "high_s": 1, "samples": 7}, "samples": 7}

#: All that can be perceived of the crisis script, found by what it is.
_PERCEIVED: Final = r"""() => {
  const roots = [...document.querySelectorAll("*")].map((one) => one.shadowRoot).filter(Boolean);
  const find = (what) => roots.map((root) => root.querySelector(what)).find(Boolean) ?? null;
  const seen = (what) => (find(what)?.checkVisibility() ? find(what).innerText.replace(/\s+/g, " ").trim() : null);
  let focus = document.activeElement;
  while (focus?.shadowRoot?.activeElement) focus = focus.shadowRoot.activeElement;
  return {
    strip: seen(".strip:not(.notice):popover-open"), card: seen("section.card"), bar: seen(".bar"),
    notice: seen(".notice:popover-open"), modal: find("dialog:modal") !== null,
    heard: find("[role=status]").textContent, title: document.title, mark: document.documentElement.dataset.hc,
    focus: focus?.id || focus?.name || focus?.localName, typed: document.querySelector("[name=memo]").value,
  };
}"""
#: Writes down each sentence that the polite status line has a screen reader say, and each frame that was heard.
_LISTEN: Final = """() => {
  window.said = []; window.frames = 0;
  const line = [...document.querySelectorAll("*")].map((one) => one.shadowRoot?.querySelector("[role=status]")).find(Boolean);
  new MutationObserver(() => said.push(line.textContent)).observe(line, { childList: true, characterData: true, subtree: true });
  for (const kind of ["hc:state", "hc:receipt"]) document.addEventListener(kind, () => { frames += 1; });
}"""


class Seen(msgspec.Struct, frozen=True):
    """One look. Texts are None where nothing is shown; `modal`: the overlay has the page."""

    strip: str | None
    card: str | None
    bar: str | None
    notice: str | None
    modal: bool
    heard: str
    title: str
    mark: str
    focus: str
    typed: str


class Desk:
    """A page whose time stands still until it is moved on, and somebody who has just paused in a sentence."""

    def __init__(self, page: Page, gateway: ScriptedGateway) -> None:
        self.page, self._gateway = page, gateway
        page.evaluate("window.patience = AbortSignal.timeout.bind(AbortSignal)")
        page.clock.install(time=0)
        page.clock.pause_at(10_000)
        # An answer of the gateway travels in the world's time: the patience with it must not run out in the test's.
        page.evaluate("AbortSignal.timeout = patience")
        page.evaluate(_LISTEN)
        page.fill("[name=memo]", "")  # a draft of the state before may be there
        page.keyboard.type(TYPED)
        self.later(2_000)

    def later(self, ms: int) -> Seen:
        """Let so much time go by; what is perceived then."""
        self.page.clock.run_for(ms)
        return self.now()

    def now(self) -> Seen:
        """What is perceived."""
        return msgspec.convert(self.page.evaluate(_PERCEIVED), Seen)

    def hear(self, *frames: Mapping[str, Any]) -> Seen:
        """Have the gateway say them, and wait until the last is heard; no time goes by."""
        for frame in frames:
            before = self.page.evaluate("frames")
            self._gateway.say(frame)
            if frame["type"] in {"state", "receipt"}:
                waiting.until(lambda b=before: self.page.evaluate("frames") > b, "the page to hear it")  # type: ignore[misc]
        return self.now()

    def said(self) -> list[str]:
        """What a screen reader was given to say since the last time."""
        told: list[str] = self.page.evaluate("said.splice(0)")
        return told


@pytest.fixture
def desk(open_ledger: OpenLedger, gateway: ScriptedGateway) -> Desk:
    """Somebody at an English page."""
    return Desk(open_ledger(), gateway)


def at_their_text(seen: Seen) -> bool:
    """Whether the person is where they were, and so is the text."""
    return (seen.focus, seen.typed, seen.modal) == ("memo", TYPED, False)


# -- the moments of an outage --------------------------------------------------------------------------


def test_a_sign_comes_at_once_and_the_overlay_after_its_grace_while_the_text_stays(desk: Desk) -> None:
    for seen in (desk.hear(down()), desk.later(100), desk.later(299)):  # until 399 ms
        assert (seen.strip, seen.card, seen.mark) == (EN["R1"], None, "down")
        assert seen.title == f"{EN['title.down']} Ledger"
        assert at_their_text(seen)
    overlay = desk.later(1)
    assert (overlay.strip, overlay.modal, overlay.focus, overlay.typed) == (None, True, "hc-head", TYPED)
    card = overlay.card or ""
    for code in ("R1", "R1.line", "draft.stored", "eta.none", "stage.1", "stage.4", "keep", "details"):
        assert EN[code] in card
    assert "0 s so far" in card
    assert "1 s so far" in (desk.later(600).card or "") + (
        desk.later(400).card or ""
    )  # at a second, and a little
    late = desk.later(9_000)
    assert "10 s so far" in (late.card or "")
    assert late.typed == TYPED
    came = desk.hear(back(10_500, verified=True), SERVING)
    assert at_their_text(came)
    assert (came.mark, came.title) == ("serving", f"{EN['title.back']} Ledger")
    assert EN["R3.verified"] in (came.card or "")
    desk.page.keyboard.type("ence")
    gone = desk.later(8_001)
    assert (gone.card, gone.strip, gone.title, gone.typed) == (None, None, "Ledger", TYPED + "ence")


def test_known_to_last_it_is_an_overlay_at_once_and_with_what_is_promised(desk: Desk) -> None:
    seen = desk.hear(down(**LASTING))
    assert (seen.modal, seen.strip, seen.focus) == (True, None, "hc-head")
    assert "Usually 2-4 seconds · 0 s so far" in (seen.card or "")
    assert "Usually 2-4 seconds · 3 s so far" in (desk.later(3_000).card or "")
    # The guard says that it takes longer: what was promised is over.
    longer = desk.hear(down("R7b", elapsed_ms=4_100)).card or ""
    assert EN["R7"] in longer
    assert EN["R7b.line"] in longer
    assert "Usually" not in longer


def test_known_to_be_brief_it_stays_a_strip_for_a_second(desk: Desk) -> None:
    for seen in (desk.hear(down(**BRIEF)), desk.later(400), desk.later(599)):
        assert seen.strip == EN["R1"]
        assert at_their_text(seen)
    assert desk.later(1).modal


def test_over_before_the_overlay_was_due_it_was_never_more_than_a_strip(desk: Desk) -> None:
    desk.hear(down())
    desk.later(399)
    over = desk.hear(back(399), SERVING)
    assert over.strip == "Interrupted for 399 ms"
    for seen in (over, desk.later(100), desk.later(4_000)):
        assert seen.card is None
        assert at_their_text(seen)
    assert desk.later(1_000).strip is None


def test_a_restart_that_was_asked_for_is_silent_until_the_overlay_is_due(desk: Desk) -> None:
    for seen in (desk.hear(down("R2", stage=2, phase="STOPPING")), desk.later(100), desk.later(299)):
        assert (seen.strip, seen.card, seen.heard, seen.title, seen.mark) == (
            None,
            None,
            "",
            "Ledger",
            "serving",
        )
    seen = desk.later(1)
    assert seen.modal
    assert EN["R2"] in (seen.card or "")
    assert EN["R2.line"] in (seen.card or "")


def test_a_screen_reader_hears_each_stage_once_then_every_ten_seconds_and_the_end(desk: Desk) -> None:
    desk.hear(down(stage=1, phase="SNAPSHOT_LIVE"))
    desk.later(500)
    desk.hear(down(stage=3, elapsed_ms=500))
    desk.hear(down(stage=3, elapsed_ms=700, held=1))  # what changes nothing in the sentence is not said
    desk.later(8_000)
    stage = f"{EN['R1']} Current step: {EN['stage.3']}."
    assert desk.said() == [EN["R1"], f"{EN['R1']} Current step: {EN['stage.1']}.", stage]
    desk.later(13_000)
    assert desk.said() == [f"{stage} 10 s so far", f"{stage} 20 s so far"]
    desk.hear(back(22_000), SERVING)
    desk.later(2_000)
    assert desk.said() == [
        "You are back It took 22 seconds. Balance check is still running in the background."
    ]
    desk.hear({"v": 1, "type": "verified", "ok": True})
    waiting.until(lambda: len(desk.page.evaluate("said")) == 1, "the proof to be told")
    assert desk.said() == ["You are back It took 22 seconds. All balances were checked and match."]


def test_nothing_is_said_twice_or_goes_away_while_nobody_looks(desk: Desk) -> None:
    desk.hear(down("R7b"), back(3_000), SERVING)
    desk.page.evaluate(
        """() => { Object.defineProperty(document, "hidden", { get: () => true, configurable: true });
          document.dispatchEvent(new Event("visibilitychange")); }"""
    )
    assert EN["R3"] in (desk.later(30_000).card or "")
    desk.page.evaluate(
        "() => { delete document.hidden; document.dispatchEvent(new Event('visibilitychange')); }"
    )
    assert EN["R3"] in (desk.later(2_900).card or "")  # half of its time at least, from when it may be read
    assert desk.later(8_000).card is None


# -- every state ---------------------------------------------------------------------------------------


class State(msgspec.Struct, frozen=True):
    """How a state comes about, and what is perceived of it. `says`: codes of the catalogue, where `place` is; `never`:
    codes that would claim what nobody knows here."""

    frames: tuple[Mapping[str, Any], ...]
    place: str
    says: tuple[str, ...]
    never: tuple[str, ...] = ()
    mark: str = "down"
    title: str | None = "title.down"
    modal: bool = True
    after_ms: int = 0


_CLAIMS: Final = ("R3.verified", "R3c.verified", "R7b.line", "R10", "R8.line", "OFF.line")
_VERIFIED: Final = {"v": 1, "type": "verified", "ok": True}
_WAITS: Final = {"v": 1, "type": "receipt", "key": "a-key-f0f1f2f3", "outcome": "waiting"}
STATES: Final[Mapping[str, State]] = {
    "R1": State((down(),), "card", ("R1", "R1.line", "draft.stored"), after_ms=400),
    "R1b": State((down(**LASTING, held=2, promised=0),), "card", ("R1b.line", "R1b.open"), ("R1c",)),
    "R1c": State((_WAITS, down(**LASTING, held=1, promised=1)), "card", ("R1b.line",), ("R1b.open",)),
    "R2": State((down("R2", stage=2),), "card", ("R2", "R2.line", "plan.1", "plan.2"), ("stage.1",), after_ms=400),
    "R3": State(
        (down("R7"), back(4_200, verified=True), SERVING), "card", ("R3", "R3.verified"), ("R3b.line",),
        mark="serving", title="title.back", modal=False,
    ),
    "R3b": State(
        (down("R7"), back(4_200), SERVING), "card", ("R3", "R3b.line"), ("R3.verified",),
        mark="serving", title="title.back", modal=False,
    ),
    "R3c": State(
        (down(), back(212), SERVING, _VERIFIED), "strip", ("R3c.verified",),
        mark="serving", title="title.back", modal=False,
    ),
    "R7": State((down("R7"),), "card", ("R7",), ("R7b.line", "R1.line")),
    "R7b": State((down("R7b"),), "card", ("R7", "R7b.line"), ("R1.line",)),
    "R8": State(
        (down("R8", phase="FATAL"),), "card", ("R8", "R8.line", "R8.admin", "close"), ("stage.1", "elapsed"),
        mark="stopped", title="title.stopped",
    ),
    "OFF": State(
        (down("OFF", phase="STOPPED"),), "card", ("OFF", "OFF.line", "close"), ("stage.1", "R8.admin"),
        mark="off", title="title.off",
    ),
    "R9": State(
        ({**SERVING, "safe": "DISK_FULL"},), "bar", ("R9", "R9.DISK_FULL", "R9.line"), ("R10",),
        mark="safe", title=None, modal=False,
    ),
    "R10": State(
        ({**SERVING, "safe": "STORE_CORRUPT"},), "bar", ("R10", "R10.safe", "R10.line"), ("R9.line",),
        mark="safe", title=None, modal=False,
    ),
    "R10, still taking changes": State(
        ({**SERVING, "sound": False},), "card", ("R10", "R10.line"), ("R10.safe", "R9.line"),
        mark="serving", title=None, modal=False,
    ),
}  # fmt: skip


@pytest.mark.parametrize("lang", ["ko", "en"])
def test_every_state_says_its_own_words_and_claims_nothing_else(
    open_ledger: OpenLedger, gateway: ScriptedGateway, lang: Language
) -> None:
    says = words(lang)
    page = open_ledger(f"/{lang}")
    for name, state in STATES.items():
        gateway.forget()
        page.goto(f"/{lang}?{name.partition(',')[0]}")
        marks(page, "serving")
        desk = Desk(page, gateway)
        desk.hear(*state.frames)
        seen = desk.later(state.after_ms)
        shown = getattr(seen, state.place)
        assert shown is not None, (name, seen)
        for code in state.says:
            assert says[code] in shown, (name, code, shown)
        everything = " ".join(filter(None, (seen.strip, seen.card, seen.bar)))
        for code in {*state.never, *_CLAIMS} - {*state.says}:
            assert says[code] not in everything, (name, code, everything)
        assert (seen.mark, seen.modal) == (state.mark, state.modal), name
        assert seen.title == (f"{says[state.title]} Ledger" if state.title else "Ledger"), name
        assert says[state.says[0]].rstrip(".") in seen.heard or state.place == "card", name
        assert seen.heard, name  # each of them is heard, by whoever does not see it
        assert seen.typed == TYPED, name
        assert seen.focus == ("hc-head" if state.modal else "memo"), name


def test_where_nobody_tries_any_more_the_administrator_is_one_press_away(
    open_ledger: OpenLedger, gateway: ScriptedGateway
) -> None:
    page = open_ledger()
    gateway.say(down("R8", phase="FATAL"))
    link = page.get_by_role("link", name=EN["R8.admin"])
    expect(link).to_have_attribute("href", "/admin/")
    gateway.say(down("R1"))
    expect(link).to_have_count(0)
    gateway.recovering = ("en", "stopped_trying", "get")
    gateway.say(down("R8", phase="FATAL"))
    page.goto("/en?again")
    expect(link).to_be_visible()


# -- away from the screen ------------------------------------------------------------------------------


def frozen(page: Page) -> Callable[[], None]:
    """Put the page to sleep, as a phone does with one that nobody looks at; gives what wakes it."""
    phone = page.context.new_cdp_session(page)
    phone.send("Page.setWebLifecycleState", {"state": "frozen"})

    def wake() -> None:
        phone.send("Page.setWebLifecycleState", {"state": "active"})

    return wake


def test_a_page_that_slept_through_an_outage_says_how_long_it_was_and_keeps_what_was_typed(
    open_ledger: OpenLedger, gateway: ScriptedGateway
) -> None:
    page = open_ledger()
    page.fill("[name=memo]", TYPED)
    wake = frozen(page)
    gateway.say(down())
    gateway.say(back(3_400))
    gateway.say(SERVING)
    wake()
    marks(page, "serving")
    expect(page.get_by_text("Interrupted for 3.4 seconds").locator("visible=true").first).to_be_visible()
    assert page.input_value("[name=memo]") == TYPED


def test_a_page_whose_line_was_cut_in_its_sleep_asks_at_once_when_it_wakes(
    open_ledger: OpenLedger, gateway: ScriptedGateway
) -> None:
    page = open_ledger()
    page.fill("[name=memo]", TYPED)
    wake = frozen(page)
    gateway.hang_up()
    gateway.say(down("R7b"))
    wake()
    expect(page.get_by_text(EN["R7b.line"]).locator("visible=true").first).to_be_visible()
    marks(page, "down")
    assert page.input_value("[name=memo]") == TYPED


def test_what_one_tab_puts_aside_the_other_goes_on_saying(
    open_ledger: OpenLedger, gateway: ScriptedGateway
) -> None:
    first = open_ledger()
    second = first.context.new_page()
    second.goto("/en")
    marks(second, "serving")
    gateway.say(down("R8", phase="FATAL"))
    for page in (first, second):
        marks(page, "stopped")
        expect(page.locator("dialog:modal")).to_have_count(1)
    second.keyboard.press("Escape")
    expect(second.locator("dialog:modal")).to_have_count(0)
    expect(first.locator("dialog:modal")).to_have_count(1)
    gateway.say(SERVING)
    for page, told in ((first, EN["R3"]), (second, "Interrupted for")):
        marks(page, "serving")
        expect(page.get_by_text(told).locator("visible=true").first).to_be_visible()
