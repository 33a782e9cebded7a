"""Open pages over one death after another: each hears every booking once and in order, and none is let go."""

import asyncio
import json
import threading
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from typing import Any, Final

from websockets.asyncio.client import ClientConnection as AsyncConnection
from websockets.asyncio.client import connect as connect_async
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from tests.integration.clients import assert_exactly_once, at_work, in_ledger
from tests.integration.conftest import MakeHouse
from tests.integration.house import ANSWER_S, POLICY, House
from tests.waiting import until

HARDCORE: Final = Subprotocol("hardcore.v1")
TABS: Final = 6
DEATHS: Final = 5
MANY: Final = 600
PLACES: Final = 512  # `sockets_max` here: the default is more than a test should open


@dataclass
class Tab:
    """What one page's socket has heard of the ledger."""

    connection: ClientConnection
    booked: list[str] = field(default_factory=list)
    seqs: list[int] = field(default_factory=list)
    code: int | None = None

    def read(self) -> None:
        """Read to the end."""
        try:
            for text in self.connection:
                frame: dict[str, Any] = json.loads(text)
                if frame["type"] == "ledger.transaction":
                    self.booked.append(frame["description"])
                    self.seqs.append(frame["seq"])
        except ConnectionClosed:
            pass
        self.code = self.connection.close_code


@contextmanager
def open_tabs(house: House, count: int) -> Iterator[list[Tab]]:
    url = house.url.replace("http://", "ws://") + "/ws"
    with ExitStack() as opened:
        tabs = [
            Tab(
                opened.enter_context(
                    connect(
                        url,
                        subprotocols=[HARDCORE],
                        compression=None,
                        open_timeout=ANSWER_S,
                        ping_interval=None,
                    )
                )
            )
            for _ in range(count)
        ]
        readers = [threading.Thread(target=tab.read, daemon=True) for tab in tabs]
        for reader in readers:
            reader.start()
        yield tabs
    for reader in readers:
        reader.join(ANSWER_S)


def test_open_pages_hear_every_booking_once_and_in_order_over_five_deaths(house: House) -> None:
    with open_tabs(house, TABS) as tabs:
        with at_work(house, 3, "deaths") as clients:
            for _ in range(DEATHS):
                heard = len(tabs[0].booked)
                until(lambda: len(tabs[0].booked) > heard + 5, "bookings to be heard")  # noqa: B023
                house.hit("core")
                house.running()
        assert_exactly_once(house, clients)
        wanted = in_ledger(house, "deaths")
        assert len(wanted) > DEATHS
        for tab in tabs:
            until(lambda: len(tab.booked) >= len(wanted) or tab.code, "everything to be heard")  # noqa: B023
            assert tab.code is None
            assert Counter(tab.booked) == wanted
            assert tab.seqs == sorted(set(tab.seqs))


def test_six_hundred_sockets_at_once_go_on_over_a_death_and_those_too_many_are_told_so(
    new_house: MakeHouse,
) -> None:
    house = new_house(gateway={**POLICY["gateway"], "sockets_max": PLACES}).up()
    house.open_accounts()
    gateway = house.status()["gateway"]["pid"]
    asyncio.run(_crowd(house))
    assert house.running()["gateway"]["pid"] == gateway
    house.until(lambda status: status["gateway"]["websockets"] == 0, "all places to be free again")


async def _crowd(house: House) -> None:
    url = house.url.replace("http://", "ws://") + "/ws"

    async def come() -> AsyncConnection:
        return await connect_async(
            url, subprotocols=[HARDCORE], compression=None, open_timeout=None, ping_interval=None
        )

    async def hears(one: AsyncConnection, description: str) -> None:
        while json.loads(await one.recv()).get("description") != description:
            pass

    async def stays(one: AsyncConnection) -> bool:
        """Whether it has a place: it is told of the ledger, or closed."""
        try:
            await one.recv()
        except ConnectionClosed:
            assert one.close_code == 1013
            return False
        return True

    async with asyncio.timeout(4 * ANSWER_S):
        crowd = await asyncio.gather(*(come() for _ in range(MANY)))
        stay = await asyncio.gather(*(stays(one) for one in crowd))
        assert stay.count(True) == PLACES
        placed = [one for one, has_place in zip(crowd, stay, strict=True) if has_place]
        await asyncio.to_thread(house.book, "before")
        await asyncio.gather(*(hears(one, "before") for one in placed))
        house.hit("core")
        await asyncio.to_thread(house.book, "after")
        await asyncio.gather(*(hears(one, "after") for one in placed))
        await asyncio.gather(*(one.close() for one in placed))
