"""What a gateway refuses at the door: ambiguous, foreign, endless or slow requests."""

import select
from pathlib import Path

import pytest

from tests.contract.gateway_world import Client, World, echo, world
from tests.waiting import until

HOST = b"Host: localhost\r\n"

UNREADABLE = {
    "length and chunks": b"POST / HTTP/1.1\r\n"
    + HOST
    + b"Content-Length: 3\r\nTransfer-Encoding: chunked\r\n\r\nabc",
    "chunks and length": b"POST / HTTP/1.1\r\n"
    + HOST
    + b"Transfer-Encoding: chunked\r\nContent-Length: 3\r\n\r\nabc",
    "two lengths": b"POST / HTTP/1.1\r\n" + HOST + b"Content-Length: 3\r\nContent-Length: 3\r\n\r\nabc",
    "a list of lengths": b"POST / HTTP/1.1\r\n" + HOST + b"Content-Length: 3, 3\r\n\r\nabc",
    "a signed length": b"POST / HTTP/1.1\r\n" + HOST + b"Content-Length: +3\r\n\r\nabc",
    "bare line feed": b"GET / HTTP/1.1\n" + HOST + b"\r\n",
    "bare line feed in a header": b"GET / HTTP/1.1\r\nHost: localhost\nX: 1\r\n\r\n",
    "bare line feed in a chunk": b"POST / HTTP/1.1\r\n"
    + HOST
    + b"Transfer-Encoding: chunked\r\n\r\n3\nabc\r\n0\r\n\r\n",
    "a folded line": b"GET / HTTP/1.1\r\n" + HOST + b"X: 1\r\n 2\r\n\r\n",
    "a space before the colon": b"GET / HTTP/1.1\r\n" + HOST + b"X : 1\r\n\r\n",
    "no host": b"GET / HTTP/1.1\r\nX: 1\r\n\r\n",
    "two hosts": b"GET / HTTP/1.1\r\n" + HOST + HOST + b"\r\n",
    "another coding": b"POST / HTTP/1.1\r\n" + HOST + b"Transfer-Encoding: gzip, chunked\r\n\r\n0\r\n\r\n",
    "chunked twice": b"POST / HTTP/1.1\r\n" + HOST + b"Transfer-Encoding: chunked\r\n" * 2 + b"\r\n0\r\n\r\n",
    "chunks in HTTP/1.0": b"POST / HTTP/1.0\r\n" + HOST + b"Transfer-Encoding: chunked\r\n\r\n0\r\n\r\n",
    "HTTP/0.9": b"GET /\r\n\r\n",
    "HTTP/2": b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
    "another origin's target": b"GET http://localhost/ HTTP/1.1\r\n" + HOST + b"\r\n",
    "no path": b"OPTIONS * HTTP/1.1\r\n" + HOST + b"\r\n",
    "a control character": b"GET / HTTP/1.1\r\n" + HOST + b"X: a\x00b\r\n\r\n",
    "two keys": b"POST / HTTP/1.1\r\n" + HOST + b"Idempotency-Key: a\r\nIdempotency-Key: b\r\n\r\n",
    "an upgrade with a body": (
        b"POST / HTTP/1.1\r\n" + HOST + b"Content-Length: 3\r\nConnection: upgrade\r\nUpgrade: x\r\n\r\nabc"
    ),
    "not HTTP": b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03",
}


