"""Proof B behind the serving: the core that serves says whether all of the ledger is whole, and everybody hears it."""

import json
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tests import stores
from tests.integration.conftest import MakeHouse
from tests.integration.house import START_S, House
from tests.waiting import until


def verified(house: House, epoch: int) -> dict[str, Any]:
    """What the feed says of the whole ledger under this epoch, to somebody who begins to listen now."""
    for line in _feed(house.folders.control):
        if line["type"] == "verified" and line["epoch"] == epoch:
            return line
    raise AssertionError("the feed ended")


def _feed(path: Path) -> Iterator[dict[str, Any]]:
    with socket.socket(socket.AF_UNIX) as feed:
        feed.settimeout(START_S)
        feed.connect(str(path))
        feed.sendall(b'{"verb": "subscribe", "who": "test"}\n')
        with feed.makefile("rb") as lines:
            for line in lines:
                yield json.loads(line)


def change_an_old_line(house: House) -> None:
    """Change one old booking line as somebody with a database tool would."""
    stores.tamper(house.data, "UPDATE posting SET amount = amount + 1 WHERE seq = 4 AND line = 0")


def test_a_ledger_that_is_not_whole_is_read_only_and_told_to_everybody(new_house: MakeHouse) -> None:
    house = new_house().up()
    house.open_accounts()
    for number in range(5):
        assert house.book(f"booked-{number}").status == 201
    whole = verified(house, house.status()["core"]["epoch"])
    assert whole["ok"] is True
    told = house.until(lambda s: s["ledger_verified_at"], "the proof to be in the status")
    assert told["state"] == "OPERATIONAL"

    change_an_old_line(house)
    house.hit("core")
    told = house.until(lambda s: s["safe"], "reads only to be served")
    assert (told["state"], told["safe"]) == ("MANUAL_INTERVENTION", "STORE_CORRUPT")
    assert told["waits_for"] == "STORE_CORRUPT"
    # The proof before serving has met it: the next core never began to write, so it is the same outage.
    story = house.closed(1)
    assert (story["diagnosis"], story["outcome"]) == ("KILLED_FROM_OUTSIDE", "safe_mode")
    assert "STORE_CORRUPT" in story["summary"], "what keeps it from writing is in the first sentence"
    broken = verified(house, house.status()["core"]["epoch"])
    assert (broken["ok"], broken["seq"]) == (False, None)
    assert verified(house, broken["epoch"]) == broken, "whoever comes later hears it too"
    told = house.status()
    assert "what is listed for event 4 is not what the event says" in told["worries"][0]
    assert house.book("not-on-top-of-it").status == 503
    assert "not-on-top-of-it" not in house.booked()

    def money() -> bool:
        return any(item["money"]["verified"] is False for item in house.incidents())

    house.until(lambda _: money(), "the incident to claim nothing about the money")


def test_a_ledger_that_is_not_whole_is_told_by_the_next_guard_too(new_house: MakeHouse) -> None:
    house = new_house().up()
    house.open_accounts()
    for number in range(5):
        assert house.book(f"booked-{number}").status == 201
    change_an_old_line(house)
    house.hit("core")
    before = house.until(lambda s: s["safe"] and s["worries"], "reads only to be served, and why")
    house.closed(1)
    assert verified(house, before["core"]["epoch"])["ok"] is False

    guard = house.hit("sentinel")
    until(lambda: guard.gone, "the guard to be gone")
    old = before["sentinel"]["pid"]
    told = house.until(
        lambda s: s["sentinel"]["pid"] != old and s["safe"] and s["worries"], "the next guard to show it"
    )
    assert told["worries"][0] == before["worries"][0]
    assert verified(house, told["core"]["epoch"])["ok"] is False
