"""WebSockets through the gateway: the browser's end outlives the core, and nothing is lost, doubled or mixed."""

import threading
import time
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.contract.gateway_world import DEADLINE_S, Call, World, silent, world
from tests.contract.socket_world import HANDSHAKE, RESUMABLE, Ends, down, page
from tests.waiting import until


@pytest.fixture
def gate(tmp_path: Path) -> Iterator[World]:
    with world(tmp_path, probe_ms=20) as made:
        yield made


def _account(seq: int) -> dict[str, Any]:
    return {"v": 1, "type": "ledger.account", "seq": seq, "id": f"a{seq}"}


def _ledger(frame: Any) -> bool:
    return str(frame["type"]).startswith("ledger.")


def _next_core(gate: World, ends: Ends, epoch: int = 2) -> None:
    gate.feed.serve(gate.core(epoch, ends))


# -- the handshake -------------------------------------------------------------------------------------


def test_a_socket_leads_to_the_core_with_its_path_its_cookies_and_its_subprotocol(gate: World) -> None:
    ends = Ends()
    gate.serving(ends)
    with page(gate, "/ws?after=3&x=1", additional_headers=[("Cookie", "a=b")]) as tab:
        end = ends.wait()
        assert tab.subprotocol == RESUMABLE
        assert end.target == "/ws?after=3&x=1"
        assert end.request.header("Cookie") == "a=b"
        assert end.request.header("Host") == f"127.0.0.1:{gate.port}"
        assert end.request.header("Sec-WebSocket-Extensions") is None
        end.say(_account(4))
        assert tab.read() == _account(4)
        end.say_bytes(b"\x00\xff")
        assert tab.read_raw() == b"\x00\xff"
        tab.say("hello").say(b"\x01")
        assert end.heard.wait(lambda _: True, 2) == [b"hello", b"\x01"]


def test_what_a_client_claims_of_itself_reaches_no_core(gate: World) -> None:
    ends = Ends()
    gate.serving(ends)
    claims = [("X-Core-Epoch", "9"), ("X-Forwarded-For", "1.2.3.4"), ("X-Actor", "me")]
    with page(gate, additional_headers=claims):
        request = ends.wait().request
        assert [request.header(name) for name, _ in claims] == [None, None, None]


@pytest.mark.parametrize("path", ["/ws", "/__hc/live"])
@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "http://localhost.evil.example", "http://localhost:1"]
)
def test_a_page_of_another_origin_gets_no_socket(gate: World, path: str, origin: str) -> None:
    core = gate.serving(Ends())
    answer = gate.ask("GET", path, *HANDSHAKE, f"Origin: {origin}")
    assert answer.status == 403
    assert answer.json()["type"] == "/problems/foreign-page"
    assert not core.targets()


def test_a_page_of_ours_and_a_program_get_one(gate: World) -> None:
    ends = Ends()
    gate.serving(ends)
    own = f"http://127.0.0.1:{gate.port}"
    with page(gate, origin=own), page(gate):
        assert [ends.wait(n).request.header("Origin") for n in (1, 2)] == [own, None]


def test_a_socket_asked_for_under_a_strangers_name_is_refused(gate: World) -> None:
    core = gate.serving(Ends())
    said = "\r\n".join(["GET /ws HTTP/1.1", "Host: evil.example", *HANDSHAKE, "", ""])
    assert gate.client().send(said.encode()).read().status == 421
    assert not core.targets()


