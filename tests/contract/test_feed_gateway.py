"""The feed between sentinel and gateway, as `docs/wires.md` section 6 has it."""

import json
from functools import partial
from pathlib import Path

from tests.contract.gateway_world import World, world
from tests.waiting import until


def _says(w: World, state: str) -> bool:
    return bool(w.ask("GET", "/readyz").json()["state"] == state)


def test_the_gateway_subscribes_with_its_pid(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.feed.open()
        w.start()
        said = w.feed.wait_subscribed()
        assert w.process is not None
        assert said == {"verb": "subscribe", "who": "gateway", "pid": w.process.pid}


def test_the_gateway_waits_for_a_sentinel_that_is_not_there_yet(tmp_path: Path) -> None:
    with world(tmp_path, feed_retry_ms=5) as w:
        w.start()
        young = w.ask("GET", "/livez")
        assert (young.status, json.loads(young.body)) == (200, {"alive": True, "heard": False})
        w.feed.open()
        w.feed.wait_subscribed()


def test_the_gateway_finds_a_sentinel_that_was_started_again(tmp_path: Path) -> None:
    with world(tmp_path, feed_retry_ms=5) as w:
        core = w.serving()
        w.feed.close()
        w.feed.open()
        w.feed.wait_subscribed(2)
        w.feed.generation = 2
        w.feed.serve(core)
        w.feed.wait("served", count=2)
        assert w.ask("GET", "/").status == 200


def test_an_older_sentinel_is_not_obeyed(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.feed.generation = 5
        w.serving()
        w.feed.generation = 4
        w.feed.phase("REFUSE")
        w.feed.generation = 5
        w.feed.phase("FORWARD", state="DEGRADED")
        until(lambda: w.ask("GET", "/readyz").json()["state"] == "DEGRADED", "the later line to be heard")
        assert w.ask("GET", "/").status == 200


def test_a_line_that_cannot_be_read_does_not_end_the_feed(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.feed.open()
        w.start()
        w.feed.wait_subscribed()
        w.feed.raw(b'nonsense\n[]\n{"type": "phase"}\n{"type": "new", "generation": 1}\n\n')
        w.feed.phase("HOLD", state="RECOVERY")
        w.feed.wait("holding")


def test_a_line_without_end_is_hung_up_on(tmp_path: Path) -> None:
    with world(tmp_path, feed_retry_ms=5) as w:
        w.feed.open()
        w.start()
        w.feed.wait_subscribed()
        w.feed.raw(b"x" * 70_000)
        w.feed.wait_subscribed(2)


def test_holding_is_said_when_the_gateway_begins_to_hold(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.serving()
        w.feed.phase("HOLD", phase="SNAPSHOT_LIVE", state="RECOVERY", incident="i1")
        (line,) = w.feed.wait("holding", lambda line: line["phase"] == "SNAPSHOT_LIVE")
        assert isinstance(line["at_ns"], int)


def test_served_is_said_for_each_new_epoch_though_nobody_asks_for_anything(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.serving()
        w.feed.hold()
        w.feed.serve(w.core(2), incident="i1")
        w.feed.wait("served", lambda line: line["epoch"] == 2)


def test_served_waits_until_the_core_really_answers(tmp_path: Path) -> None:
    with world(tmp_path, probe_ms=5) as w:
        w.holding()
        core = w.core(2, health=lambda call: call.answer(500))
        w.feed.serve(core)
        until(lambda: core.connections > 2, "the gateway to have asked more than once")
        assert not [line for line in w.feed.heard.all() if line["type"] == "served"]
        core.health = lambda call: call.answer(200)
        w.feed.wait("served", lambda line: line["epoch"] == 2)


def test_an_outage_that_nobody_met_is_reported_as_such(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.serving()
        w.feed.hold("i7")
        w.feed.serve(w.core(2), incident="i7")
        (line,) = w.feed.wait("outcomes")
        assert (line["incident"], line["requests"]) == ("i7", [])


def test_outcomes_are_told_to_the_next_sentinel_if_the_first_is_gone(tmp_path: Path) -> None:
    with world(tmp_path, feed_retry_ms=5) as w:
        w.holding()
        client = w.client().ask("POST", "/t", body=b"")
        w.wait_held(1)
        w.feed.close()
        w.feed.open()
        w.feed.wait_subscribed(2)
        w.feed.generation = 2
        w.feed.serve(w.core(2), incident="i1")
        assert client.read().status == 200
        (line,) = w.feed.wait("outcomes")
        assert [r["outcome"] for r in line["requests"]] == ["answered"]


def test_many_outcomes_come_in_lines_of_bounded_length(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.holding()
        clients = [
            w.client().ask("POST", "/" + "p" * 500, f"Idempotency-Key: {n}", body=b"") for n in range(150)
        ]
        w.wait_held(150)
        w.feed.serve(w.core(2), incident="i1")
        assert {client.read().status for client in clients} == {200}
        w.feed.wait("outcomes", count=3)
        lines = [line for line in w.feed.heard.all() if line["type"] == "outcomes"]
        assert [len(line["requests"]) for line in lines] == [64, 64, 22]
        assert {line["incident"] for line in lines} == {"i1"}


def test_numbers_are_told_when_they_change(tmp_path: Path) -> None:
    with world(tmp_path, stats_ms=5) as w:
        w.holding()
        client = w.client().ask("GET", "/")
        w.feed.wait("stats", lambda line: line["held"] == 1 and line["connections"] == 1)
        client.close()
        (line, *_) = w.feed.wait("stats", lambda line: line["held"] == 0 and line["connections"] == 0)
        assert (line["websockets"], line["forwarded"]) == (0, 0)


def test_readiness_follows_the_state_of_the_feed(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.serving()
        for state, status in {
            "DEGRADED": 200,
            "SAFE_MODE": 200,
            "RECOVERY": 503,
            "MANUAL_INTERVENTION": 503,
        }.items():
            w.feed.phase("FORWARD", state=state)
            until(partial(_says, w, state), f"state {state}")
            answer = w.ask("GET", "/readyz")
            assert answer.status == status
            assert (answer.header("Retry-After") is None) is (status == 200)


def test_a_sentinel_that_falls_silent_makes_the_guard_not_alive(tmp_path: Path) -> None:
    with world(tmp_path, feed_silence_ms=100) as w:
        w.serving()
        until(lambda: w.ask("GET", "/livez").status == 503, "the silence to be noticed")
        w.feed.phase("FORWARD")
        until(lambda: w.ask("GET", "/livez").status == 200, "the sentinel to be heard again")


def test_a_gateway_that_met_no_outage_tells_of_none(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        core = w.core(1)
        w.feed.open()
        w.start()
        w.feed.wait_subscribed()
        w.feed.serve(core, incident="an earlier one")
        w.feed.wait("served")
        w.feed.hold("i2")
        w.feed.serve(w.core(2), incident="i2")
        assert [line["incident"] for line in w.feed.wait("outcomes")] == ["i2"]
