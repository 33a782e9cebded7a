"""What the guard may do: observe only records, assist waits for a word, and both touch nobody."""

import signal
from pathlib import Path

import pytest

from tests.integration.house import START_S, House
from tests.integration.houses import MakeHouse
from tests.waiting import until

SOON = {"confirm_deadlock_ms": 400, "confirm_hang_ms": 600}


def state_of(pid: int) -> str:
    """The kernel's letter for a process; empty when it is gone."""
    try:
        return Path(f"/proc/{pid}/stat").read_text("ascii").rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return ""


def noticed(house: House, diagnosis: str) -> None:
    """Wait until the guard has an incident with this diagnosis, open or closed."""
    until(
        lambda: any(one["diagnosis"] == diagnosis for one in house.incidents()), "it to be noticed", START_S
    )


def test_observe_does_not_touch_a_frozen_core_nor_replace_a_dead_one(new_house: MakeHouse) -> None:
    house = new_house(**SOON).up("--mode", "observe")
    assert house.status()["mode"] == "observe"
    core = house.hit("core", signal.SIGSTOP)
    noticed(house, "FROZEN")
    assert state_of(core.pid) == "T"
    core.hit(signal.SIGCONT)
    house.until(lambda s: s["phase"] == "RUNNING" and s["incident"] is None, "it to be well again")
    assert house.status()["core"]["pid"] == core.pid
    until(lambda: house.incidents()[0]["outcome"] == "assist", "its story to be told to the end")
    core.hit(signal.SIGKILL)
    told = house.until(lambda s: s["state"] == "MANUAL_INTERVENTION", "a person to be needed")
    assert told["core"]["pid"] is None
    assert house.cli("down").code == 0


@pytest.mark.parametrize("word", ["resume", "restart"])
def test_assist_waits_and_a_persons_word_does_what_act_would_have_done(
    new_house: MakeHouse, word: str
) -> None:
    house = new_house(**SOON, mode="assist").up()
    house.open_accounts()
    assert house.book("before").status == 201
    core = house.hit("core", signal.SIGSTOP)
    told = house.until(lambda s: s["state"] == "MANUAL_INTERVENTION", "a person to be needed")
    assert told["needs_since"] is not None
    assert state_of(core.pid) == "T"
    assert house.cli(word).code == 0
    after = house.running()
    assert after["core"]["pid"] != core.pid
    assert core.gone
    assert house.booked() == ["before"]
