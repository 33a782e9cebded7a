"""What a gateway does while no core serves, whose answers it believes, and how it leaves."""

import json
import socket
from pathlib import Path

import pytest

from tests.contract.gateway_world import Call, Core, echo, silent, world
from tests.waiting import until

KEY = "Idempotency-Key: k1"


def test_a_request_waits_for_a_core_and_is_answered_by_it(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.holding()
        client = w.client().ask("POST", "/t", KEY, body=b"abc")
        w.wait_held(1)
        core = w.core(2)
        w.feed.serve(core, incident="i1")
        assert client.read().json()["epoch"] == 2
        (call,) = core.wait("/t")
        assert (call.request.body, call.request.header("Idempotency-Key")) == (b"abc", "k1")


def test_a_request_that_waited_too_long_is_not_done_and_never_runs(tmp_path: Path) -> None:
    with world(tmp_path, hold_ms=50) as w:
        w.holding()
        answer = w.ask("POST", "/t", KEY, body=b"abc")
        assert (answer.status, answer.json()["outcome"]) == (503, "not_done")
        assert answer.header("Retry-After") is not None
        assert answer.json()["type"] == "/problems/recovering"
        core = w.core(2)
        w.feed.serve(core, incident="i1")
        w.feed.wait("outcomes")
        assert w.ask("GET", "/later").status == 200
        assert core.targets() == ["/later"]


def test_a_navigation_waits_for_its_own_shorter_time(tmp_path: Path) -> None:
    with world(tmp_path, hold_ms=600_000, navigation_hold_ms=50) as w:
        w.holding()
        waiting = w.client().ask("GET", "/page", "Accept: text/css")
        assert w.ask("GET", "/page", "Accept: text/html,*/*").status == 503
        w.feed.serve(w.core(2))
        assert waiting.read().status == 200


def test_nobody_waits_where_no_core_will_come(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.holding()
        waiting = w.client().ask("POST", "/1", body=b"")
        w.wait_held(1)
        w.feed.phase("REFUSE", phase="FATAL", state="MANUAL_INTERVENTION")
        assert waiting.read().json()["type"] == "/problems/not-serving"
        answer = w.ask("POST", "/2", body=b"")
        assert (answer.status, answer.json()["outcome"]) == (503, "not_done")


def test_a_service_that_is_stopped_says_so_and_closes(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.holding()
        w.feed.phase("CLOSED", phase="STOPPED", state="SHUTDOWN")
        until(lambda: b"-> CLOSED" in w.log.read_bytes(), "the gateway to have heard it")
        client = w.client().ask("GET", "/")
        answer = client.read()
        assert (answer.status, answer.header("Connection")) == (503, "close")
        assert answer.json()["type"] == "/problems/shutting-down"
        assert client.closed()


def test_no_more_requests_wait_than_there_is_room_for(tmp_path: Path) -> None:
    with world(tmp_path, hold_requests_max=2) as w:
        w.holding()
        waiting = [w.client().ask("GET", f"/{n}") for n in range(2)]
        w.wait_held(2)
        refused = w.ask("GET", "/3")
        assert (refused.status, refused.json()["type"]) == (503, "/problems/too-busy")
        w.feed.serve(w.core(2))
        assert [client.read().status for client in waiting] == [200, 200]


def test_one_browser_cannot_take_the_room_of_the_others(tmp_path: Path) -> None:
    with world(tmp_path, hold_per_browser_max=2) as w:
        w.holding()
        waiting = [w.client().ask("GET", "/", "Cookie: a=b; __hc=me; c=d") for _ in range(2)]
        w.wait_held(2)
        assert w.ask("GET", "/", "Cookie: __hc=me").status == 503
        waiting += [w.client().ask("GET", "/", "Cookie: __hc=you"), w.client().ask("GET", "/")]
        w.wait_held(4)
        w.feed.serve(w.core(2))
        assert [client.read().status for client in waiting] == [200] * 4


def test_health_is_answered_while_a_thousand_requests_wait(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.holding()
        waiting = [w.client().ask("POST", f"/{n}", body=b"x") for n in range(1000)]
        w.wait_held(1000)
        assert w.ask("GET", "/livez").status == 200
        assert w.ask("GET", "/readyz").status == 503
        core = w.core(2)
        w.feed.serve(core)
        assert {client.read().status for client in waiting} == {200}
        assert len(set(core.targets())) == len(core.targets()) == 1000


def test_a_large_body_is_not_read_while_it_waits(tmp_path: Path) -> None:
    body = b"x" * (4 << 20)
    with world(tmp_path, replay_body_bytes_max=1000, hold_bytes_max=1024) as w:
        w.holding()
        client = w.client().send(b"POST /b HTTP/1.1\r\nHost: localhost\r\nContent-Length: 4194304\r\n\r\n")
        w.wait_held(1)
        core = w.core(2)
        w.feed.serve(core)
        client.send(body)
        assert client.read().status == 200
        assert core.wait("/b")[0].request.body == body


def test_a_client_that_waits_and_leaves_is_forgotten(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.holding()
        client = w.client().ask("POST", "/t", KEY, body=b"abc")
        w.wait_held(1)
        client.close()
        w.wait_held(0)
        core = w.core(2)
        w.feed.serve(core, incident="i1")
        (line,) = w.feed.wait("outcomes")
        assert [(r["outcome"], r["path"]) for r in line["requests"]] == [("gone", "/t")]
        assert core.targets() == []


def test_a_half_closed_client_that_waits_is_told_before_it_is_dropped(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.holding()
        client = w.client().ask("POST", "/t", body=b"abc")
        w.wait_held(1)
        client.socket.shutdown(socket.SHUT_WR)
        assert client.read().json()["outcome"] == "not_done"
        assert client.closed()


# -- whose answer ----------------------------------------------------------------------------------------


def test_an_answer_of_another_epoch_is_no_answer(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        core = w.serving(lambda call: call.answer(200, b"stale", epoch=9))
        client = w.client().ask("POST", "/t", KEY, body=b"")
        core.wait("/t")
        w.feed.hold()
        w.feed.serve(w.core(2))
        assert client.read().json()["epoch"] == 2


def test_connections_to_an_older_core_are_closed_before_a_newer_one_serves(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        first = w.serving(silent)
        client = w.client().ask("GET", "/t")
        (call,) = first.wait("/t")
        second = w.core(2)
        w.feed.serve(second)
        call.wait_closed()
        call.answer(200, b"too late")
        assert client.read().json()["epoch"] == 2


def test_what_a_drained_core_still_says_is_passed_on_and_what_came_meanwhile_waits_for_the_next(
    tmp_path: Path,
) -> None:
    with world(tmp_path) as w:
        first = w.serving(silent)
        early = w.client().ask("POST", "/early", body=b"no key")
        (call,) = first.wait("/early")
        w.feed.phase("HOLD", phase="DRAINING", planned=True)
        w.feed.wait("holding", count=2)
        late = w.client().ask("GET", "/late")
        w.wait_held(1)
        second = w.core(2)
        w.feed.phase("HOLD", phase="SWITCHING", planned=True)
        w.feed.say("serving", socket=str(second.path), epoch=2)
        until(lambda: second.connections > 0, "the gateway to have heard of the second core")
        call.answer(201, b"done")
        assert early.read().body == b"done"
        assert second.targets() == []
        w.feed.say("release", epoch=2, incident=None)
        w.feed.phase("FORWARD", planned=True)
        assert late.read().json()["epoch"] == 2
        assert first.targets() == ["/early"]


def test_what_a_drained_core_did_not_run_goes_to_the_next_at_once(tmp_path: Path) -> None:
    with world(tmp_path, hold_ms=60_000, upstream_idle_ms=60_000, retire_ms=60_000) as w:
        first = w.serving(silent)
        client = w.client().ask("POST", "/t", body=b"abc")
        (call,) = first.wait("/t")
        w.feed.phase("HOLD", phase="SWITCHING", planned=True)
        second = w.core(2)
        w.feed.say("serving", socket=str(second.path), epoch=2)
        w.feed.say("release", epoch=2, incident=None)
        w.feed.phase("FORWARD", planned=True)
        w.feed.wait("served", lambda line: line["epoch"] == 2)
        call.answer(503, b"{}", headers=("X-Core-Draining: 1",))
        assert client.read().json()["epoch"] == 2


def test_a_drained_core_that_says_nothing_more_is_hung_up_on(tmp_path: Path) -> None:
    with world(tmp_path, retire_ms=50) as w:
        first = w.serving(silent)
        client = w.client().ask("POST", "/early", body=b"no key")
        (call,) = first.wait("/early")
        w.feed.phase("HOLD", phase="SWITCHING", planned=True)
        w.feed.serve(w.core(2))
        assert client.read().json()["outcome"] == "unknown"
        call.wait_closed()


def test_a_core_that_is_named_is_connected_to_before_its_release(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.holding()
        core = w.core(1)
        w.feed.say("serving", socket=str(core.path), epoch=1)
        until(lambda: core.connections > 0, "a connection before the release")
        assert core.targets() == []


def test_a_core_that_is_leaving_did_not_run_it(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        first = w.serving(lambda call: call.answer(503, b"{}", headers=("X-Core-Draining: 1",)))
        client = w.client().ask("POST", "/t", body=b"abc")
        first.wait("/t")
        w.wait_held(1)
        w.feed.hold()
        second = w.core(2)
        w.feed.serve(second)
        assert client.read().json()["epoch"] == 2  # without a key: it was never run, so it may be sent
        assert first.targets() == ["/t"]
        assert second.wait("/t")[0].request.body == b"abc"


def test_what_an_earlier_core_may_have_run_stays_lost_though_the_next_one_did_not(tmp_path: Path) -> None:
    with world(tmp_path, hold_ms=300) as w:
        client = w.lose(KEY)
        second = w.core(2, lambda call: call.answer(503, b"{}", headers=("X-Core-Draining: 1",)))
        w.feed.serve(second)
        second.wait("/t")
        assert client.read().json()["outcome"] == "unknown"


def test_an_ordinary_503_of_the_core_is_passed_on(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.serving(lambda call: call.answer(503, b"full", headers=("Retry-After: 1",)))
        answer = w.ask("POST", "/t", body=b"")
        assert (answer.status, answer.body) == (503, b"full")


# -- the gateway's own doubt -----------------------------------------------------------------------------


def test_the_gateway_holds_by_itself_when_the_core_refuses(tmp_path: Path) -> None:
    with world(tmp_path, probe_ms=5, upstream_idle_ms=10) as w:
        core = w.serving()
        core.die()
        client = w.client().ask("POST", "/t", body=b"abc")
        w.feed.wait("holding")
        w.wait_held(1)
        assert w.ask("GET", "/readyz").status == 503
        again = Core(core.path, 1)
        try:
            assert client.read().json()["epoch"] == 1
        finally:
            again.close()


def test_the_gateway_holds_by_itself_when_the_feed_is_silent(tmp_path: Path) -> None:
    with world(tmp_path, hold_ms=100) as w:
        core = w.serving()
        w.feed.close()
        core.die()
        answer = w.ask("POST", "/t", body=b"abc")
        assert (answer.status, answer.json()["outcome"]) == (503, "not_done")


def test_a_lost_feed_does_not_stop_a_core_that_serves(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.serving()
        w.feed.close()
        assert w.ask("GET", "/").status == 200


def test_a_core_that_hangs_up_on_one_request_goes_on_with_the_others(tmp_path: Path) -> None:
    def script(call: Call) -> None:
        call.hang_up() if call.request.target == "/bad" else echo(call)

    with world(tmp_path, probe_ms=5, hold_ms=200) as w:
        core = w.serving(script)
        bad = w.client().ask("POST", "/bad", KEY, body=b"")
        core.wait("/bad")
        assert w.ask("GET", "/good").status == 200
        # The same core may still be running it: nothing is asked or repeated there.
        assert bad.read().json()["outcome"] == "unknown"
        assert core.targets().count("/bad") == 1


# -- leaving ---------------------------------------------------------------------------------------------


def test_a_gateway_that_is_told_to_leave_answers_everybody_and_exits_with_0(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        core = w.serving(silent)
        idle = w.client().ask("GET", "/livez")
        assert idle.read().status == 200
        running = w.client().ask("POST", "/running", body=b"")
        (call,) = core.wait("/running")
        w.feed.hold()
        held = w.client().ask("POST", "/held", body=b"")
        w.wait_held(1)
        w.terminate()
        assert held.read().json()["type"] == "/problems/shutting-down"
        assert idle.closed()
        call.answer(201, b"done")
        assert running.read().status == 201
        assert running.closed()
        assert w.process is not None
        assert w.process.wait(20) == 0


def test_half_a_request_is_answered_when_the_gateway_leaves(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        core = w.serving()
        start = b"POST /t HTTP/1.1\r\nHost: localhost\r\n"
        halves = [w.client().send(half) for half in (start, start + b"Content-Length: 3\r\n\r\na")]
        w.feed.wait("stats", lambda line: line["connections"] == 2)
        asked = w.client().ask("GET", "/livez")
        assert asked.read().status == 200  # so both halves have been read
        w.terminate()
        for client in halves:
            answer = client.read()
            assert (answer.status, answer.json()["outcome"]) == (503, "not_done")
            assert client.closed()
        assert w.process is not None
        assert w.process.wait(20) == 0
        assert core.targets() == []


def test_what_does_not_finish_in_time_is_answered_too(tmp_path: Path) -> None:
    with world(tmp_path, drain_ms=50) as w:
        core = w.serving(silent)
        client = w.client().ask("POST", "/running", body=b"")
        core.wait("/running")
        w.terminate()
        assert client.read().json()["outcome"] == "unknown"
        assert w.process is not None
        assert w.process.wait(20) == 0


@pytest.mark.parametrize("signal_number", [1, 2])
def test_signals_meant_for_the_people_at_the_terminal_are_ignored(tmp_path: Path, signal_number: int) -> None:
    with world(tmp_path) as w:
        w.serving()
        assert w.process is not None
        w.process.send_signal(signal_number)
        assert w.ask("GET", "/").status == 200
        assert w.process.poll() is None


def test_a_broken_setting_is_one_line_of_the_log_and_exit_78(tmp_path: Path) -> None:
    with world(tmp_path, hold_ms=-1) as w:
        w.start()
        assert w.process is not None
        assert w.process.wait(20) == 78
        (line,) = map(json.loads, w.log.read_text().splitlines())
        assert (line["level"], line["text"]) == ("ERROR", "hold_ms must be 0 to 600000, not -1")
