"""What a gateway does while a core serves: requests are written anew, in order, and answered."""

import json
import socket
from pathlib import Path

import pytest

from tests.contract.gateway_world import Call, World, echo, silent, world
from tests.waiting import until


def test_a_request_is_passed_to_the_serving_core(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.serving()
        answer = w.ask("GET", "/api/x?y=1")
        assert answer.status == 200
        assert answer.json() == {"epoch": 1, "target": "/api/x?y=1"}
        assert answer.header("X-Core-Epoch") is None


@pytest.mark.parametrize("method", ["GET", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"])
def test_every_method_arrives_with_its_body(tmp_path: Path, method: str) -> None:
    with world(tmp_path) as w:
        core = w.serving()
        assert w.ask(method, "/m", body=b"abc").status == 200
        (call,) = core.wait("/m")
        assert (call.request.method, call.request.body) == (method, b"abc")


def test_a_head_request_gets_the_length_and_no_body(tmp_path: Path) -> None:
    def script(call: Call) -> None:
        call.raw(b"HTTP/1.1 200 OK\r\nContent-Length: 5\r\nX-Core-Epoch: 1\r\n\r\n")

    with world(tmp_path) as w:
        w.serving(script)
        client = w.client()
        for _ in range(2):
            answer = client.ask("HEAD", "/").read(head=True)
            assert (answer.status, answer.header("Content-Length")) == (200, "5")


@pytest.mark.parametrize("status", [204, 304])
def test_an_answer_without_a_body_keeps_the_connection(tmp_path: Path, status: int) -> None:
    def script(call: Call) -> None:
        call.raw(f"HTTP/1.1 {status} X\r\nX-Core-Epoch: 1\r\n\r\n".encode())

    with world(tmp_path) as w:
        w.serving(script)
        client = w.client()
        assert client.ask("GET", "/").read().status == status
        assert client.ask("GET", "/").read().status == status


def test_a_chunked_body_arrives_whole(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        core = w.serving()
        head = b"POST /c HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\n"
        client = w.client().send(head + b"3\r\nabc\r\n2;ext=1\r\nde\r\n0\r\nX-Trailer: 1\r\n\r\n")
        assert client.read().status == 200
        (call,) = core.wait("/c")
        assert call.request.body == b"abcde"
        assert call.request.header("Content-Length") == "5"
        assert call.request.header("X-Trailer") is None


def test_a_chunked_answer_arrives_with_a_length(tmp_path: Path) -> None:
    def script(call: Call) -> None:
        head = b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\nX-Core-Epoch: 1\r\n\r\n"
        call.raw(head + b"3\r\nabc\r\n3\r\ndef\r\n0\r\n\r\n")

    with world(tmp_path) as w:
        w.serving(script)
        answer = w.ask("GET", "/")
        assert (answer.header("Content-Length"), answer.body) == ("6", b"abcdef")


def test_headers_between_hops_are_removed_both_ways(tmp_path: Path) -> None:
    def script(call: Call) -> None:
        hops = ("Connection: X-Hop", "X-Hop: 1", "Keep-Alive: timeout=5", "X-Stays: 1", "Upgrade: h2c")
        call.answer(200, headers=hops)

    with world(tmp_path) as w:
        core = w.serving(script)
        hops = (
            "Connection: X-Mine, keep-alive",
            "X-Mine: 1",
            "TE: trailers",
            "Proxy-Connection: x",
            "X-Stays: 1",
        )
        answer = w.ask("GET", "/h", *hops)
        (call,) = core.wait("/h")
        assert [name for name, _ in call.request.headers] == ["Host", "X-Stays"]
        assert answer.header("X-Hop") is None
        assert answer.header("Keep-Alive") is None
        assert answer.header("Upgrade") is None
        assert answer.header("X-Stays") == "1"


def test_what_only_we_may_claim_does_not_pass_from_outside(tmp_path: Path) -> None:
    claims = ("X-Forwarded-For: 1.2.3.4", "X-Forwarded-Proto: https", "Forwarded: for=1", "X-Actor: admin")
    with world(tmp_path) as w:
        core = w.serving()
        w.ask("GET", "/f", *claims, "X-Core-Epoch: 9", "X-Core-Draining: 1", "x-forwarded-host: evil")
        (call,) = core.wait("/f")
        assert [name for name, _ in call.request.headers] == ["Host"]


def test_a_client_cannot_forge_the_epoch_of_an_answer(tmp_path: Path) -> None:
    def script(call: Call) -> None:
        call.answer(200, headers=("x-core-epoch: 1", "X-Core-Secret: 1"), epoch=None)

    with world(tmp_path) as w:
        w.serving(script)
        answer = w.ask("GET", "/")
        assert [name for name, _ in answer.headers if name.lower().startswith("x-core")] == []


def test_pipelined_requests_are_answered_in_order(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.serving()
        client = w.client()
        targets = [f"/p{n}" for n in range(300)]
        client.send(b"".join(f"GET {t} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode() for t in targets))
        assert [client.read().json()["target"] for _ in targets] == targets


def test_pipelined_requests_are_all_answered_when_the_client_says_no_more(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.serving()
        client = w.client().ask("GET", "/1").ask("GET", "/livez").ask("POST", "/3", body=b"x")
        client.socket.shutdown(socket.SHUT_WR)
        assert [client.read().status for _ in range(3)] == [200, 200, 200]
        assert client.closed()


def test_a_body_is_called_for_when_the_client_waits_for_that(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        core = w.serving()
        client = w.client().ask("POST", "/e", "Expect: 100-continue", "Content-Length: 3")
        assert client.read().status == 100
        assert client.send(b"abc").read().status == 200
        assert core.wait("/e")[0].request.header("Expect") is None


def test_http_1_0_is_answered_and_closed(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.serving()
        client = w.client().send(b"GET / HTTP/1.0\r\nHost: localhost\r\n\r\n")
        assert client.read().status == 200
        assert client.closed()


def test_http_1_0_keeps_the_connection_if_asked(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.serving()
        client = w.client()
        for _ in range(2):
            client.send(b"GET / HTTP/1.0\r\nHost: localhost\r\nConnection: keep-alive\r\n\r\n")
            assert client.read().header("Connection") == "keep-alive"


def test_an_upgrade_is_answered_as_a_plain_request(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.serving()
        client = w.client().ask("GET", "/u", "Connection: upgrade", "Upgrade: h2c")
        answer = client.read()
        assert (answer.status, answer.header("Connection")) == (200, "close")
        assert client.closed()


def test_connections_to_the_core_are_used_again(tmp_path: Path) -> None:
    with world(tmp_path, upstream_idle_ms=600_000) as w:
        core = w.serving()
        assert w.ask("GET", "/").status == 200
        opened = core.connections
        for _ in range(20):
            assert w.ask("GET", "/").status == 200
        assert core.connections == opened


def test_connections_to_the_core_are_bounded_and_the_rest_wait(tmp_path: Path) -> None:
    with world(tmp_path, upstream_connections_max=2) as w:
        core = w.serving(silent)
        clients = [w.client().ask("GET", f"/{n}") for n in range(5)]
        w.wait_held(3)
        assert len(core.calls.all()) == 2
        core.script = echo
        for call in core.calls.all():
            echo(call)
        assert [client.read().status for client in clients] == [200] * 5


def test_a_long_answer_to_a_safe_request_is_streamed_whole(tmp_path: Path) -> None:
    body = bytes(range(256)) * 20_000
    with world(tmp_path, answer_buffer_bytes_max=1000) as w:
        w.serving(lambda call: call.answer(200, body))
        client = w.client()
        answer = client.ask("GET", "/").read()
        assert answer.body == body
        assert answer.header("Content-Length") == str(len(body))
        assert client.ask("GET", "/").read().body == body


def test_a_long_answer_of_unknown_length_is_streamed_in_chunks(tmp_path: Path) -> None:
    def script(call: Call) -> None:
        call.raw(b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\nX-Core-Epoch: 1\r\n\r\n")
        for _ in range(50):
            call.raw(b"400\r\n" + b"x" * 0x400 + b"\r\n")
        call.raw(b"0\r\n\r\n")

    with world(tmp_path, answer_buffer_bytes_max=1000) as w:
        w.serving(script)
        answer = w.ask("GET", "/")
        assert (answer.header("Transfer-Encoding"), answer.body) == ("chunked", b"x" * 0x400 * 50)


def test_an_event_stream_leaves_as_it_comes(tmp_path: Path) -> None:
    calls = []

    def script(call: Call) -> None:
        calls.append(call)
        head = "HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\nX-Core-Epoch: 1\r\nContent-Type: text/event-stream"
        call.raw(f"{head}\r\n\r\n4\r\none\n\r\n".encode())

    with world(tmp_path) as w:
        w.serving(script)
        client = w.client().ask("GET", "/events")
        seen = b""
        while b"one" not in seen:
            seen += client.socket.recv(4096)
        calls[0].raw(b"4\r\ntwo\n\r\n0\r\n\r\n")
        while not seen.endswith(b"0\r\n\r\n"):
            seen += client.socket.recv(4096)
        assert b"two" in seen


def test_a_large_body_is_streamed_to_the_core(tmp_path: Path) -> None:
    body = bytes(range(256)) * 12_000
    with world(tmp_path, replay_body_bytes_max=1000) as w:
        core = w.serving()
        client = w.client()
        assert client.ask("POST", "/big", body=body).read().status == 200
        assert core.wait("/big")[0].request.body == body
        assert client.ask("GET", "/next").read().status == 200


def test_a_large_chunked_body_is_streamed_to_the_core(tmp_path: Path) -> None:
    with world(tmp_path, replay_body_bytes_max=1000) as w:
        core = w.serving()
        client = w.client().send(b"POST /b HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\n")
        for _ in range(100):
            client.send(b"1000\r\n" + b"z" * 0x1000 + b"\r\n")
        client.send(b"0\r\n\r\n")
        assert client.read().status == 200
        (call,) = core.wait("/b")
        assert call.request.body == b"z" * 0x1000 * 100
        assert client.ask("GET", "/next").read().status == 200


def test_a_body_over_the_limit_is_refused_before_it_is_read(tmp_path: Path) -> None:
    with world(tmp_path, body_bytes_max=10) as w:
        core = w.serving()
        client = w.client().send(b"POST /l HTTP/1.1\r\nHost: localhost\r\nContent-Length: 11\r\n\r\n")
        answer = client.read()
        assert (answer.status, answer.json()["type"]) == (413, "/problems/body-too-large")
        assert client.closed() is not None
        assert core.targets() == []


def test_a_chunked_body_over_the_limit_is_refused(tmp_path: Path) -> None:
    with world(tmp_path, body_bytes_max=10) as w:
        w.serving()
        client = w.client().send(b"POST / HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\n")
        assert client.send(b"b\r\n01234567890\r\n").read().status == 413


def test_an_early_answer_arrives_though_the_body_does_not_end(tmp_path: Path) -> None:
    with world(tmp_path, replay_body_bytes_max=10, upstream_idle_ms=10) as w:
        core = w.serving()
        core.at_head = lambda call: call.answer(422, b"enough")
        client = w.client().send(b"POST /early HTTP/1.1\r\nHost: localhost\r\nContent-Length: 100000\r\n\r\n")
        client.send(b"x" * 1000)
        answer = client.read()
        assert (answer.status, answer.body, answer.header("Connection")) == (422, b"enough", "close")
        client.send(b"x" * 99_000)
        assert client.closed()


@pytest.mark.parametrize("answer", [b"nonsense\r\n\r\n", b"HTTP/1.1 200 OK\r\nX-Core-Epoch: 1\r\n\r\nbody"])
def test_an_answer_that_cannot_be_read_is_a_problem_and_not_passed_on(tmp_path: Path, answer: bytes) -> None:
    with world(tmp_path) as w:
        w.serving(lambda call: call.raw(answer))
        refused = w.ask("POST", "/", body=b"")
        assert refused.status == 502
        assert refused.json()["outcome"] == "unknown"
        assert refused.header("Content-Type") == "application/problem+json"


def test_an_answer_that_names_no_epoch_is_not_passed_on(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.serving(lambda call: call.answer(200, b"whose", epoch=None))
        assert w.ask("GET", "/").status == 502


def test_a_core_that_does_not_answer_in_time_is_a_504_whose_outcome_is_unknown(tmp_path: Path) -> None:
    with world(tmp_path, upstream_deadline_ms=50) as w:
        core = w.serving(silent)
        client = w.client()
        late = client.ask("POST", "/slow", body=b"").read()
        assert (late.status, late.json()["outcome"]) == (504, "unknown")
        core.wait("/slow")[0].wait_closed()
        core.script = echo
        assert client.ask("GET", "/").read().status == 200


def test_a_safe_request_that_was_too_slow_leaves_nothing_unknown(tmp_path: Path) -> None:
    with world(tmp_path, upstream_deadline_ms=50) as w:
        w.serving(silent)
        late = w.ask("GET", "/slow")
        assert (late.status, late.json()["outcome"]) == (504, "not_done")


def test_a_client_that_leaves_takes_its_request_with_it(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        core = w.serving(silent)
        client = w.client().ask("GET", "/gone")
        (call,) = core.wait("/gone")
        client.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
        client.close()
        call.wait_closed()


def test_the_language_of_a_problem_is_the_clients(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.serving(silent)
        korean = (
            w.client().send(b"POST /livez HTTP/1.1\r\nHost: localhost\r\nAccept-Language: ko\r\n\r\n").read()
        )
        english = w.client().send(b"POST /livez HTTP/1.1\r\nHost: localhost\r\n\r\n").read()
        assert korean.header("Content-Language") == "ko"
        assert english.header("Content-Language") == "en"
        assert korean.json()["title"] != english.json()["title"]
        assert korean.header("Allow") == english.header("Allow")


def test_no_request_is_named_in_the_log(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.serving()
        w.ask("GET", "/private-path?private-query", "Cookie: private-cookie", body=b"private-body")
        w.client().send(b"GET /private-path HTTP/1.1\nprivate\n\n").read()
        w.terminate()
        assert w.process is not None
        assert w.process.wait(20) == 0
        assert b"private" not in w.log.read_bytes()


def test_health_answers_are_small_and_readable(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.serving()
        assert json.loads(w.ask("GET", "/livez").body) == {"alive": True}
        assert json.loads(w.ask("GET", "/readyz").body) == {"ready": True, "state": "OPERATIONAL"}
        assert w.ask("HEAD", "/livez").status == 200


def _flooded(w: World, count: int) -> list[int]:
    clients = [w.client() for _ in range(count)]
    return [client.ask("GET", "/r").read().status for client in clients]


def test_a_connection_over_the_limit_is_told_so(tmp_path: Path) -> None:
    with world(tmp_path, connections_max=2) as w:
        w.serving()
        assert _flooded(w, 3) == [200, 200, 503]


def test_a_large_body_is_called_for_when_there_is_a_core_to_take_it(tmp_path: Path) -> None:
    with world(tmp_path, replay_body_bytes_max=2) as w:
        w.holding()
        client = w.client().ask("POST", "/e", "Expect: 100-continue", "Content-Length: 5")
        w.wait_held(1)
        core = w.core(2)
        w.feed.serve(core)
        assert client.read().status == 100
        assert client.send(b"abcde").read().status == 200
        assert core.wait("/e")[0].request.body == b"abcde"


def test_a_body_that_would_be_turned_away_is_not_called_for(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.holding()
        w.feed.phase("REFUSE", phase="FATAL", state="MANUAL_INTERVENTION")
        w.feed.phase("REFUSE", phase="FATAL", state="DEGRADED")
        until(lambda: w.ask("GET", "/readyz").json()["state"] == "DEGRADED", "the gateway to have heard it")
        client = w.client().ask("POST", "/e", "Expect: 100-continue", "Content-Length: 5")
        assert client.read().json()["type"] == "/problems/not-serving"


def test_a_core_that_says_a_head_without_end_is_not_listened_to(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.serving(lambda call: call.raw(b"HTTP/1.1 200 OK\r\nX: " + b"a" * (1 << 20)))
        assert w.ask("GET", "/").status == 502
