"""What a browser was promised and what it sends: in which order they reach a core that was just released."""

import threading
from pathlib import Path

from tests.contract.gateway_world import Call
from tests.contract.receipts_world import (
    COOKIE,
    Ledger,
    becomes,
    hold,
    promised,
    promising,
    sent,
    serve,
    wish,
)
from tests.waiting import until

NOTHING = b"{}"


def ledger_that_waits_with(key: str, go: threading.Event) -> Ledger:
    """A ledger that does this one only when it may."""

    def before(call: Call) -> bool:
        if call.request.header("Idempotency-Key") == key:
            go.wait(20)
        return False

    return Ledger(before=before)


def test_what_a_browser_was_promised_goes_before_what_it_sends_after_the_release(tmp_path: Path) -> None:
    with promising(tmp_path, hold_ms=3_000, receipts_first_ms=60_000, navigation_hold_ms=0) as w:
        hold(w)
        waiting = [wish(w, key) for key in ("k1", "k2")]
        assert [one.read().status for one in waiting] == [202, 202]
        go = threading.Event()
        ledger = ledger_that_waits_with("k1", go)
        core = serve(w, ledger, 2)
        until(lambda: sent(core, "k1"), "the first promise to be run")
        mine = w.client().ask("POST", "/api/ledger/t", "Idempotency-Key: live", COOKIE, body=NOTHING)
        w.wait_held(1)
        other = w.ask("POST", "/api/ledger/t", "Idempotency-Key: other", body=NOTHING)
        mine_reads = w.ask("GET", "/api/ledger/t", COOKIE)
        assert (other.status, mine_reads.status) == (201, 200)
        go.set()
        assert mine.read().status == 201
        becomes(w, "k2", "done")
        promised_first = [key for key in ledger.booked if key != "other"]
        assert sorted(promised_first[:2]) == ["k1", "k2"]
        assert promised_first[2:] == ["live"]


def test_a_promise_that_does_not_get_on_stops_its_browser_for_a_moment_only(tmp_path: Path) -> None:
    with promising(tmp_path, receipts_first_ms=100) as w:
        hold(w)
        promised(w, "k1")
        go = threading.Event()
        ledger = ledger_that_waits_with("k1", go)
        core = serve(w, ledger, 2)
        until(lambda: sent(core, "k1"), "the promise to be run")
        try:
            live = w.ask("POST", "/api/ledger/t", "Idempotency-Key: live", COOKIE, body=NOTHING)
            assert live.status == 201
            assert ledger.booked == ["live"]
        finally:
            go.set()