@pytest.mark.parametrize(
    ("method", "headers"),
    [
        ("POST", HANDSHAKE),
        ("GET", HANDSHAKE[:2] + HANDSHAKE[3:4]),
        ("GET", HANDSHAKE[:3]),
        ("GET", (*HANDSHAKE[:3], "Sec-WebSocket-Key: short")),
        ("GET", (*HANDSHAKE, "Sec-WebSocket-Key: BAAAAAAAAAAAAAAAAAAAAA==")),
        ("GET", (*HANDSHAKE[:2], "Sec-WebSocket-Version: 8", HANDSHAKE[3])),
        ("GET", (*HANDSHAKE, "Sec-WebSocket-Protocol: a b")),
    ],
)
def test_a_handshake_that_is_none_is_refused_before_any_core(
    gate: World, method: str, headers: tuple[str, ...]
) -> None:
    core = gate.serving(Ends())
    assert gate.ask(method, "/ws", *headers).status == 400
    assert not core.targets()


def test_a_client_that_speaks_before_it_was_answered_is_refused(gate: World) -> None:
    gate.serving(Ends())
    said = "\r\n".join(["GET /ws HTTP/1.1", "Host: localhost", *HANDSHAKE, "", ""]).encode()
    assert gate.client().send(said + b"\x81\x80\x00\x00\x00\x00").read().status == 400


def test_a_refusal_of_the_core_is_passed_on(gate: World) -> None:
    gate.serving(lambda call: call.answer(418, b"no tea", headers=("X-Why: tea",)))
    answer = gate.ask("GET", "/ws", *HANDSHAKE)
    assert (answer.status, answer.body, answer.header("X-Why")) == (418, b"no tea", "tea")
    assert answer.header("X-Core-Epoch") is None


@pytest.mark.parametrize("epoch", [None, 7])
def test_a_core_of_another_epoch_is_not_believed(gate: World, epoch: int | None) -> None:
    gate.serving(Ends(epoch=epoch))
    answer = gate.ask("GET", "/ws", *HANDSHAKE)
    assert answer.status == 502
    assert answer.json()["type"] == "/problems/broken-answer"


def test_requests_before_a_socket_on_the_same_connection_are_answered_first(gate: World) -> None:
    ends = Ends()

    def script(call: Call) -> None:
        if call.request.target == "/ws":
            ends(call)
        else:
            call.answer(200, b"first")

    gate.serving(script)
    client = gate.client().ask("GET", "/first").ask("GET", "/ws", *HANDSHAKE)
    assert client.read().body == b"first"
    assert client.read(head=True).status == 101


# -- over a death --------------------------------------------------------------------------------------


def test_a_socket_goes_on_at_the_next_core_where_it_stopped(gate: World) -> None:
    ends, next_ends = Ends(), Ends()
    core = gate.serving(ends)
    with page(gate, "/ws?x=1") as tab:
        for seq in (5, 6):
            ends.wait().say(_account(seq))
            assert tab.read()["seq"] == seq
        gate.die(core)
        assert tab.read_text("R1")["stage"] == 1
        _next_core(gate, next_ends)
        assert next_ends.wait().target == "/ws?x=1&after=6"
        next_ends.wait().say(_account(7))
        assert tab.read_until(_ledger) == _account(7)


def test_a_socket_that_has_seen_nothing_goes_on_as_it_asked(gate: World) -> None:
    next_ends = Ends()
    core = gate.serving(Ends())
    with page(gate, "/ws?after=3"):
        gate.die(core)
        _next_core(gate, next_ends)
        assert next_ends.wait().target == "/ws?after=3"


def test_nothing_is_asked_of_a_next_core_before_its_release(gate: World) -> None:
    next_ends = Ends()
    core = gate.serving(Ends())
    with page(gate) as tab:
        gate.die(core)
        tab.read_text("R1")
        after = gate.core(2, next_ends)
        gate.feed.say("serving", socket=str(after.path), epoch=2)
        gate.feed.phase("FORWARD", phase="PROBATION")
        # Told after both lines: so both were heard.
        tab.read_until(lambda frame: frame["phase"] == "PROBATION")
        assert not next_ends.ends.all()
        gate.feed.say("release", epoch=2, incident="i1")
        next_ends.wait()


