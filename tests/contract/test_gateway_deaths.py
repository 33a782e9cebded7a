"""What becomes of a request whose core dies: sent again, looked up, or told that nobody knows."""

import hashlib
import json
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.contract.gateway_world import Call, echo, key_hash, silent, world

KEY = "Idempotency-Key: k1"


def _stored(call: Call) -> None:
    """The ledger has the key."""
    assert call.request.target == "/api/ledger/commands/k1"
    found = {"key": "k1", "outcome": "done", "status": 201, "answer": {"id": "t1"}}
    call.answer(200, json.dumps(found).encode())


def _absent(call: Call) -> None:
    body = b'{"type": "/problems/unknown-command", "status": 404, "outcome": "not_done"}'
    call.answer(404, body, headers=("Content-Type: application/problem+json",))


def test_a_safe_request_that_was_lost_is_sent_again(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        client = w.lose(method="GET", body=b"")
        second = w.core(2)
        w.feed.serve(second, incident="i1")
        assert client.read().json()["epoch"] == 2


def test_nothing_is_replayed_before_the_release(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        client = w.lose(KEY)
        w.wait_held(1)
        second = w.core(2)
        w.feed.say("suspects", keys=[])
        w.feed.say("serving", socket=str(second.path), epoch=2)
        w.feed.phase("FORWARD", phase="PROBATION")
        assert w.ask("GET", "/readyz").status == 200  # the gateway has read all of it
        assert second.targets() == []
        w.feed.say("release", epoch=2, incident="i1")
        assert client.read().status == 200


def test_an_unsafe_request_with_a_key_is_replayed_once_with_its_key(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        client = w.lose(KEY)
        second = w.core(2)
        w.feed.serve(second, incident="i1")
        assert client.read().status == 200
        (call,) = second.wait("/t")
        assert (call.request.header("Idempotency-Key"), call.request.body) == ("k1", b"abc")
        (line,) = w.feed.wait("outcomes")
        assert line["incident"] == "i1"
        (request,) = line["requests"]
        assert (request["outcome"], request["status"], request["key_hash"]) == (
            "replayed",
            200,
            key_hash("k1"),
        )
        assert (request["method"], request["path"]) == ("POST", "/t")


def test_an_unsafe_request_is_replayed_once_in_its_life_and_then_looked_up(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        client = w.lose(KEY)
        second = w.core(2, silent)
        w.feed.serve(second, incident="i1")
        second.wait("/t")
        w.die(second)
        third = w.core(3, _stored)
        w.feed.serve(third, incident="i2")
        assert client.read().status == 201
        assert third.targets() == ["/api/ledger/commands/k1"]


def test_a_suspect_is_only_looked_up_and_found(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        client = w.lose(KEY)
        second = w.core(2, _stored)
        w.feed.serve(second, incident="i1", suspects=(key_hash("k1"),))
        answer = client.read()
        assert (answer.status, answer.json()) == (201, {"id": "t1"})
        assert answer.header("Idempotent-Replayed") == "true"
        assert second.targets() == ["/api/ledger/commands/k1"]
        (line,) = w.feed.wait("outcomes")
        assert [(r["outcome"], r["status"]) for r in line["requests"]] == [("done", 201)]


def _digest(body: bytes) -> str:
    return hashlib.sha256(b"POST /t\n" + body).hexdigest()


@pytest.mark.parametrize("replay_body_bytes_max", [2, 1000], ids=["streamed", "kept"])
def test_a_look_up_names_the_request_and_not_only_its_key(tmp_path: Path, replay_body_bytes_max: int) -> None:
    with world(tmp_path, replay_body_bytes_max=replay_body_bytes_max) as w:
        client = w.lose(KEY)
        second = w.core(2, _stored)
        w.feed.serve(second, suspects=(key_hash("k1"),))
        assert client.read().status == 201
        (call,) = second.wait("/api/ledger/commands/k1")
        assert call.request.header("X-Request-Digest") == _digest(b"abc")


def test_a_suspect_whose_key_is_another_requests_is_never_told_its_answer(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        client = w.lose(KEY)
        second = w.core(2, lambda call: call.answer(200, b'{"key": "k1", "outcome": "unknown"}'))
        w.feed.serve(second, suspects=(key_hash("k1"),))
        answer = client.read()
        assert (answer.status, answer.json()["outcome"]) == (503, "unknown")


def test_suspects_add_up_over_lines(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        client = w.lose(KEY)
        second = w.core(2, _stored)
        w.feed.say("suspects", keys=[key_hash("k1")])
        w.feed.serve(second, suspects=tuple(key_hash(f"other-{n}") for n in range(512)))
        assert client.read().status == 201
        assert second.targets() == ["/api/ledger/commands/k1"]


def test_a_suspect_that_is_not_in_the_ledger_is_not_done(tmp_path: Path) -> None:
    with world(tmp_path, hold_ms=2000) as w:
        client = w.lose(KEY)
        second = w.core(2, _absent)
        w.feed.serve(second, incident="i1", suspects=(key_hash("k1"),))
        answer = client.read()
        assert (answer.status, answer.json()["outcome"]) == (503, "not_done")
        assert answer.json()["type"] == "/problems/not-done"
        assert second.targets() == ["/api/ledger/commands/k1"]


def test_a_look_up_that_says_neither_leaves_the_outcome_unknown(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        client = w.lose(KEY)
        w.feed.serve(w.core(2, lambda call: call.answer(404, b"no such page")), suspects=(key_hash("k1"),))
        answer = client.read()
        assert answer.json()["outcome"] == "unknown"


def test_a_look_up_that_dies_with_its_core_is_made_again(tmp_path: Path) -> None:
    with world(tmp_path, hold_ms=2000) as w:
        client = w.lose(KEY)
        second = w.core(2, silent)
        w.feed.serve(second, suspects=(key_hash("k1"),))
        second.wait("/api/ledger/commands/k1")
        w.die(second)
        w.feed.serve(w.core(3, _absent))
        assert client.read().json()["outcome"] == "not_done"


def test_an_unsafe_request_without_a_key_is_unknown_at_once(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        client = w.lose()
        answer = client.read()
        assert (answer.status, answer.json()["outcome"]) == (503, "unknown")
        second = w.core(2)
        w.feed.serve(second, incident="i1")
        (line,) = w.feed.wait("outcomes")
        assert [(r["outcome"], r["key_hash"]) for r in line["requests"]] == [("unknown", None)]
        assert second.targets() == []


def test_a_key_that_nobody_could_look_up_is_no_key(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        client = w.lose("Idempotency-Key: " + "k" * 300)
        assert client.read().json()["outcome"] == "unknown"


def test_a_lost_request_is_unknown_when_its_time_is_over(tmp_path: Path) -> None:
    with world(tmp_path, hold_ms=100) as w:
        client = w.lose(KEY)
        answer = client.read()
        assert (answer.status, answer.json()["outcome"]) == (503, "unknown")
        assert answer.json()["type"] == "/problems/outcome-unknown"


def test_a_lost_request_is_unknown_when_no_core_will_come(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        client = w.lose(KEY)
        w.feed.phase("REFUSE", phase="FATAL", state="MANUAL_INTERVENTION")
        assert client.read().json()["outcome"] == "unknown"


def test_a_streamed_body_is_never_replayed_only_looked_up(tmp_path: Path) -> None:
    with world(tmp_path, replay_body_bytes_max=2) as w:
        client = w.lose(KEY)
        second = w.core(2, _stored)
        w.feed.serve(second)
        assert client.read().status == 201
        assert second.targets() == ["/api/ledger/commands/k1"]


def test_an_unfinished_upload_is_answered_when_its_core_dies(tmp_path: Path) -> None:
    with world(tmp_path, replay_body_bytes_max=2, upstream_idle_ms=10) as w:
        core = w.serving()
        core.at_head = Call.hang_up
        head = f"POST /t HTTP/1.1\r\nHost: localhost\r\n{KEY}\r\nContent-Length: 9\r\n\r\n"
        client = w.client().send(head.encode() + b"abc")
        assert client.read().json()["outcome"] == "unknown"


def test_half_an_answer_to_an_unsafe_request_is_not_an_answer(tmp_path: Path) -> None:
    def half(call: Call) -> None:
        call.raw(b"HTTP/1.1 201 Created\r\nContent-Length: 100\r\nX-Core-Epoch: 1\r\n\r\nhalf")
        call.hang_up()

    with world(tmp_path) as w:
        core = w.serving(half)
        client = w.client().ask("POST", "/t", KEY, body=b"abc")
        core.wait("/t")
        w.die(core)
        w.feed.serve(w.core(2))
        assert client.read().json()["epoch"] == 2


def test_an_answer_that_was_begun_is_cut_and_not_completed_by_another(tmp_path: Path) -> None:
    def half(call: Call) -> None:
        call.raw(b"HTTP/1.1 200 OK\r\nContent-Length: 100000\r\nX-Core-Epoch: 1\r\n\r\n" + b"x" * 5000)

    with world(tmp_path, answer_buffer_bytes_max=1000) as w:
        core = w.serving(half)
        client = w.client().ask("GET", "/long")
        assert client.socket.recv(10) == b"HTTP/1.1 2"
        w.die(core)
        w.feed.serve(w.core(2))
        seen = b""
        try:
            while data := client.socket.recv(65536):
                seen += data
        except ConnectionResetError:
            pass
        assert len(seen) < 100_000


def test_a_safe_request_that_kills_whoever_reads_it_is_not_sent_for_ever(tmp_path: Path) -> None:
    with world(tmp_path, probe_ms=5) as w:
        core = w.serving(lambda call: call.hang_up())
        answer = w.ask("GET", "/deadly")
        assert (answer.status, answer.json()["outcome"]) == (503, "not_done")
        assert core.targets() == ["/deadly"] * 3


# -- a core that hangs up and lives ----------------------------------------------------------------------


def _hanging_up_on(target: str, look_up: Callable[[Call], None]) -> Callable[[Call], None]:
    """A core that lives, and never answers this one."""

    def script(call: Call) -> None:
        if call.request.target == target:
            call.hang_up()
        elif call.request.target == "/api/ledger/commands/k1":
            look_up(call)
        else:
            echo(call)

    return script


def test_a_living_core_that_hung_up_is_asked_at_once_what_became_of_it(tmp_path: Path) -> None:
    with world(tmp_path, hold_ms=600_000, probe_ms=20) as w:
        core = w.serving(_hanging_up_on("/t", _stored))
        answer = w.ask("POST", "/t", KEY, body=b"abc")
        assert (answer.status, answer.json()) == (201, {"id": "t1"})
        assert core.targets() == ["/t", "/api/ledger/commands/k1"]


def test_of_what_the_core_that_had_it_does_not_know_nobody_says_that_it_was_not_done(tmp_path: Path) -> None:
    with world(tmp_path, hold_ms=600, probe_ms=20, ask_again_ms=20) as w:
        core = w.serving(_hanging_up_on("/t", _absent))
        answer = w.ask("POST", "/t", KEY, body=b"abc")
        assert (answer.status, answer.json()["outcome"]) == (503, "unknown")
        assert core.targets().count("/t") == 1


@pytest.mark.parametrize(
    "at_first", [_absent, lambda call: call.answer(500, b"{}")], ids=["absent", "broken"]
)
def test_the_core_that_had_it_is_asked_again_until_it_knows(
    tmp_path: Path, at_first: Callable[[Call], None]
) -> None:
    answers = iter([at_first, at_first])

    def look_up(call: Call) -> None:
        next(answers, _stored)(call)

    with world(tmp_path, hold_ms=600_000, probe_ms=20, ask_again_ms=20) as w:
        w.serving(_hanging_up_on("/t", look_up))
        assert w.ask("POST", "/t", KEY, body=b"abc").status == 201


def test_what_the_core_that_had_it_does_not_know_is_sent_again_by_the_next(tmp_path: Path) -> None:
    with world(tmp_path, hold_ms=600_000, probe_ms=20, ask_again_ms=60_000) as w:
        core = w.serving(_hanging_up_on("/t", _absent))
        client = w.client().ask("POST", "/t", KEY, body=b"abc")
        core.wait("/api/ledger/commands/k1")
        w.die(core)
        second = w.core(2)
        w.feed.serve(second, incident="i1")
        assert client.read().json()["epoch"] == 2
        assert second.targets() == ["/t"]
