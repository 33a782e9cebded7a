"""The way to the investigators' pages: from this machine only, in every phase, and never the ledger's business."""

import contextlib
import socket
import struct
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.contract.gateway_world import Call, Core, World, echo, world
from tests.waiting import until

TAB = "Accept: text/html"
EVENTS = b"Content-Type: text/event-stream"


@pytest.fixture
def w(tmp_path: Path) -> Iterator[World]:
    """A gateway of which no core serves: the dashboard has to be there all the same."""
    with world(
        tmp_path, "--investigator", str(tmp_path / "admin.sock"), investigator_ms=15_000, drain_ms=2_000
    ) as made:
        made.holding()
        yield made


@contextlib.contextmanager
def investigators(w: World) -> Iterator[Core]:
    """Somebody who listens where the investigators do; answers with what was asked."""
    one = Core(w.folder / "admin.sock", 0, echo)
    try:
        yield one
    finally:
        one.close()


@contextlib.contextmanager
def slow_world(folder: Path) -> Iterator[World]:
    """A gateway whose answers may be silent for a short time only, and whose readers may be slow."""
    limits = {"upstream_deadline_ms": 1_000, "client_stall_ms": 20_000}
    with world(folder, "--investigator", str(folder / "admin.sock"), **limits) as made:
        made.holding()
        yield made


def begin_events(call: Call) -> None:
    """The beginning of a stream that has no end."""
    call.raw(b"HTTP/1.1 200 OK\r\n" + EVENTS + b"\r\nTransfer-Encoding: chunked\r\n\r\n")
    call.raw(b"7\r\ndata: 1\r\n")


def test_the_dashboard_is_served_while_no_core_lives(w: World) -> None:
    with investigators(w) as admin:
        answer = w.ask("GET", "/admin/incidents?page=2", "X-Admin: 0")
        assert (answer.status, answer.json()["target"]) == (200, "/admin/incidents?page=2")
        assert answer.header("X-Core-Epoch") is None
        (call,) = admin.wait("/admin/incidents?page=2")
        assert [v for n, v in call.request.headers if n == "X-Admin"] == ["1"]
        assert w.ask("POST", "/admin/api/letters/1/hold", body=b"{}").status == 200
        assert w.ask("HEAD", "/admin").status == 200


@pytest.mark.parametrize(
    "header", ["X-Forwarded-For: 127.0.0.1", "Forwarded: for=::1", "X-Real-IP: 1.2.3.4", "Via: 1.1 proxy"]
)
def test_whoever_was_forwarded_is_refused(w: World, header: str) -> None:
    with investigators(w) as admin:
        refused = w.ask("GET", "/admin", header)
        assert (refused.status, refused.json()["type"]) == (403, "/problems/admin-local")
        page = w.ask("GET", "/admin", header, TAB, "Accept-Language: ko")
        assert page.status == 403
        assert "서버 컴퓨터에서만" in page.body.decode()
        assert admin.calls.all() == []


def test_a_name_that_may_be_a_proxys_is_refused(tmp_path: Path) -> None:
    options = ("--investigator", str(tmp_path / "admin.sock"), "--allow-host", "ledger.example")
    with world(tmp_path, *options) as w, investigators(w) as admin:
        w.holding()
        asked = w.client().send(b"GET /admin HTTP/1.1\r\nHost: ledger.example\r\n\r\n").read()
        assert asked.status == 403
        assert admin.calls.all() == []


def test_whoever_asks_while_nobody_listens_waits_until_the_guard_has_started_them(w: World) -> None:
    client = w.client().ask("GET", "/admin/")
    w.feed.wait("investigate")
    with investigators(w):
        assert client.read().status == 200


def test_who_can_not_be_started_is_said_calmly(tmp_path: Path) -> None:
    with world(tmp_path, "--investigator", str(tmp_path / "no.sock"), investigator_ms=50) as w:
        w.holding()
        answer = w.ask("GET", "/admin/", TAB, "Accept-Language: ko")
        assert (answer.status, answer.header("Retry-After")) == (503, "5")
        assert "관리 화면을 켜고 있어요" in answer.body.decode()


