"""What open pages are told while a real house is hit: what happened, for as long as it did, and nothing else."""

import contextlib
import json
import math
import signal
import threading
from collections.abc import Iterator
from typing import Any

from websockets.exceptions import WebSocketException
from websockets.sync.client import connect

from tests.contract.gateway_world import Watched
from tests.integration.house import House
from tests.waiting import WAIT_S


class Tab:
    """A page that stays open: its own socket, opened again whenever it is lost."""

    def __init__(self, house: House) -> None:
        self._url = house.url.replace("http", "ws", 1) + "/__hc/live"
        self._closing = threading.Event()
        self.heard = Watched()
        self._thread = threading.Thread(target=self._stay, daemon=True)
        self._thread.start()

    def _stay(self) -> None:
        while not self._closing.is_set():
            with contextlib.suppress(OSError, EOFError, WebSocketException), self._open() as line:
                while not self._closing.is_set():
                    with contextlib.suppress(TimeoutError):
                        self.heard.append(json.loads(line.recv(0.1)))

    def _open(self) -> Any:
        return connect(self._url, compression=None, open_timeout=WAIT_S, ping_interval=None, proxy=None)

    def of(self, kind: str) -> list[dict[str, Any]]:
        return [frame for frame in self.heard.all() if frame["type"] == kind]

    def close(self) -> None:
        self._closing.set()
        self._thread.join(WAIT_S)


@contextlib.contextmanager
def tabs(house: House, count: int) -> Iterator[list[Tab]]:
    opened = [Tab(house) for _ in range(count)]
    try:
        for tab in opened:
            tab.heard.wait(lambda frame: frame["type"] == "state")
        yield opened
    finally:
        for tab in opened:
            tab.close()


def test_a_gateways_death_is_told_to_nobody_as_an_outage_of_the_core(house: House) -> None:
    with tabs(house, 4) as opened:
        for times in (2, 3, 4):
            house.hit("gateway")
            for tab in opened:  # over the next gateway's socket it is told how things stand, once
                tab.heard.wait(lambda frame: frame["type"] == "state", count=times)
            house.running()
        for tab in opened:
            assert {frame["text"] for frame in tab.of("state")} == {None}
            assert {frame["phase"] for frame in tab.of("state")} == {"RUNNING"}
            assert not tab.of("back")


def test_an_outage_is_told_from_its_fault_on_as_the_incident_has_it(house: House) -> None:
    count = len(house.incidents())
    with tabs(house, 1) as (tab,):
        house.hit("core", signal.SIGSTOP)
        (back,) = tab.heard.wait(lambda frame: frame["type"] == "back")
    story = house.closed(count + 1)
    # Counted from its detection it would be at most the difference of the two.
    assert story["outage_ms"] - story["detected_ms"] < back["outage_ms"] <= math.ceil(story["outage_ms"])


def test_a_cores_death_is_told_once_the_gateway_or_the_guard_knows_it(house: House) -> None:
    with tabs(house, 2) as opened:
        house.hit("core")
        for tab in opened:
            (back,) = tab.heard.wait(lambda frame: frame["type"] == "back")
            first = next(frame for frame in tab.of("state") if frame["text"] is not None)
            assert (first["text"], first["state"]) == ("R1", "RECOVERY")
            assert back["outage_ms"] >= first["elapsed_ms"]
