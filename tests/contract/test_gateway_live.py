"""What the gateway tells an open page while it happens: at once, truly, and never backwards."""

import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.contract.gateway_world import World, silent, world
from tests.contract.socket_world import HANDSHAKE, Ends, Page, down, live, page
from tests.waiting import until

BROWSER = ("Cookie", "a=b; __hc=abc")


@pytest.fixture
def gate(tmp_path: Path) -> Iterator[World]:
    with world(tmp_path, probe_ms=20) as made:
        yield made


def _states(own: Page, count: int) -> list[Any]:
    return [own.read_type("state") for _ in range(count)]


def _status(gate: World, *headers: str) -> Any:
    return gate.ask("GET", "/__hc/status.json", *headers).json()


# -- opening -------------------------------------------------------------------------------------------


def test_a_page_is_told_how_things_stand_when_it_opens_its_socket(gate: World) -> None:
    gate.serving()
    with page(gate, "/__hc/live", None) as own:
        assert own.read() == {"v": 1, "type": "hello", "overlay_after_ms": 400, "demo": False}
        assert own.read() == {
            "v": 1,
            "type": "state",
            "state": "OPERATIONAL",
            "phase": "RUNNING",
            "stage": None,
            "stages": 4,
            "since": None,
            "elapsed_ms": 0,
            "eta": None,
            "samples": 0,
            "incident": None,
            "held": 0,
            "promised": 0,
            "trial": 0,
            "planned": False,
            "alerted_at": None,
            "safe": None,
            "text": None,
            "sound": None,
        }


def test_a_core_that_only_reads_is_told_as_served_with_the_reason_and_is_ready(gate: World) -> None:
    core = gate.serving()
    with live(gate) as own:
        assert own.read_type("state")["safe"] is None
        gate.feed.phase("FORWARD", state="SAFE_MODE", safe="DISK_FULL")
        told = own.read_type("state")
        assert (told["state"], told["text"], told["safe"]) == ("SAFE_MODE", None, "DISK_FULL")
        assert _status(gate)["safe"] == "DISK_FULL"
        assert gate.ask("GET", "/readyz").status == 200
        # What the core says to a write in this state is the client's answer, and no reason to hold anything.
        assert gate.ask("POST", "/x", "Idempotency-Key: k", body=b"a").status == 200
        assert core.targets()[-1] == "/x"
        gate.feed.phase("FORWARD")
        assert own.read_type("state")["safe"] is None


def test_a_page_that_opens_during_an_outage_is_told_of_it(gate: World) -> None:
    gate.holding()
    down(gate.feed, time.monotonic_ns() - 2_000_000_000, stage=3, phase="STARTING")
    until(lambda: _status(gate)["stage"] == 3, "the phase was heard")
    with live(gate) as own:
        state = own.read()
        assert (state["text"], state["stage"], state["incident"]) == ("R1", 3, "i1")
        assert state["elapsed_ms"] >= 2000


def test_no_core_is_asked_for_what_the_gateway_says_itself(gate: World) -> None:
    core = gate.serving()
    with live(gate):
        assert gate.ask("GET", "/__hc/status.json").status == 200
        assert not core.targets()


def test_only_the_guards_own_two_sockets_are_below_its_path(gate: World) -> None:
    core = gate.serving(Ends())
    assert gate.ask("GET", "/__hc/other", *HANDSHAKE).status == 404
    assert not core.targets()


def test_what_a_page_says_is_passed_over_and_too_much_of_it_ends_its_socket(gate: World) -> None:
    gate.serving()
    with live(gate) as own:
        own.say("hello").say(b"\x00")
        gate.feed.phase("FORWARD", state="DEGRADED", phase="SUSPECT")
        assert own.read_until(lambda frame: frame["state"] == "DEGRADED")["text"] is None
        own.say("x" * 5000)
        assert own.closed() == 1009


# -- a gateway that has just begun ---------------------------------------------------------------------


def test_a_gateway_that_has_just_begun_says_nothing_of_the_core_before_it_has_heard_of_it(
    tmp_path: Path,
) -> None:
    with world(tmp_path, doubt_told_ms=60_000) as gate:
        gate.start()
        with live(gate) as own:
            asked = gate.client().ask("GET", "/__hc/status.json")
            gate.feed.open()
            gate.feed.wait_subscribed()
            gate.feed.serve(gate.core(1))
            state = own.read()
            assert (state["type"], state["text"], state["state"]) == ("state", None, "OPERATIONAL")
            assert asked.read().json()["text"] is None
            gate.feed.phase("FORWARD", state="DEGRADED")
            assert own.read()["state"] == "DEGRADED"


