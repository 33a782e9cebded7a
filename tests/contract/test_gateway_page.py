"""The gateway's own page, written by a real gateway and read by the guard's own reader (wires section 18)."""

import hashlib
import json
import os
import struct
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from hardcore.host.gateway_page import FILE_BYTES, SLOTS, GatewayPageReader, decode, last_of, make_page
from hardcore.host.processes import start_of
from hardcore.model.gateway import GatewayPage, GatewayPulse, GatewayRequest, Stage
from tests.contract.gateway_world import World, silent, world
from tests.waiting import until


def named(method: str, path: str) -> str:
    return hashlib.sha256(f"{method} {path}".encode()).digest()[:8].hex()


def page_of(folder: Path) -> GatewayPage:
    found = decode((folder / "page").read_bytes())
    assert found is not None
    return found


def stands(folder: Path, stage: Stage, path: str, method: str = "GET") -> GatewayRequest:
    """Wait until a request stands there."""

    def look() -> GatewayRequest | None:
        name = named(method, path)
        requests = page_of(folder).requests
        return next((one for one in requests if (one.stage, one.path_hash) == (stage, name)), None)

    found = until(look, f"{method} {path} to be {stage.name}")
    assert found is not None
    return found


def pulse(folder: Path, holds: Callable[[GatewayPulse], object], what: str) -> None:
    until(lambda: holds(page_of(folder).pulse), what)


@pytest.fixture
def made(tmp_path: Path) -> Path:
    """A folder with a new page in it."""
    make_page(tmp_path / "page")
    return tmp_path


def options(folder: Path) -> tuple[str, ...]:
    return ("--page", str(folder / "page"), "--state", str(folder))


def test_a_gateway_says_who_it_is_and_beats_on_its_loop_and_beside_it(made: Path) -> None:
    with world(made, *options(made)) as w:
        w.serving()
        assert w.process is not None
        start = start_of(w.process.pid)
        assert start is not None
        reader = GatewayPageReader(made / "page")
        first = reader.pulse(w.process.pid, start)
        assert first is not None
        assert first.loop_thread == w.process.pid
        pulse(
            made,
            lambda now: now.loop_count > first.loop_count and now.thread_ns > first.thread_ns,
            "both beats",
        )
        assert reader.pulse(w.process.pid, start + 1) is None, "a page of another process is no evidence"
        reader.close()


def test_a_request_has_a_place_from_its_first_byte_to_its_end(made: Path) -> None:
    with world(made, *options(made)) as w:
        core = w.serving(silent)
        half = w.client().send(b"GET /half?secret=1 HTTP/1.1\r\nHost: loc")
        read = stands(made, Stage.PARSING, "/half")
        assert read.bytes_read == len(b"GET /half?secret=1 HTTP/1.1\r\nHost: loc")
        asked = w.client().ask("POST", "/asked", body=b"x")
        core.wait("/asked")
        assert stands(made, Stage.FORWARDED, "/asked", "POST").connection != read.connection
        w.die(core)
        waiting = w.client().ask("GET", "/waits")
        stands(made, Stage.HELD, "/waits")
        half.send(b"alhost\r\n\r\n")
        stands(made, Stage.HELD, "/half")
        for client in (half, waiting, asked):
            client.close()
        pulse(made, lambda now: now.begun == now.over >= 3, "all of them to be over")
        until(lambda: page_of(made).requests == (), "no place to be taken")


def test_more_requests_than_places_are_all_served(made: Path) -> None:
    with world(made, *options(made), connections_per_address_max=1000) as w:
        w.serving()
        halves = [w.client().send(b"GET /many HTTP/1.1\r\nHost: localhost\r\n") for _ in range(SLOTS + 20)]
        until(lambda: len(page_of(made).requests) == SLOTS, "all places to be taken")
        assert [half.send(b"\r\n").read().status for half in halves] == [200] * len(halves)
        until(lambda: page_of(made).requests == (), "all places to be free")