def test_without_investigators_there_is_nothing_there_and_no_core_sees_it(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        core = w.serving()
        assert w.ask("GET", "/admin/x").status == 404
        assert w.ask("GET", "/administration").status == 200
        assert core.targets() == ["/administration"]


def test_a_long_answer_is_passed_on_whole_and_as_it_comes(w: World) -> None:
    piece = b"Q" * 100_000
    go_on = threading.Event()

    def long(call: Call) -> None:
        call.raw(b"HTTP/1.1 200 OK\r\nContent-Type: application/zip\r\nTransfer-Encoding: chunked\r\n\r\n")
        for count in range(20):
            if count == 10:
                assert go_on.wait(20)
            call.raw(b"%x\r\n%b\r\n" % (len(piece), piece))
        call.raw(b"0\r\n\r\n")

    with investigators(w) as admin:
        admin.script = long
        client = w.client().ask("GET", "/admin/api/incidents/1/zip")
        assert client.socket.recv(15) == b"HTTP/1.1 200 OK"  # the first half came before the second was there
        go_on.set()
        client.send(b"")
        taken = bytearray()
        while not taken.endswith(b"0\r\n\r\n"):
            taken += client.socket.recv(1 << 16)
        assert taken.count(b"Q") == 20 * len(piece)


def test_investigators_who_stop_in_the_middle_are_not_waited_for_once_their_reader_has_caught_up(
    tmp_path: Path,
) -> None:
    piece = b"Q" * 100_000

    def half(call: Call) -> None:
        call.raw(b"HTTP/1.1 200 OK\r\nContent-Type: application/zip\r\nTransfer-Encoding: chunked\r\n\r\n")
        for _ in range(40):
            call.raw(b"%x\r\n%b\r\n" % (len(piece), piece))

    with slow_world(tmp_path) as w, investigators(w) as admin:
        admin.script = half
        client = w.client()
        client.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 16)
        client.ask("GET", "/admin/api/incidents/1/zip")
        admin.wait("/admin/api/incidents/1/zip")
        taken = bytearray()
        while data := client.socket.recv(1 << 16):
            taken += data
        assert taken.count(b"Q") == 40 * len(piece)
        assert not taken.endswith(b"0\r\n\r\n")


def test_a_reader_who_is_slow_but_reads_is_not_cut_by_the_deadline_of_the_answer(tmp_path: Path) -> None:
    piece = b"Q" * 4_000  # many to a read: some come while the reader is slow already

    def whole(call: Call) -> None:
        call.raw(b"HTTP/1.1 200 OK\r\nContent-Type: application/zip\r\nTransfer-Encoding: chunked\r\n\r\n")
        for _ in range(2_000):
            call.raw(b"%x\r\n%b\r\n" % (len(piece), piece))
        call.raw(b"0\r\n\r\n")

    with slow_world(tmp_path) as w, investigators(w) as admin:
        admin.script = whole
        client = w.client()
        client.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 16)
        client.ask("GET", "/admin/api/incidents/1/zip")
        admin.wait("/admin/api/incidents/1/zip")
        taken, pause = bytearray(), threading.Event()
        while len(taken) < 240_000:  # seconds at its pace: longer than any answer may be silent
            taken += client.socket.recv(1 << 12)
            pause.wait(0.05)
        while not taken.endswith(b"0\r\n\r\n"):
            data = client.socket.recv(1 << 16)
            assert data, "the answer was cut"
            taken += data
        assert taken.count(b"Q") == 2_000 * len(piece)


def test_an_answer_without_an_end_ends_with_the_gateway(w: World) -> None:
    with investigators(w) as admin:
        admin.script = begin_events
        client = w.client().ask("GET", "/admin/api/now/live")
        admin.wait("/admin/api/now/live")
        until(lambda: b"data: 1" in client.socket.recv(4096), "the first event")
        w.terminate()
        assert w.process is not None
        assert w.process.wait(20) == 0


def test_a_reader_who_leaves_lets_go_of_the_investigators(w: World) -> None:
    with investigators(w) as admin:
        admin.script = lambda _: None
        client = w.client().ask("GET", "/admin/slow")
        (call,) = admin.wait("/admin/slow")
        client.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        client.close()
        call.wait_closed()


def test_a_page_that_listens_no_more_lets_go_of_them_too(w: World) -> None:
    with investigators(w) as admin:
        admin.script = begin_events
        client = w.client().ask("GET", "/admin/api/now/live")
        (call,) = admin.wait("/admin/api/now/live")
        until(lambda: b"data: 1" in client.socket.recv(4096), "the first event")
        client.close()
        call.wait_closed()


def test_what_only_reads_is_asked_again_and_what_acts_is_not(w: World) -> None:
    with investigators(w) as admin:
        admin.script = lambda call: call.hang_up()
        acted = w.ask("POST", "/admin/api/letters/1/retry", body=b"{}")
        assert (acted.status, acted.json()["outcome"]) == (502, "unknown")
        assert w.ask("GET", "/admin/now").status == 502
        assert admin.targets() == ["/admin/api/letters/1/retry", "/admin/now", "/admin/now"]


def test_an_upload_has_its_bound(w: World) -> None:
    with investigators(w) as admin:
        client = w.client().send(
            b"POST /admin/x HTTP/1.1\r\nHost: localhost\r\nContent-Length: 1048577\r\n\r\n"
        )
        assert client.read().status == 413
        assert admin.calls.all() == []


def test_no_socket_leads_to_a_core_by_this_way(tmp_path: Path) -> None:
    with world(tmp_path, "--investigator", str(tmp_path / "admin.sock")) as w:
        core = w.serving()
        asked = w.client().ask(
            "GET",
            "/admin/ws",
            "Connection: Upgrade",
            "Upgrade: websocket",
            "Sec-WebSocket-Version: 13",
            "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==",
        )
        assert asked.read().status == 404
        assert core.targets() == []
