"""`WS /ws` of a core that runs alone: what an open page is told, and whom it tells nothing."""

import contextlib
import json
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect, unix_connect
from websockets.typing import Origin, Subprotocol

from tests.integration.lone_core import Core, ready, started
from tests.waiting import WAIT_S, until

HARDCORE = Subprotocol("hardcore.v1")


@pytest.fixture
def core(tmp_path: Path) -> Iterator[Core]:
    with started(tmp_path / "data") as made:
        ready(made)
        made.open("cash")
        made.open("food", "expense")
        yield made


@contextmanager
def page(core: Core, after: int | None = None, **more: Any) -> Iterator[ClientConnection]:
    query = "" if after is None else f"?after={after}"
    options = {"subprotocols": [HARDCORE], "compression": None, "open_timeout": WAIT_S, **more}
    with connect(f"ws://127.0.0.1:{core.port}/ws{query}", **options) as opened:
        yield opened


def heard(opened: ClientConnection) -> dict[str, Any]:
    told: dict[str, Any] = json.loads(opened.recv(timeout=WAIT_S))
    assert told["v"] == 1
    return told


def hear_seqs(opened: ClientConnection, last: int) -> list[int]:
    seqs = [heard(opened)["seq"]]
    while seqs[-1] < last:
        seqs.append(heard(opened)["seq"])
    return seqs


def refusal(core: Core, query: str = "", **more: Any) -> tuple[int, str]:
    options = {"subprotocols": [HARDCORE], "compression": None, **more}
    with (
        pytest.raises(InvalidStatus) as refused,
        connect(f"ws://127.0.0.1:{core.port}/ws{query}", **options),
    ):
        pass
    response = refused.value.response
    return response.status_code, json.loads(response.body or b"{}")["type"]


def test_a_page_hears_of_a_booking_the_moment_it_is_committed(core: Core) -> None:
    with page(core) as opened:
        assert opened.subprotocol == HARDCORE
        assert opened.response is not None
        assert opened.response.headers["X-Core-Epoch"] == "1"
        assert heard(opened) == {"v": 1, "type": "ledger.hello", "seq": 2, "epoch": 1}
        booked = core.move(5, "food", "cash").body
        assert heard(opened) == {
            "v": 1,
            "type": "ledger.transaction",
            "seq": 3,
            "id": booked["id"],
            "date": "2026-11-21",
            "description": "moved",
            "accounts": ["food", "cash"],
        }
        core.open("bank")
        assert heard(opened) == {"v": 1, "type": "ledger.account", "seq": 4, "id": "bank"}


def test_who_comes_back_hears_what_was_missed_once_and_in_order(core: Core) -> None:
    for _ in range(5):
        core.move(1, "food", "cash")
    with page(core, after=3) as opened:
        assert heard(opened)["seq"] == 3
        core.move(1, "food", "cash")
        assert hear_seqs(opened, 8) == [4, 5, 6, 7, 8]


def test_nothing_falls_between_what_was_missed_and_what_happens_now(core: Core) -> None:
    for _ in range(20):
        before = core.ask("GET", "/healthz").body["seq"]
        with page(core, after=2) as opened:
            core.move(1, "food", "cash")
            assert heard(opened)["seq"] == 2
            assert hear_seqs(opened, before + 1) == list(range(3, before + 2))


def test_who_saw_more_than_there_is_reads_anew(core: Core) -> None:
    with page(core, after=1_000_000) as opened:
        assert heard(opened)["type"] == "ledger.hello"
        assert heard(opened) == {"v": 1, "type": "ledger.resync", "seq": 2}


def test_the_next_life_goes_on_where_the_page_left_off(tmp_path: Path) -> None:
    data = tmp_path / "data"
    with started(data) as core:
        ready(core).open("cash")
        core.open("food", "expense")
        with page(core) as opened:
            assert heard(opened)["seq"] == 2
            core.move(1, "food", "cash")
            assert heard(opened)["seq"] == 3
    with started(data) as core:
        ready(core).move(2, "food", "cash")
        with page(core, after=3) as opened:
            assert heard(opened) == {"v": 1, "type": "ledger.hello", "seq": 3, "epoch": 2}
            assert heard(opened)["seq"] == 4