def refusing(folder: Path, path: str, left: timedelta) -> None:
    told = {"hash": named("POST", path), "until": (datetime.now(UTC) + left).isoformat()}
    (folder / "refused_paths.json").write_text(json.dumps({"version": 1, "refused": [told]}))


def test_a_refused_path_is_refused_before_its_body_and_whatever_follows_it(made: Path) -> None:
    refusing(made, "/poison", timedelta(minutes=5))
    with world(made, *options(made)) as w:
        core = w.serving()
        head = b"POST /poison?a=1 HTTP/1.1\r\nHost: localhost\r\nContent-Length: 100000\r\n"
        assert w.client().send(head).read().status == 400  # not even its head was whole
        by_bytes = w.client()
        for byte in b"POST /poison HTTP/1.1\r\nHost: localhost\r\nContent-Length: 5\r\n\r\n":
            by_bytes.send(bytes([byte]))
        answer = by_bytes.read()
        assert (answer.status, answer.json()["type"]) == (400, "/problems/refused-path")
        assert w.ask("GET", "/poison").status == 200
        assert w.ask("POST", "/poisonous", body=b"x").status == 200
        assert "/poison?a=1" not in core.targets()
        pulse(made, lambda now: now.refused == 2, "the refusals to be counted")


@pytest.mark.parametrize("told", ["", "{", '{"refused": [{"hash": "zz", "until": "never"}]}'])
def test_a_list_that_makes_no_sense_refuses_nobody(made: Path, told: str) -> None:
    (made / "refused_paths.json").write_text(told)
    with world(made, *options(made)) as w:
        w.serving()
        assert w.ask("POST", "/poison", body=b"x").status == 200


def test_a_refusal_that_is_over_refuses_nobody(made: Path) -> None:
    refusing(made, "/poison", timedelta(seconds=-1))
    with world(made, *options(made)) as w:
        w.serving()
        assert w.ask("POST", "/poison", body=b"x").status == 200


def test_a_core_that_does_not_answer_in_time_is_told_of_and_counted(made: Path) -> None:
    with world(made, *options(made), upstream_deadline_ms=300) as w:
        w.serving(silent)
        assert w.ask("GET", "/slow").status == 504
        (line,) = w.feed.wait("overdue")
        assert (line["path"], line["epoch"]) == ("/slow", 1)
        assert line["age_ms"] >= 299  # whole milliseconds
        pulse(made, lambda now: now.overdue == 1 and now.overdue_ns > 0, "it to be counted")


def without_a_page(w: World) -> None:
    w.serving()
    assert w.ask("GET", "/x").status == 200


def test_a_gateway_whose_page_is_missing_or_another_ones_serves_all_the_same(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    with world(tmp_path / "a", "--page", str(tmp_path / "a" / "page")) as w:
        without_a_page(w)
    make_page(tmp_path / "page")
    with (tmp_path / "page").open("r+b") as file:
        file.seek(32)
        file.write(struct.pack("=Q", os.getpid()))
    before = (tmp_path / "page").read_bytes()
    with world(tmp_path, "--page", str(tmp_path / "page")) as w:
        without_a_page(w)
    assert (tmp_path / "page").read_bytes() == before


def test_a_new_page_leaves_the_one_before_beside_it(made: Path) -> None:
    (made / "page").write_bytes(b"the one before")
    make_page(made / "page")
    assert last_of(made / "page").read_bytes() == b"the one before"
    assert len((made / "page").read_bytes()) == FILE_BYTES
    assert (made / "page").stat().st_mode & 0o777 == 0o600


@pytest.mark.parametrize("data", [b"", b"x" * FILE_BYTES, b"HCGATE01", os.urandom(FILE_BYTES + 1)])
def test_whatever_lies_in_the_pages_place_is_no_evidence_and_no_harm(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "page").write_bytes(data)
    reader = GatewayPageReader(tmp_path / "page")
    assert reader.pulse(1, 1) is None
    reader.close()
    assert decode(data) is None
    os.mkfifo(tmp_path / "fifo")
    strange = GatewayPageReader(tmp_path / "fifo")
    assert (strange.pulse(1, 1), strange.raw()) == (None, b"")