def test_a_request_that_two_parsers_could_read_differently_is_refused(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        core = w.serving()
        for name, data in UNREADABLE.items():
            client = w.client().send(data)
            answer = client.read()
            assert answer.status in {400, 405}, name
            assert answer.header("Content-Type") == "application/problem+json", name
            assert answer.header("Connection") == "close", name
        assert core.targets() == []
        assert w.ask("GET", "/after").status == 200


def test_what_follows_an_unreadable_request_is_not_a_request(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        core = w.serving()
        smuggled = b"GET /smuggled HTTP/1.1\r\n" + HOST + b"\r\n"
        client = w.client().send(
            b"GET /first HTTP/1.1\r\n" + HOST + b"\r\n" + UNREADABLE["two lengths"] + smuggled
        )
        assert [client.read().status, client.read().status] == [200, 400]
        assert client.closed()
        assert core.targets() == ["/first"]


@pytest.mark.parametrize("method", [b"TRACE", b"CONNECT", b"BREW", b"PROPFIND"])
def test_a_method_nobody_uses_is_refused(tmp_path: Path, method: bytes) -> None:
    with world(tmp_path) as w:
        w.serving()
        answer = w.client().send(method + b" / HTTP/1.1\r\n" + HOST + b"\r\n").read()
        assert answer.status in {400, 405}


@pytest.mark.parametrize("host", ["evil.example", "localhost.evil", "127.0.0.1:x", "", "[::1", "10.0.0.1"])
def test_a_foreign_host_is_misdirected(tmp_path: Path, host: str) -> None:
    with world(tmp_path) as w:
        core = w.serving()
        answer = w.client().send(f"GET / HTTP/1.1\r\nHost: {host}\r\n\r\n".encode()).read()
        assert answer.status == 421
        assert answer.json()["type"] == "/problems/wrong-host"
        assert core.targets() == []


@pytest.mark.parametrize(
    "host", ["LOCALHOST", "127.0.0.1:3000", "[::1]:3000", "[::1]", "box.lan", "Box.Lan:80"]
)
def test_a_known_host_is_served(tmp_path: Path, host: str) -> None:
    with world(tmp_path, "--allow-host", "box.lan") as w:
        w.serving()
        assert w.client().send(f"GET / HTTP/1.1\r\nHost: {host}\r\n\r\n".encode()).read().status == 200


def test_a_head_that_never_ends_is_cut_off(tmp_path: Path) -> None:
    with world(tmp_path, header_bytes_max=600) as w:
        w.serving()
        client = w.client().send(b"GET / HTTP/1.1\r\n" + HOST + b"X: " + b"a" * 8000)
        assert client.read().status == 431


def test_a_head_over_the_limit_is_refused_also_when_it_is_whole(tmp_path: Path) -> None:
    with world(tmp_path, header_bytes_max=600) as w:
        w.serving()
        assert w.ask("GET", "/", "X: " + "a" * 600).status == 431


def test_too_many_headers_are_refused(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.serving()
        assert w.ask("GET", "/", *(f"X-{n}: 1" for n in range(200))).status == 431


def test_a_head_that_does_not_come_times_out(tmp_path: Path) -> None:
    with world(tmp_path, header_timeout_ms=50) as w:
        w.serving()
        client = w.client().send(b"GET / HTTP/1.1\r\nHo")
        answer = client.read()
        assert (answer.status, answer.json()["outcome"]) == (408, "not_done")


def test_a_body_that_does_not_come_times_out(tmp_path: Path) -> None:
    with world(tmp_path, header_timeout_ms=50) as w:
        core = w.serving()
        client = w.client().send(b"POST /b HTTP/1.1\r\n" + HOST + b"Content-Length: 5\r\n\r\nab")
        assert client.read().status == 408
        assert core.targets() == []


def test_a_streamed_body_that_stops_is_not_taken_for_a_whole_one(tmp_path: Path) -> None:
    with world(tmp_path, header_timeout_ms=50, replay_body_bytes_max=10) as w:
        core = w.serving()
        client = w.client().send(b"POST /b HTTP/1.1\r\n" + HOST + b"Content-Length: 500\r\n\r\nab")
        answer = client.read()
        assert (answer.status, answer.json()["outcome"]) == (408, "unknown")
        assert core.targets() == []


def test_an_idle_connection_is_closed_in_silence(tmp_path: Path) -> None:
    with world(tmp_path, keepalive_ms=50) as w:
        w.serving()
        assert w.client().closed()


def test_an_expectation_we_do_not_know_is_refused(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.serving()
        assert w.ask("GET", "/", "Expect: the-unexpected").status == 417


def test_bytes_for_bodies_are_counted_before_they_are_read(tmp_path: Path) -> None:
    with world(tmp_path, hold_bytes_max=1024) as w:
        w.serving()
        first = w.client().send(b"POST /1 HTTP/1.1\r\n" + HOST + b"Content-Length: 1000\r\n\r\n")
        w.feed.wait("stats", lambda line: line["connections"] == 1)
        second = w.client().send(b"POST /2 HTTP/1.1\r\n" + HOST + b"Content-Length: 1000\r\n\r\n")
        refused = second.read()
        assert (refused.status, refused.json()["outcome"]) == (503, "not_done")
        assert first.send(b"x" * 1000).read().status == 200
        assert w.ask("POST", "/3", body=b"x" * 1000).status == 200


def test_a_slow_reader_loses_its_own_connection_only(tmp_path: Path) -> None:
    with world(tmp_path, client_stall_ms=100, answer_buffer_bytes_max=1000) as w:
        core = w.serving(lambda call: call.answer(200, b"x" * (32 << 20)))
        slow = w.client().ask("GET", "/huge")
        core.wait("/huge")
        core.script = lambda call: call.answer(200, b"small")
        assert w.ask("GET", "/small").body == b"small"
        w.feed.wait("stats", lambda line: line["connections"] == 1 and line["forwarded"] == 0)
        assert w.ask("GET", "/small").body == b"small"
        slow.close()


def _drips_until_answered(client: Client) -> bool:
    client.socket.sendall(b"x")
    readable, _, _ = select.select([client.socket], [], [], 0.02)
    return bool(readable)


@pytest.mark.parametrize("kept", [True, False], ids=["kept", "streamed"])
def test_a_body_that_drips_is_ended_though_it_is_never_silent(tmp_path: Path, *, kept: bool) -> None:
    limits = {"header_timeout_ms": 200, "replay_body_bytes_max": 1 << 20 if kept else 2}
    with world(tmp_path, **limits) as w:
        w.serving()
        client = w.client().send(b"POST /b HTTP/1.1\r\n" + HOST + b"Content-Length: 100000\r\n\r\n")
        until(lambda: _drips_until_answered(client), "an answer to a body that drips")
        answer = client.read()
        assert (answer.status, answer.json()["outcome"]) == (408, "not_done" if kept else "unknown")


def test_there_is_one_bound_for_what_all_clients_leave_unread(tmp_path: Path) -> None:
    with world(tmp_path, answers_bytes_max=100_000, answer_buffer_bytes_max=1 << 20) as w:
        core = w.serving(lambda call: call.answer(200, b"x" * (32 << 20)))
        slow = w.client().ask("GET", "/huge")
        core.wait("/huge")[0].wait_closed()
        core.script = echo
        assert w.ask("GET", "/small").status == 200
        slow.close()


def test_a_safe_answer_for_which_there_is_no_room_is_streamed_and_an_unsafe_one_is_unknown(
    tmp_path: Path,
) -> None:
    body = b"x" * 300_000
    with world(tmp_path, answers_bytes_max=100_000) as w:
        w.serving(lambda call: call.answer(200, body))
        assert w.ask("GET", "/r").body == body
        refused = w.ask("POST", "/w", body=b"")
        assert (refused.status, refused.json()["outcome"]) == (502, "unknown")
        assert w.ask("GET", "/r").body == body  # and nothing is left of either in the count


def test_a_body_in_many_tiny_chunks_arrives_whole(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        core = w.serving()
        head = b"POST /t HTTP/1.1\r\n" + HOST + b"Transfer-Encoding: chunked\r\n\r\n"
        client = w.client().send(head + b"2\r\nab\r\n" * 3000 + b"0\r\n\r\n")
        assert client.read().status == 200
        assert core.wait("/t")[0].request.body == b"ab" * 3000


def _is_served(w: World) -> bool:
    client = w.client()
    status = client.ask("GET", "/r").read().status
    client.close()
    return status == 200


def test_one_address_never_has_all_the_places(tmp_path: Path) -> None:
    with world(tmp_path, connections_per_address_max=2) as w:
        w.serving()
        clients = [w.client() for _ in range(3)]
        assert [client.ask("GET", "/r").read().status for client in clients] == [200, 200, 503]
        clients[0].close()
        until(lambda: _is_served(w), "a place to be free again")


def test_whoever_comes_to_a_crowd_is_told_so_and_takes_no_place(tmp_path: Path) -> None:
    with world(tmp_path, connections_max=1, turned_away_max=1) as w:
        w.serving()
        clients = [w.client() for _ in range(6)]
        answers = [client.read() for client in clients[1:]]
        assert [answer.status for answer in answers] == [503] * 5
        assert {answer.json()["outcome"] for answer in answers} == {"not_done"}
        assert clients[0].ask("GET", "/livez").read().status == 200