def test_pages_hear_of_an_outage_although_no_sentinel_ever_speaks(tmp_path: Path) -> None:
    with world(tmp_path, doubt_told_ms=50, live_beat_ms=50, longer_than_ms=1_000) as gate:
        gate.start()
        with live(gate) as own:
            assert own.read_type("state")["text"] in {"R1", "R7"}
            assert own.read_text("R7")["elapsed_ms"] > 1_000
            assert own.read()["text"] == "R7"


def test_a_gateway_tells_no_length_of_an_outage_whose_begin_it_did_not_see(tmp_path: Path) -> None:
    with world(tmp_path) as gate:
        gate.feed.open()
        gate.start()
        gate.feed.wait_subscribed()
        gate.feed.phase("CLOSED", phase="STOPPED", state="SHUTDOWN")
        with live(gate) as own:
            own.read_text("OFF")
            gate.feed.phase("HOLD", phase="STARTING", state="STARTING")
            own.read_text("R1")
            gate.feed.serve(gate.core(1))
            assert own.read_type("back")["outage_ms"] is None


def test_a_gateway_that_begins_in_an_outage_knows_its_length_from_the_incident(gate: World) -> None:
    gate.feed.open()
    gate.start()
    gate.feed.wait_subscribed()
    down(gate.feed, time.monotonic_ns() - 2_000_000_000)
    with live(gate) as own:
        own.read_text("R1")
        gate.feed.serve(gate.core(1))
        assert own.read_type("back")["outage_ms"] >= 2000


# -- an outage -----------------------------------------------------------------------------------------


def test_a_page_is_told_by_the_gateways_own_doubt_before_the_feed_says_a_word(gate: World) -> None:
    core = gate.serving(Ends())
    with live(gate) as own, page(gate):
        core.die()
        state = own.read_text("R1")
        assert (state["state"], state["stage"], state["planned"]) == ("RECOVERY", 1, False)
        assert state["phase"] == "UNKNOWN"


def test_one_lost_connection_to_a_core_that_is_well_is_told_to_nobody(gate: World) -> None:
    ends = Ends()
    core = gate.serving(ends)
    with live(gate) as own, page(gate):
        assert own.read()["text"] is None
        ends.wait()
        core.calls.all()[-1].hang_up()
        ends.wait(2)  # the doubt is over: the socket goes on
        gate.feed.phase("FORWARD", state="DEGRADED", phase="SUSPECT")
        state = own.read()
        assert (state["type"], state["text"], state["state"]) == ("state", None, "DEGRADED")


def test_a_core_that_hung_up_and_does_not_answer_is_told_of_although_the_guard_says_nothing(
    tmp_path: Path,
) -> None:
    with world(tmp_path, doubt_told_ms=50) as gate:
        ends = Ends()
        core = gate.serving(ends)
        with live(gate) as own, page(gate):
            ends.wait()
            core.health = silent
            core.calls.all()[-1].hang_up()
            assert own.read_text("R1")["state"] == "RECOVERY"


def test_an_outage_begins_when_the_guard_says_it_did(gate: World) -> None:
    core = gate.serving()
    with live(gate) as own:
        own.read()
        core.die()
        began_ns = time.monotonic_ns() - 700_000_000
        down(gate.feed, began_ns)
        first = own.read_text("R1")
        assert first["elapsed_ms"] >= 700
        down(gate.feed, time.monotonic_ns(), stage=3, phase="STARTING")
        second = own.read_until(lambda frame: frame["stage"] == 3)
        assert second["since"] == first["since"]
        assert second["elapsed_ms"] >= first["elapsed_ms"]
        gate.feed.serve(gate.core(2))
        assert own.read_type("back")["outage_ms"] >= second["elapsed_ms"]


def test_a_stage_never_goes_back_within_an_outage(gate: World) -> None:
    core = gate.serving()
    with live(gate) as own:
        own.read()
        core.die()
        for stage, phase in ((3, "STARTING"), (2, "KILLING"), (4, "PROVING"), (1, "SNAPSHOT_LIVE")):
            down(gate.feed, time.monotonic_ns(), stage=stage, phase=phase)
        assert [state["stage"] for state in _states(own, 4)] == [3, 3, 4, 4]


def test_the_return_is_told_with_how_long_it_took_before_the_state_says_so(gate: World) -> None:
    core = gate.serving()
    with live(gate) as own:
        own.read()
        gate.die(core)
        own.read_text("R1")
        gate.feed.serve(gate.core(2))
        back = own.read()
        assert (back["type"], back["verified"], back["planned"]) == ("back", None, False)
        state = own.read()
        assert (state["text"], state["stage"], state["since"], state["elapsed_ms"]) == (None, None, None, 0)