def test_an_older_cores_words_never_follow_a_newer_ones(gate: World) -> None:
    ends, next_ends = Ends(), Ends()
    gate.serving(ends)
    with page(gate) as tab:
        older = ends.wait()
        older.say(_account(5))
        assert tab.read()["seq"] == 5
        _next_core(gate, next_ends)  # the older one lives on: a guard that was deceived
        next_ends.wait().say(_account(6))
        assert older.closed_with.wait(lambda _: True) == [1001]
        older.say(_account(99))
        next_ends.wait().say(_account(7))
        assert [tab.read_until(_ledger)["seq"] for _ in range(2)] == [6, 7]


def test_half_a_message_of_a_core_that_dies_is_never_said(gate: World) -> None:
    ends, next_ends = Ends(), Ends()
    core = gate.serving(ends)
    with page(gate) as tab:
        ends.wait().say_half(b'{"v":1,"type":"ledger.account","seq":9')
        gate.die(core)
        tab.read_text("R1")
        _next_core(gate, next_ends)
        assert next_ends.wait().target == "/ws"
        next_ends.wait().say(_account(1))
        assert tab.read_until(_ledger) == _account(1)


def test_a_core_that_leaves_with_a_word_is_followed_by_the_next(gate: World) -> None:
    ends, next_ends = Ends(), Ends()
    gate.serving(ends)
    with page(gate) as tab:
        ends.wait().say(_account(5))
        tab.read()
        down(gate.feed, time.monotonic_ns(), phase="STOPPING", planned=True)
        assert tab.read_text("R2")["planned"] is True
        ends.wait().close(1012)
        _next_core(gate, next_ends)
        assert next_ends.wait().target == "/ws?after=5"


def test_a_socket_of_another_kind_is_closed_once_the_core_is_back(gate: World) -> None:
    ends = Ends("chat")
    core = gate.serving(ends)
    with page(gate, "/other", "chat") as tab:
        ends.wait().say("hi")
        assert tab.read() == "hi"
        gate.die(core)
        gate.feed.wait("holding")
        tab.say("lost")  # it is open: saying something does not fail
        _next_core(gate, Ends("chat"))
        assert tab.closed() == 1012


def test_a_socket_asked_for_while_no_core_serves_waits_for_one(gate: World) -> None:
    ends = Ends()
    gate.holding()
    client = gate.client().ask("GET", "/ws", *HANDSHAKE)
    gate.feed.wait("stats", lambda line: line["websockets"] == 1)
    _next_core(gate, ends, 1)
    answer = client.read(head=True)
    assert (answer.status, answer.header("Sec-WebSocket-Protocol")) == (101, RESUMABLE)


def test_a_socket_that_waits_too_long_is_answered(tmp_path: Path) -> None:
    with world(tmp_path, hold_ms=50) as gate:
        gate.holding()
        answer = gate.ask("GET", "/ws", *HANDSHAKE)
        assert (answer.status, answer.json()["type"]) == (503, "/problems/recovering")


@pytest.mark.parametrize(("face", "problem"), [("REFUSE", "not-serving"), ("CLOSED", "shutting-down")])
def test_a_socket_is_turned_away_where_no_core_is_coming(gate: World, face: str, problem: str) -> None:
    gate.holding()
    gate.feed.phase(face, phase="FATAL")
    answer = gate.ask("GET", "/ws", *HANDSHAKE)
    assert (answer.status, answer.json()["type"]) == (503, f"/problems/{problem}")


def test_a_core_that_says_it_is_leaving_is_asked_again_only_after_a_release(gate: World) -> None:
    ends = Ends()

    def leaving(call: Call) -> None:
        call.answer(503, headers=("X-Core-Draining: 1",))

    core = gate.serving(leaving)
    client = gate.client().ask("GET", "/ws", *HANDSHAKE)
    core.wait("/ws")
    _next_core(gate, ends)
    assert client.read(head=True).status == 101
    assert core.targets() == ["/ws"]


