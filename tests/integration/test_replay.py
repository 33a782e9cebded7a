"""The recording of a real incident, asked again."""

import json
import signal
from pathlib import Path

import pytest

from hardcore.replay import Replayed, replay, replay_incident
from hardcore.snapshot.writer import RECORDING
from postmortem import bundle
from tests.integration.conftest import MakeHouse
from tests.integration.house import START_S, House
from tests.waiting import until


def recorded(house: House) -> Path:
    """The folder of the newest incident, with the recording that was written at its closing."""
    incident: str = house.closed(1)["id"]
    folder = house.folders.incidents / incident

    def closed() -> bool:
        data = bundle.read_file(folder, RECORDING)
        return isinstance(data, bytes) and b'"CloseIncident"' in data

    until(closed, "the whole recording", START_S)
    return folder


@pytest.mark.parametrize("how", [signal.SIGSEGV, signal.SIGSTOP])
def test_the_facts_of_a_real_incident_give_the_same_orders_again(new_house: MakeHouse, how: int) -> None:
    house = new_house().up()
    house.open_accounts()
    house.book("a wish that nobody may read in a recording")
    house.hit("core", how)
    folder = recorded(house)
    told = replay_incident(folder)
    assert isinstance(told, Replayed), told
    assert told.same, told.first_difference
    assert told.facts > 10
    assert told.orders > 3
    until(
        lambda: not bundle.verify_bundle(folder), "the box to be whole: the report is still being put into it"
    )
    text = (folder / RECORDING).read_text()
    assert "a wish that nobody may read" not in text


def test_a_changed_order_in_a_real_recording_is_named(new_house: MakeHouse) -> None:
    house = new_house().up()
    house.hit("core")
    lines = (recorded(house) / RECORDING).read_bytes().splitlines(keepends=True)
    number = max(n for n, line in enumerate(lines) if b'"Release"' in line)
    line = json.loads(lines[number])
    line["orders"] = []
    lines[number] = json.dumps(line).encode() + b"\n"
    told = replay(b"".join(lines))
    assert isinstance(told, Replayed)
    assert not told.same
    assert told.first_difference is not None
    assert told.first_difference.line == number + 1
    assert "Release" in told.first_difference.given