def test_a_core_that_leaves_says_that_it_is_a_restart(core: Core) -> None:
    with page(core) as opened:
        heard(opened)
        core.process.terminate()
        with pytest.raises(ConnectionClosed):
            opened.recv(timeout=WAIT_S)
        assert opened.close_code == 1012
    assert core.ends_with() == 0


def test_a_page_of_another_site_is_refused_before_anything_is_told(core: Core) -> None:
    own = f"127.0.0.1:{core.port}"
    for origin in ("http://evil.example", "http://localhost:1", f"https://{own}", "null"):
        assert refusal(core, origin=Origin(origin)) == (403, "/problems/foreign-page")
    # A name that somebody made to point to loopback is a stranger's, however well it agrees with itself.
    with socket.create_connection(("127.0.0.1", core.port)) as raw, pytest.raises(InvalidStatus) as refused:
        connect(
            f"ws://rebound.example:{core.port}/ws",
            sock=raw,
            origin=Origin(f"http://rebound.example:{core.port}"),
            subprotocols=[HARDCORE],
        ).__enter__()
    assert refused.value.response.status_code == 403
    with page(core, origin=Origin(f"http://{own}")) as opened:
        assert heard(opened)["type"] == "ledger.hello"


def test_who_offers_another_language_is_told_which_one_is_spoken(core: Core) -> None:
    assert refusal(core, subprotocols=None) == (400, "/problems/subprotocol-unknown")
    assert refusal(core, subprotocols=[Subprotocol("chat")]) == (400, "/problems/subprotocol-unknown")


@pytest.mark.parametrize("after", ["-1", "x", "1e3", "9" * 30, "١"])
def test_an_after_that_is_no_sequence_is_refused(core: Core, after: str) -> None:
    assert refusal(core, f"?after={after}") == (400, "/problems/invalid-parameter")


def test_who_says_too_much_is_closed_and_the_rest_is_not_disturbed(core: Core) -> None:
    with page(core) as loud, page(core) as quiet:
        heard(quiet)
        loud.send("x" * 100_000)
        assert heard(loud)["type"] == "ledger.hello"
        with pytest.raises(ConnectionClosed):
            loud.recv(timeout=WAIT_S)
        assert loud.close_code == 1009
        core.move(1, "food", "cash")
        assert heard(quiet)["seq"] == 3
    assert "Traceback" not in core.said()


def test_who_takes_nothing_is_closed_and_nobody_waits(core: Core) -> None:
    raw = socket.create_connection(("127.0.0.1", core.port))
    raw.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    lines = (
        "GET /ws HTTP/1.1",
        f"Host: 127.0.0.1:{core.port}",
        "Connection: Upgrade",
        "Upgrade: websocket",
        "Sec-WebSocket-Version: 13",
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
        "Sec-WebSocket-Protocol: hardcore.v1",
    )
    with raw:
        raw.sendall(("\r\n".join(lines) + "\r\n\r\n").encode())
        assert raw.recv(12) == b"HTTP/1.1 101"
        body = {
            "date": "2026-11-21",
            "description": "\N{GRINNING FACE}" * 2_000,
            "postings": [
                {"account": "food", "amount": "1", "currency": "KRW"},
                {"account": "cash", "amount": "-1", "currency": "KRW"},
            ],
        }
        before = sockets_of(core)

        def its_seat_is_lost() -> bool:
            assert core.ask("POST", "/api/ledger/transactions", body).status == 201
            return sockets_of(core) < before

        until(its_seat_is_lost, "the slow reader to lose its seat", 3 * WAIT_S)
    with page(core) as opened:
        assert heard(opened)["type"] == "ledger.hello"


def sockets_of(core: Core) -> int:
    """How many sockets the core holds."""
    names = []
    for entry in Path(f"/proc/{core.process.pid}/fd").iterdir():
        with contextlib.suppress(FileNotFoundError):  # closed while we look
            names.append(entry.readlink().name)
    return sum(name.startswith("socket:") for name in names)


def test_it_speaks_on_the_socket_of_its_life_as_well(tmp_path: Path) -> None:
    path = tmp_path / "core.sock"
    with started(tmp_path / "data", sock=path) as core:
        ready(core)
        # The gateway before it has judged the origin.
        with unix_connect(
            str(path),
            "ws://core/ws",
            subprotocols=[HARDCORE],
            origin=Origin("http://anything.example"),
            compression=None,
        ) as opened:
            assert heard(opened) == {"v": 1, "type": "ledger.hello", "seq": 0, "epoch": 1}