def test_a_core_that_refuses_to_go_on_ends_the_socket(gate: World) -> None:
    core = gate.serving(Ends())
    with page(gate) as tab:
        gate.die(core)
        gate.feed.serve(gate.core(2, lambda call: call.answer(403)))
        assert tab.closed() == 1012


def test_a_next_core_of_another_epoch_ends_the_socket(gate: World) -> None:
    core = gate.serving(Ends())
    with page(gate) as tab:
        gate.die(core)
        gate.feed.serve(gate.core(2, Ends(epoch=3)))
        assert tab.closed() == 1012


def test_a_core_that_drops_a_socket_again_and_again_is_given_up(gate: World) -> None:
    dropped = []

    def drop(call: Call) -> None:
        dropped.append(call)
        call.hang_up()

    core = gate.serving(Ends())
    with page(gate) as tab:
        gate.die(core)
        gate.feed.serve(gate.core(2, drop))
        assert tab.closed() == 1013
    assert len(dropped) == 3


def test_a_silent_core_does_not_keep_a_socket_waiting_for_ever(tmp_path: Path) -> None:
    with world(tmp_path, upstream_deadline_ms=100) as gate:
        gate.serving(silent)
        assert gate.ask("GET", "/ws", *HANDSHAKE).status == 504


# -- its end -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("code", [1000, 1008, 4001])
def test_how_a_core_ends_a_socket_is_told_to_its_page(gate: World, code: int) -> None:
    ends = Ends()
    gate.serving(ends)
    with page(gate) as tab:
        ends.wait().close(code)
        assert tab.closed() == code


def test_how_a_page_ends_a_socket_is_told_to_the_core(gate: World) -> None:
    ends = Ends()
    gate.serving(ends)
    with page(gate) as tab:
        tab.close(4002)
        assert ends.wait().closed_with.wait(lambda _: True) == [4002]


def test_a_page_that_vanishes_leaves_nothing_at_the_core(gate: World) -> None:
    ends = Ends()
    gate.serving(ends)
    with page(gate) as tab:
        end = ends.wait()
        tab.vanish()
        assert end.closed_with.wait(lambda _: True) == [1001]
    gate.feed.wait("stats", lambda line: line["websockets"] == 0 and line["connections"] == 0)


def test_a_page_that_vanishes_during_an_outage_is_forgotten(gate: World) -> None:
    core = gate.serving(Ends())
    with page(gate) as tab:
        gate.die(core)
        tab.read_text("R1")
        tab.vanish()
        gate.feed.wait("stats", lambda line: line["websockets"] == 0)
        next_ends = Ends()
        _next_core(gate, next_ends)
        gate.feed.wait("served", lambda line: line["epoch"] == 2)
        assert not next_ends.ends.all()


def test_a_browser_that_answers_no_question_is_gone(tmp_path: Path) -> None:
    with world(tmp_path, socket_ping_ms=100) as gate:
        gate.serving(Ends())
        client = gate.client().ask("GET", "/ws", *HANDSHAKE)
        assert client.read(head=True).status == 101  # and from now on it says nothing
        gate.feed.wait("stats", lambda line: line["websockets"] == 1)
        until(lambda: gate.feed.wait("stats")[-1]["websockets"] == 0, "the silent browser is gone")


def test_a_message_that_is_too_long_ends_its_socket_alone(tmp_path: Path) -> None:
    ends = Ends()
    with world(tmp_path, socket_message_bytes_max=1000) as gate:
        gate.serving(ends)
        with page(gate) as tab, page(gate) as other:
            tab.say("x" * 2000)
            assert tab.closed() == 1009
            other.say("x" * 1000)
            ends.wait(2).heard.wait(lambda said: said == b"x" * 1000)


def test_a_core_that_says_too_much_at_a_time_ends_the_socket(tmp_path: Path) -> None:
    ends = Ends()
    with world(tmp_path, socket_message_bytes_max=1000) as gate:
        gate.serving(ends)
        with page(gate) as tab:
            ends.wait().say("x" * 2000)
            assert tab.closed() == 1009


