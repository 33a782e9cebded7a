"""The guard itself dies: gateway, sentinel, launcher, one alone or all together. The ledger loses nothing."""

import os
import shutil
import signal
from pathlib import Path

import pytest

from tests.integration.clients import assert_exactly_once, at_work
from tests.integration.conftest import MakeHouse
from tests.integration.house import START_S, House
from tests.waiting import until


def one_of_each(house: House) -> None:
    """There is one core; and one sentinel and one gateway, once an older gateway has answered what it held."""

    def count(mark: str) -> int:
        return sum(mark in line for line in house.processes().values())

    assert count("-m core serve") == 1, house.processes()
    until(lambda: count("hardcore.crisis") == 1 == count("hardcore.runtime"), "one gateway and one sentinel")


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGSEGV])
def test_a_gateway_that_dies_comes_back_on_its_port_and_the_core_stays(
    house: House, number: signal.Signals
) -> None:
    before, count = house.status(), len(house.incidents())
    with at_work(house, 3, f"gateway-{number}") as clients:
        until(lambda: len(clients.told) > 20, "the load to run")
        old = house.hit("gateway", number)
        until(lambda: old.gone, "the gateway to be gone")
        after = house.until(lambda s: s["gateway"]["pid"] not in {None, old.pid}, "another gateway")
        told = len(clients.told)
        until(lambda: len(clients.told) > told + 20, "answers through the new gateway")
    assert {told.status for told in clients.told} == {201}
    assert_exactly_once(house, clients)
    assert after["core"]["pid"] == before["core"]["pid"]
    assert house.running()["url"] == before["url"]
    assert house.closed(count + 1)["diagnosis"] == "GATEWAY_LOST"
    one_of_each(house)


@pytest.mark.parametrize("moment", ["killed", "spawned", "proving"])
def test_a_sentinel_that_dies_in_the_middle_of_a_recovery_is_continued_to_one_core(
    house: House, moment: str
) -> None:
    epoch = house.status()["core"]["epoch"]
    sentinel = house.hold("sentinel")
    with at_work(house, 2, f"middle-{moment}") as clients:
        house.hit("core")
        if moment == "spawned":
            house.until(lambda s: s["phase"] == "STARTING", "the next core to start")
        if moment == "proving":
            house.until(lambda s: s["phase"] in {"PROVING", "PROBATION"}, "the next core to prove")
        sentinel.hit(signal.SIGKILL)
        house.until(lambda s: s["sentinel"]["pid"] != sentinel.pid, "another sentinel")
        house.running()
        told = len(clients.told)
        until(lambda: len(clients.told) > told + 20, "answers")
    assert {told.status for told in clients.told} == {201}
    assert_exactly_once(house, clients)
    assert house.status()["core"]["epoch"] > epoch
    one_of_each(house)


def test_without_a_launcher_the_rest_goes_on_and_the_next_up_attaches(new_house: MakeHouse) -> None:
    house = new_house().up()
    house.open_accounts()
    before = house.status()
    assert house.launcher is not None
    house.launcher.kill()
    house.launcher.wait(START_S)
    assert house.book("without-a-launcher").status == 201

    second = house.begin()
    until(lambda: house.url in house.said, "the second `up` to attach")
    assert house.status()["core"]["pid"] == before["core"]["pid"]
    until(lambda: any("launcher.py" in line for line in house.processes().values()), "the launcher")
    second.send_signal(signal.SIGINT)
    assert second.wait(START_S) == 0
    until(lambda: not house.processes(), "everything to be stopped")


def test_a_guard_whose_launcher_is_gone_is_stopped_by_down(new_house: MakeHouse) -> None:
    house = new_house().up()
    assert house.launcher is not None
    house.launcher.kill()
    house.launcher.wait(START_S)
    assert house.cli("down").code == 0
    until(lambda: not house.processes(), "everything to be stopped")


def test_down_ends_a_core_and_a_gateway_that_nobody_watches(new_house: MakeHouse) -> None:
    house = new_house().up()
    sentinel = house.hold("sentinel")
    assert house.launcher is not None
    house.launcher.kill()
    sentinel.hit(signal.SIGKILL)
    house.launcher.wait(START_S)
    until(lambda: sentinel.gone, "the sentinel to be gone")
    assert house.cli("down").code == 0
    until(lambda: not house.processes(), "everything to be stopped")


def test_up_after_launcher_and_sentinel_are_gone_goes_on_with_core_and_gateway_at_their_address(
    new_house: MakeHouse,
) -> None:
    house = new_house(actions={"SENTINEL_LOST": ["SEND_ALERT"]}).up()  # no agent brings another meanwhile
    house.open_accounts()
    assert house.book("before").status == 201
    core, gateway, sentinel = (house.hold(who) for who in ("core", "gateway", "sentinel"))
    assert house.launcher is not None
    house.launcher.kill()
    sentinel.hit(signal.SIGKILL)
    house.launcher.wait(START_S)
    address = house.url
    house.up()
    status = house.status()
    assert (house.url, status["core"]["pid"], status["gateway"]["pid"]) == (address, core.pid, gateway.pid)
    story = house.closed(1)
    assert (story["diagnosis"], story["outage_ms"]) == ("SENTINEL_LOST", None)
    assert house.booked() == ["before"]
    one_of_each(house)
    assert house.launcher is not None
    house.launcher.send_signal(signal.SIGINT)
    house.up()
    assert core.gone
    assert house.status()["last_incident"] == story["id"], "it is known after a restart of the guard too"
    one_of_each(house)


def test_up_after_all_were_killed_at_once_has_lost_nothing(new_house: MakeHouse) -> None:
    house = new_house().up()
    house.open_accounts()
    with at_work(house, 2, "all-killed", patient=False) as clients:
        until(lambda: len(clients.told) > 20, "the load to run")
        for pid in house.processes():
            os.kill(pid, signal.SIGKILL)
        clients.stop.set()
    until(lambda: not house.processes(), "all of them to be gone")
    house.up()
    assert_exactly_once(house, clients)
    assert house.ask("GET", "/api/ledger/verify").body["ok"]
    one_of_each(house)


def test_up_after_a_reboot_has_lost_nothing(new_house: MakeHouse) -> None:
    house = new_house().up()
    house.open_accounts()
    assert house.book("before-the-reboot").status == 201
    for pid in house.processes():
        os.kill(pid, signal.SIGKILL)
    until(lambda: not house.processes(), "all of them to be gone")
    shutil.rmtree(house.folders.run)  # what a reboot does to a tmpfs
    house.up()
    assert house.booked() == ["before-the-reboot"]
    assert house.status()["budget"]["used"] == 0


def test_an_orphans_exit_status_is_kept_by_the_launcher_and_read_by_the_next_guard(house: House) -> None:
    count = len(house.incidents())
    core, sentinel = house.hold("core"), house.hit("sentinel")
    house.until(lambda s: s["sentinel"]["pid"] not in {None, sentinel.pid}, "another sentinel")
    house.running()
    core.hit(signal.SIGKILL)
    until(lambda: Path(house.folders.exits / str(core.pid)).exists(), "the exit status of the old core")
    assert house.closed(count + 2)["core"]["exit"] == {"code": None, "signal": signal.SIGKILL}
