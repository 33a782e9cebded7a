"""The doors of monitors: what they say, in every phase, and that nothing keeps them from saying it."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from prometheus_client import Metric
from prometheus_client.openmetrics.parser import text_string_to_metric_families
from prometheus_client.parser import text_string_to_metric_families as older_text

from tests.contract.gateway_world import World, silent, world
from tests.waiting import until

DOORS = ("/livez", "/readyz", "/startupz", "/health", "/metrics")
HOST = b"Host: localhost\r\n"
STATUS: dict[str, Any] = {
    "core": {
        "pid": 7,
        "heartbeat_age_ms": 31,
        "rss_bytes": 61_000_000,
        "threads": 4,
        "fds": 23,
        "last_seq": 1234,
    },
    "spare": {"pid": 8, "ready": True},
    "budget": {"used": 1, "limit": 5, "window_s": 60},
    "sentinel": {"rss_bytes": 24_000_000},
    "ledger_verified_at": "2026-11-22T08:00:00.000Z",
}
COUNTERS: dict[str, Any] = {
    "restarts": {"CRASHED": 2},
    "incidents": {"CRASHED": {"recovered": 2}},
    "detection_ms": {"bounds": [10, 100], "counts": [1, 1, 0], "sum": 50, "count": 2},
    "recovery_ms": {"bounds": [100, 1000], "counts": [0, 1, 1], "sum": 2500, "count": 2},
    "stage_ms": {"killed": {"bounds": [10], "counts": [2, 0], "sum": 9, "count": 2}},
    "late_ticks": 3,
    "false_suspicions": 1,
    "state_ms": {"OPERATIONAL": 9000},
    "snapshot_bytes": 4096,
    "letters": {'odd "reason"\n': 1},
    "forecasts": {"memory": 1200.5},
    "core_started_s": 1_790_000_000.25,
}


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[World]:
    with world(tmp_path_factory.mktemp("served")) as w:
        w.serving()
        w.feed.say("standing", status=STATUS, counters=COUNTERS)
        until(lambda: "hardcore_ledger_last_seq 1234" in _metrics(w), "the standing to be heard")
        yield w


def read_openmetrics(text: str) -> list[Metric]:
    return list(text_string_to_metric_families(text))  # type: ignore[no-untyped-call]  # the library's


def _metrics(w: World, accept: str = "*/*") -> str:
    answer = w.ask("GET", "/metrics", f"Accept: {accept}")
    assert answer.status == 200
    return answer.body.decode()


def test_a_serving_core_passes_every_door(served: World) -> None:
    assert [served.ask("GET", door).status for door in DOORS] == [200] * 5
    health = served.ask("GET", "/health").json()
    assert (health["status"], health["state"]) == ("pass", "OPERATIONAL")
    assert health["checks"]["core"]["rss_bytes"] == 61_000_000
    assert health["checks"]["sentinel"]["status"] == "pass"


@pytest.mark.parametrize("door", DOORS)
def test_head_is_get_without_a_body(served: World, door: str) -> None:
    client = served.client()
    told = client.ask("HEAD", door).read(head=True)
    assert (told.status, told.body) == (200, b"")
    assert int(str(told.header("Content-Length"))) > 0
    assert client.ask("GET", door).read().status == 200  # and the connection is still in step


@pytest.mark.parametrize("door", DOORS)
def test_a_door_says_what_may_be_asked_of_it(served: World, door: str) -> None:
    told = served.ask("OPTIONS", door)
    assert (told.status, told.header("Allow")) == (204, "GET, HEAD, OPTIONS")
    refused = served.ask("DELETE", door)
    assert (refused.status, refused.header("Allow")) == (405, "GET, HEAD, OPTIONS")


def test_the_numbers_are_what_openmetrics_calls_numbers(served: World) -> None:
    answer = served.ask(
        "GET", "/metrics", "Accept: application/openmetrics-text;version=1.0.0,text/plain;q=0.5"
    )
    assert str(answer.header("Content-Type")).startswith("application/openmetrics-text; version=1.0.0")
    text = answer.body.decode()
    assert text.endswith("# EOF\n")
    found = {sample.name: sample for family in read_openmetrics(text) for sample in family.samples}
    assert found["hardcore_core_restarts_total"].labels == {"diagnosis": "CRASHED"}
    assert found["hardcore_core_resident_memory_bytes"].value == 61_000_000
    assert found["hardcore_core_heartbeat_age_seconds"].value == 0.031
    assert found["hardcore_recovery_seconds_sum"].value == 2.5
    assert found["hardcore_dead_letters"].labels == {"reason": 'odd "reason"\n'}
    assert found["hardcore_ledger_last_seq"].value == found["hardcore_ledger_events_total"].value == 1234


def test_whoever_reads_only_the_older_text_gets_the_same_numbers(served: World) -> None:
    answer = served.ask("GET", "/metrics", "Accept: text/plain;version=0.0.4")
    assert str(answer.header("Content-Type")).startswith("text/plain; version=0.0.4")
    older = {(s.name, tuple(s.labels.items())) for f in older_text(answer.body.decode()) for s in f.samples}
    newer = {(s.name, tuple(s.labels.items())) for f in read_openmetrics(_metrics(served)) for s in f.samples}
    assert older == newer


def test_details_are_for_this_machine_alone(served: World) -> None:
    for header in ("X-Forwarded-For: 192.0.2.7", "Forwarded: for=192.0.2.7", "Via: 1.1 proxy"):
        told = served.ask("GET", "/health", header)
        assert (told.status, told.json()) == (200, {"status": "pass", "state": "OPERATIONAL", "checks": {}})
        assert served.ask("GET", "/metrics", header).status == 404
        assert served.ask("GET", "/livez", header).status == 200


def test_a_door_with_a_query_is_the_same_door(served: World) -> None:
    assert served.ask("GET", "/livez?verbose").status == 200
    assert served.ask("GET", "/livez/more").status == 200  # belongs to the core


def test_the_guard_is_told_that_somebody_reads_the_doors(served: World) -> None:
    _metrics(served)
    assert served.feed.wait("asked-doors")


def test_the_doors_answer_while_no_core_serves_and_requests_are_held(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.holding()
        held = [w.client().ask("POST", "/t", f"Idempotency-Key: k{n}", body=b"x") for n in range(3)]
        w.wait_held(3)
        answers = {door: w.ask("GET", door) for door in DOORS}
        assert {door: answer.status for door, answer in answers.items()} == {
            "/livez": 200,
            "/readyz": 503,
            "/startupz": 503,
            "/health": 503,
            "/metrics": 200,
        }
        assert answers["/readyz"].header("Retry-After") is not None
        assert answers["/health"].json()["checks"]["gateway"]["held_requests"] == 3
        text = answers["/metrics"].body.decode()
        assert "\nhardcore_core_up 0\n" in text
        assert "\nhardcore_held_requests 3\n" in text
        assert "hardcore_core_resident_memory_bytes" not in text  # nobody has said it: no zero is made up
        w.feed.serve(w.core(1))
        assert [client.read().status for client in held] == [200] * 3
        assert 'hardcore_held_requests_total{outcome="answered"} 3' in _metrics(w)
        assert w.ask("GET", "/startupz").status == 200
        w.feed.hold("i2")
        until(lambda: w.ask("GET", "/readyz").status == 503, "the outage to be heard")
        assert w.ask("GET", "/startupz").status == 200  # the first start is over for good


def test_a_start_that_waits_for_a_person_is_over(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.holding()
        w.feed.phase("REFUSE", phase="FATAL", state="MANUAL_INTERVENTION")
        until(lambda: w.ask("GET", "/startupz").status == 200, "the start to be over")
        assert (w.ask("GET", "/livez").status, w.ask("GET", "/readyz").status) == (200, 503)


def test_a_silent_sentinel_is_told_at_the_doors_and_its_last_word_is_not_passed_on(tmp_path: Path) -> None:
    with world(tmp_path, feed_silence_ms=200) as w:
        w.serving()
        until(lambda: w.ask("GET", "/livez").status == 503, "the silence to be noticed")
        health = w.ask("GET", "/health")
        assert (health.status, health.json()["checks"]["sentinel"]["status"]) == (503, "fail")
        assert w.ask("GET", "/r").status == 200  # who asks the ledger is served all the same


def test_a_flood_that_has_every_place_keeps_nobody_from_the_doors(tmp_path: Path) -> None:
    with world(tmp_path, connections_max=40) as w:
        core = w.serving(silent)
        half_open = [w.client().send(b"GET /half HTTP/1.1\r\n" + HOST) for _ in range(40)]
        until(lambda: w.feed.wait("stats")[-1]["connections"] == 40, "every place to be taken")
        for door in DOORS:
            told = w.ask("GET", door)
            assert (told.status, told.header("Connection")) == (200, "close")
        turned_away = w.ask("GET", "/r")
        assert (turned_away.status, turned_away.json()["type"]) == (503, "/problems/too-busy")
        assert w.ask("HEAD", "/livez").status == 200
        half_open[0].send(b"\r\n").close()
        until(
            lambda: any(call.request.target == "/half" for call in core.calls.all()), "the first to be served"
        )


def test_hundreds_who_say_nothing_keep_nobody_from_the_doors(tmp_path: Path) -> None:
    """At the limit as well: the newest is heard, in the place of the one that has been silent longest."""
    with world(tmp_path, connections_max=300, door_callers_max=16, door_head_ms=60_000) as w:
        w.serving()
        silent_ones = [w.client().send(b"GET /half HTTP/1.1\r\n") for _ in range(300)]
        until(lambda: w.feed.wait("stats")[-1]["connections"] == 300, "every place to be taken")
        told: list[int] = []
        for number in range(200):
            silent_ones.append(w.client().send(b"GET /li"))
            told.append(w.ask("GET", DOORS[number % len(DOORS)]).status)
        assert told == [200] * 200
        displaced = [client.read() for client in silent_ones[300:-16]]
        assert {answer.status for answer in displaced} == {503}
        assert {answer.json()["type"] for answer in displaced} == {"/problems/too-busy"}


def test_late_callers_who_say_nothing_make_room_for_the_next(tmp_path: Path) -> None:
    with world(tmp_path, connections_max=1, door_callers_max=2, door_head_ms=50) as w:
        w.serving()
        w.client()
        mute = [w.client().send(b"GET /liv") for _ in range(2)]
        assert [client.read().status for client in mute] == [503, 503]
        assert w.ask("GET", "/livez").status == 200
        assert w.client().send(b"NOT HTTP\r\n\r\n").read().status == 503


def test_a_standing_that_makes_no_sense_spoils_nothing(served: World) -> None:
    served.feed.raw(
        json.dumps({"type": "standing", "generation": 1, "status": 7, "counters": {}}).encode() + b"\n"
    )
    odd = {
        "restarts": 7,
        "incidents": {"X": 1},
        "detection_ms": {"bounds": 1},
        "stage_ms": [],
        "late_ticks": "x",
    }
    served.feed.say("standing", status={"core": None, "spare": 3, "budget": []}, counters=odd)
    until(lambda: "late_ticks" not in _metrics(served), "the odd standing to be heard")
    assert read_openmetrics(_metrics(served))
    assert served.ask("GET", "/health").status == 200
    served.feed.say("standing", status=STATUS, counters=COUNTERS)
    until(lambda: "late_ticks" in _metrics(served), "the next standing to be heard")