@pytest.mark.parametrize("bound", [{"socket_unsent_bytes_max": 4096}, {"sockets_bytes_max": 200_000}])
def test_a_page_that_reads_too_slowly_is_ended_and_no_other_waits_for_it(
    tmp_path: Path, bound: dict[str, int]
) -> None:
    ends = Ends()
    with world(tmp_path, **bound) as gate:
        gate.serving(ends)
        client = gate.client().ask("GET", "/ws", *HANDSHAKE)
        assert client.read(head=True).status == 101
        with page(gate) as other:
            first, second = ends.wait(1), ends.wait(2)
            while not first.closed_with.all():  # it never reads
                first.say("x" * 60_000)
            second.say("still here")
            assert other.read() == "still here"


def test_what_pages_leave_unfinished_has_one_bound_for_all_of_them(tmp_path: Path) -> None:
    ends = Ends()
    with world(tmp_path, sockets_bytes_max=100_000) as gate:
        gate.serving(ends)
        with page(gate) as first, page(gate) as second:
            first.say_half(b"x" * 80_000).heard()
            second.say_half(b"x" * 80_000)
            assert second.closed() == 1013
            first.say_other_half(b"y")
            ends.wait(1).heard.wait(lambda said: said == b"x" * 80_000 + b"y")
            first.say_half(b"z" * 80_000).say_other_half(b"")  # there is room again
            ends.wait(1).heard.wait(lambda said: said == b"z" * 80_000)


def test_a_core_that_leaves_too_much_unfinished_ends_the_socket(tmp_path: Path) -> None:
    ends = Ends()
    with world(tmp_path, sockets_bytes_max=100_000) as gate:
        gate.serving(ends)
        with page(gate) as tab:
            ends.wait().say_half(b"x" * 120_000)
            assert tab.closed() == 1013


def test_a_page_that_had_to_wait_for_a_slow_core_is_heard_again_once_that_is_gone(tmp_path: Path) -> None:
    hears, ends = threading.Event(), Ends()
    with world(tmp_path, probe_ms=20, socket_ping_ms=50) as gate:
        gate.serving(Ends(hears=hears))
        with page(gate) as tab:
            said = []

            def talk() -> None:
                for _ in range(300):
                    tab.say("x" * 60_000)
                    said.append(time.monotonic())

            talker = threading.Thread(target=talk, daemon=True)
            talker.start()
            seen = deque([-1], maxlen=40)

            def waits() -> bool:
                seen.append(len(said))
                return len(seen) == 40 and len(set(seen)) == 1

            until(waits, "the page to be left waiting")
            _next_core(gate, ends)
            talker.join(DEADLINE_S)
            assert len(said) == 300
            hears.set()
            ends.wait().say(_account(1))  # what is said before it has joined is let go
            tab.read_until(_ledger)
            tab.say("still here")
            ends.wait().heard.wait(lambda word: word == b"still here")


def test_one_socket_too_many_is_told_so(tmp_path: Path) -> None:
    with world(tmp_path, sockets_max=2) as gate:
        gate.serving(Ends())
        with page(gate), page(gate, "/__hc/live", None), page(gate) as third:
            assert third.closed() == 1013


def test_a_gateway_that_leaves_tells_every_socket(gate: World) -> None:
    gate.serving(Ends())
    with page(gate) as tab, page(gate, "/__hc/live", None) as own:
        gate.terminate()
        assert (tab.closed(), own.closed()) == (1012, 1012)
    assert gate.process is not None
    assert gate.process.wait(20) == 0


def test_sockets_are_counted(gate: World) -> None:
    gate.serving(Ends())
    with page(gate), page(gate, "/__hc/live", None):
        gate.feed.wait("stats", lambda line: line["websockets"] == 2 and line["connections"] == 2)
    gate.feed.wait("stats", lambda line: line["websockets"] == 0 and line["connections"] == 0)