def test_that_the_ledger_is_whole_is_told_when_it_is_known_and_to_those_who_were_not(gate: World) -> None:
    core = gate.serving()
    with live(gate) as own:
        own.read()
        gate.die(core)
        gate.feed.serve(gate.core(2))
        assert own.read_type("back")["verified"] is None
        gate.feed.say("verified", epoch=1, ok=True, seq=3)  # of an older core: says nothing of this one
        gate.feed.say("verified", epoch=2, ok=True, seq=3)
        assert own.read_type("verified") == {"v": 1, "type": "verified", "ok": True}


def test_that_the_ledger_is_not_whole_is_told_with_the_return(gate: World) -> None:
    core = gate.serving()
    with live(gate) as own:
        own.read()
        gate.die(core)
        gate.feed.say("serving", socket=str(gate.core(2).path), epoch=2)
        gate.feed.say("verified", epoch=2, ok=False, seq=None)
        gate.feed.say("release", epoch=2, incident=None)
        gate.feed.phase("FORWARD")
        assert own.read_type("back")["verified"] is False
        assert own.read_type("state")["sound"] is False


def test_whether_the_ledger_is_whole_is_told_to_pages_that_come_later(gate: World) -> None:
    gate.serving()
    with live(gate) as first:
        assert first.read()["sound"] is None
        gate.feed.say("verified", epoch=1, ok=False, seq=None)
        assert first.read_type("state")["sound"] is False
    with live(gate) as later:
        assert later.read()["sound"] is False
    assert _status(gate)["sound"] is False


def test_a_proof_that_was_done_before_the_release_comes_with_the_return(gate: World) -> None:
    core = gate.serving()
    with live(gate) as own:
        own.read()
        gate.die(core)
        gate.feed.say("serving", socket=str(gate.core(2).path), epoch=2)
        gate.feed.say("verified", epoch=2, ok=True, seq=3)
        gate.feed.say("release", epoch=2, incident=None)
        gate.feed.phase("FORWARD")
        assert own.read_type("back")["verified"] is True


@pytest.mark.parametrize(
    ("face", "planned", "text"),
    [("HOLD", False, "R1"), ("HOLD", True, "R2"), ("REFUSE", False, "R8"), ("CLOSED", True, "OFF")],
)
def test_the_text_is_the_one_that_is_true(gate: World, face: str, planned: bool, text: str) -> None:
    gate.serving()
    with live(gate) as own:
        gate.feed.phase(face, phase="STOPPING", state="RECOVERY", planned=planned)
        state = own.read_until(lambda frame: frame["text"] is not None)
        assert (state["text"], state["planned"]) == (text, planned)


def test_a_page_hears_something_at_least_now_and_then_while_nothing_changes(tmp_path: Path) -> None:
    with world(tmp_path, live_beat_ms=50) as gate:
        gate.serving()
        with live(gate) as own:
            own.read()
            gate.feed.hold()
            states = _states(own, 3)
            assert [state["text"] for state in states] == ["R1", "R1", "R1"]
            assert states[0]["elapsed_ms"] < states[1]["elapsed_ms"] < states[2]["elapsed_ms"]


def test_an_outage_that_lasts_too_long_is_called_long_although_no_estimate_was_given(tmp_path: Path) -> None:
    with world(tmp_path, longer_than_ms=200) as gate:
        gate.serving()
        with live(gate) as own:
            own.read()
            gate.feed.hold()
            assert own.read()["text"] == "R1"
            assert own.read()["text"] == "R7"


def test_requests_that_wait_are_told_to_the_browser_that_sent_them_alone(gate: World) -> None:
    gate.holding()
    with live(gate, BROWSER) as mine, live(gate) as other:
        assert (mine.read()["held"], other.read()["held"]) == (0, 0)
        client = gate.client().ask("GET", "/t", "Cookie: __hc=abc")
        assert mine.read_type("state")["held"] == 1
        assert _status(gate, "Cookie: __hc=abc")["held"] == 1
        assert _status(gate)["held"] == 0
        down(gate.feed, time.monotonic_ns(), stage=4)
        assert mine.read_until(lambda frame: frame["stage"] == 4)["held"] == 1
        assert other.read_until(lambda frame: frame["stage"] == 4)["held"] == 0
        client.close()
        assert mine.read_type("state")["held"] == 0


def test_a_request_that_was_at_the_core_when_it_died_counts_as_waiting(gate: World) -> None:
    core = gate.serving(silent)
    with live(gate, BROWSER) as own:
        gate.client().ask("POST", "/t", "Cookie: __hc=abc", "Idempotency-Key: k", body=b"x")
        core.wait("/t")
        gate.die(core)
        assert own.read_until(lambda frame: frame.get("held") == 1)["text"] == "R1"


