"""The crisis script's line to the gateway: when it asks, whom it doubts, and when it calls itself lost.

Sockets, answers and timers are made by hand in most of these, because the point is their order; a whole page that
meets the same is at the end.
"""

from typing import Any, Final

import pytest
from playwright.sync_api import Page, expect

from tests.browser.scripted_gateway import SERVING, ScriptedGateway, down
from tests.browser.scripted_pages import OpenLedger, marks, overlay, shows

#: Opens a channel whose sockets, questions and timers belong to the test. `turn()` lets promises go on.
BENCH: Final = """async () => {
  const bench = { sockets: [], asks: [], timers: [], heard: [] };
  const later = window.setTimeout.bind(window);
  bench.turn = () => new Promise((done) => later(done, 0));
  window.setTimeout = (act, ms) => bench.timers.push({ act, ms });
  window.clearTimeout = (id) => { if (bench.timers[id - 1]) bench.timers[id - 1].act = null; };
  bench.due = () => bench.timers.filter((one) => one.act);
  bench.ring = () => bench.due().forEach((one) => { const { act } = one; one.act = null; act(); });
  window.fetch = () => new Promise((answer, fail) => bench.asks.push({
    answer: (frame) => answer({ ok: true, text: async () => JSON.stringify(frame) }), fail: () => fail(new TypeError("gone")),
  }));
  window.WebSocket = class {
    constructor() { bench.sockets.push(this); }
    say(frame) { this.onmessage({ data: JSON.stringify({ v: 1, ...frame }) }); }
    close() { this.isClosed = true; }
  };
  window.WebSocket.OPEN = 1;
  Math.random = () => 0.5;
  const { openChannel } = await import("/source/channel.js?bench");
  openChannel((said) => bench.heard.push(said));
  window.bench = bench;
}"""
SPOKE: Final = "{type: 'hello', overlay_after_ms: 400}"
WAKE: Final = "document.dispatchEvent(new Event('visibilitychange'))"


@pytest.fixture
def bench(open_ledger: OpenLedger) -> Page:
    page = open_ledger()
    page.evaluate(BENCH)
    return page


def run(page: Page, steps: str) -> Any:
    """Run steps on the bench; the last expression is given."""
    return page.evaluate(f"async () => {{ const {{sockets, asks, turn, heard}} = bench; {steps} }}")


def test_a_socket_that_is_let_in_only_to_be_closed_is_tried_more_and_more_rarely(bench: Page) -> None:
    pauses = run(
        bench,
        """for (let n = 0; n < 9; n += 1) {
          sockets.at(-1).onopen?.();
          sockets.at(-1).onclose({ code: 1006 });
          bench.ring();
        }
        return bench.timers.map((one) => one.ms).filter((ms) => ms <= 5000 && ms !== 2000 && ms !== 500);""",
    )
    assert pauses == [50, 100, 200, 400, 800, 1600, 3200, 5000, 5000]
    assert run(bench, "return asks.length") == 1


def test_without_a_place_the_next_try_is_late_at_once(bench: Page) -> None:
    assert run(bench, "sockets[0].onclose({ code: 1013 }); return bench.due().map((one) => one.ms)") == [5000]


def test_an_unanswered_question_says_nothing_against_a_socket_that_spoke_meanwhile(bench: Page) -> None:
    told = run(
        bench,
        f"""sockets[0].say({SPOKE});
        {WAKE}; await turn();
        sockets[0].say({{ type: "state", text: null }});
        asks[0].fail(); await turn();
        return [sockets.length, !!sockets[0].isClosed, asks.length, heard.some((one) => one.type === "lost")];""",
    )
    assert told == [1, False, 1, False]


def test_an_unanswered_question_says_nothing_against_a_socket_that_was_opened_after_it(bench: Page) -> None:
    told = run(
        bench,
        f"""sockets[0].say({SPOKE});
        sockets[0].onclose({{ code: 1006 }});
        bench.ring(); await turn();
        sockets[1].say({SPOKE});
        asks[0].fail(); await turn();
        return [sockets.length, !!sockets[1].isClosed, asks.length, heard.some((one) => one.type === "lost")];""",
    )
    assert told == [2, False, 1, False]


def test_a_socket_that_looks_open_and_a_question_without_an_answer_are_a_lost_line(bench: Page) -> None:
    told = run(
        bench,
        f"""sockets[0].say({SPOKE});
        {WAKE}; await turn();
        asks[0].fail(); await turn();
        const first = [sockets[0].isClosed, heard.some((one) => one.type === "lost")];
        bench.ring(); await turn();
        asks[1].fail(); await turn();
        return [...first, heard.at(-1)];""",
    )
    assert told == [True, False, {"v": 1, "type": "lost", "silent": False}]


def test_one_question_is_asked_at_a_time(bench: Page) -> None:
    assert run(bench, f"{WAKE}; {WAKE}; dispatchEvent(new Event('online')); return asks.length") == 1


def test_a_socket_that_stays_silent_in_an_outage_is_doubted_again_and_again(bench: Page) -> None:
    told = run(
        bench,
        f"""const down = {{ v: 1, type: "state", text: "R1" }};
        sockets[0].say({SPOKE}); sockets[0].say(down);
        for (let n = 0; n < 3; n += 1) {{ bench.ring(); await turn(); asks.at(-1).answer(down); await turn(); }}
        return [asks.length, sockets.length, bench.due().length];""",
    )
    assert told == [3, 1, 1]


def test_how_long_nobody_was_heard_is_measured_here(bench: Page) -> None:
    gaps = run(
        bench,
        f"""let now = 1000; performance.now = () => now;
        sockets[0].say({SPOKE}); sockets[0].onclose({{ code: 1006 }});
        now = 1318; bench.ring(); await turn(); sockets[1].say({SPOKE});
        return heard.filter((one) => one.type === "hello").map((one) => one.gap_ms);""",
    )
    assert gaps == [0, 318]


# -- a whole page --------------------------------------------------------------------------------------


def test_a_gateway_that_keeps_the_line_open_and_answers_nothing_is_said_to_answer_nothing(
    open_ledger: OpenLedger, gateway: ScriptedGateway
) -> None:
    page = open_ledger()
    gateway.freeze()
    page.evaluate("void fetch('/ko').catch(() => {})")
    shows(page, "The server does not answer")
    marks(page, "down")
    assert page.get_by_text("Wi-Fi").count() == 0
    gateway.thaw()
    shows(page, "Connected again")
    marks(page, "serving")


def test_a_full_gateway_is_still_asked_for_its_state(
    open_ledger: OpenLedger, gateway: ScriptedGateway
) -> None:
    page = open_ledger()
    gateway.has_no_place = True
    gateway.hang_up()
    gateway.say(down("R7b"))
    expect(overlay(page)).to_be_visible()
    gateway.say(SERVING)
    shows(page, "You are back")