def test_a_socket_of_the_ledger_is_told_in_band(gate: World) -> None:
    core = gate.serving(Ends())
    with page(gate) as tab:
        gate.die(core)
        assert tab.read()["type"] == "state"
        gate.feed.serve(gate.core(2, Ends()))
        assert tab.read_type("back")["planned"] is False
        assert tab.read_text(None)["type"] == "state"


# -- an estimate ---------------------------------------------------------------------------------------


def _outage(gate: World, own: Page, epoch: int, began_ms: int) -> Any:
    """One whole outage of `began_ms` and a little; returns its first state."""
    down(gate.feed, time.monotonic_ns() - began_ms * 1_000_000, phase="STARTING")
    first = own.read_until(lambda frame: frame.get("text") is not None)
    gate.feed.serve(gate.core(epoch))
    own.read_text(None)
    return first


def test_an_estimate_comes_with_the_fifth_outage_and_outlives_the_gateway(tmp_path: Path) -> None:
    kept = tmp_path / "recoveries.json"
    options = ("--recoveries", str(kept))
    with world(tmp_path, *options) as gate:
        gate.serving()
        with live(gate) as own:
            firsts = [_outage(gate, own, epoch, 2_000) for epoch in range(2, 8)]
        assert [first["samples"] for first in firsts] == [0, 1, 2, 3, 4, 5]
        assert [first["eta"] for first in firsts[:5]] == [None] * 5
        eta = firsts[5]["eta"]
        assert (eta["low_s"], eta["samples"]) == (2, 5)
        assert eta["high_s"] > eta["low_s"]
        gate.terminate()
        assert gate.process is not None
        assert gate.process.wait(20) == 0
    assert len(json.loads(kept.read_text())["recoveries"]) == 6
    (tmp_path / "next").mkdir()
    with world(tmp_path / "next", *options) as gate:
        gate.serving()
        with live(gate) as own:
            assert own.read()["samples"] == 6


def test_past_its_bound_an_estimate_is_taken_back(tmp_path: Path) -> None:
    kept = tmp_path / "recoveries.json"
    kept.write_text(json.dumps({"recoveries": [{"total_ms": 300, "reached_ms": [0, 0, 0, 0]}] * 9}))
    with world(tmp_path, "--recoveries", str(kept), longer_floor_ms=0) as gate:
        gate.serving()
        with live(gate) as own:
            own.read()
            gate.feed.hold()
            first = own.read()
            assert (first["text"], first["eta"]) == ("R1", {"low_s": 0, "high_s": 1, "samples": 9})
            assert own.read_text("R7")["eta"] is None


def test_a_history_that_nobody_can_read_costs_an_estimate_and_nothing_else(tmp_path: Path) -> None:
    kept = tmp_path / "recoveries.json"
    kept.write_bytes(b"\xff{[")
    with world(tmp_path, "--recoveries", str(kept)) as gate:
        gate.serving()
        assert _status(gate)["samples"] == 0


# -- for those who ask ---------------------------------------------------------------------------------


def test_a_status_that_did_not_change_is_not_sent_again(gate: World) -> None:
    gate.holding()
    first = gate.ask("GET", "/__hc/status.json")
    tag = first.header("ETag")
    assert tag is not None
    assert first.header("Cache-Control") == "no-store"
    assert gate.ask("GET", "/__hc/status.json", f"If-None-Match: {tag}").status == 304
    gate.feed.serve(gate.core(1))
    gate.feed.wait("served")
    again = gate.ask("GET", "/__hc/status.json", f"If-None-Match: {tag}")
    assert (again.status, again.json()["text"]) == (200, None)


def test_the_status_is_answered_in_every_phase_and_changes_nothing(gate: World) -> None:
    gate.holding()
    gate.feed.phase("CLOSED", phase="STOPPED", state="SHUTDOWN")
    until(lambda: _status(gate)["text"] == "OFF", "the status says that it is off")
    assert gate.ask("HEAD", "/__hc/status.json").status == 200
    assert gate.ask("POST", "/__hc/status.json", body=b"").status == 405


def test_many_pages_are_all_told(tmp_path: Path) -> None:
    with world(tmp_path, sockets_max=400) as gate:
        core = gate.serving()
        clients = [gate.client().ask("GET", "/__hc/live", *HANDSHAKE) for _ in range(300)]
        assert {client.read(head=True).status for client in clients} == {101}
        gate.feed.wait("stats", lambda line: line["websockets"] == 300)
        gate.die(core)
        for client in clients:
            said = b""
            while b'"text":"R1"' not in said:
                said += client.socket.recv(4096)
