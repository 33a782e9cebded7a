"""A switch that was asked for: nobody's request fails, each is done once, and the old core leaves by itself."""

import signal

from tests.integration.clients import assert_exactly_once, at_work
from tests.integration.conftest import MakeHouse
from tests.integration.house import WITH_SPARE
from tests.waiting import until


def test_a_restart_is_a_switch_that_fails_no_request(new_house: MakeHouse) -> None:
    house = new_house(**WITH_SPARE).up()
    before = house.spared()
    house.open_accounts()
    old = house.hold("core")
    with at_work(house, 3, "switch", patient=False) as clients:
        until(lambda: len(clients.told) > 20, "the load to run")
        done = house.cli("--json", "restart", "--reason", "a new version")
        told = len(clients.told)
        until(lambda: len(clients.told) > told + 20, "answers of the next core")
    assert done.code == 0, done
    assert {told.status for told in clients.told} == {201}, clients.told
    assert_exactly_once(house, clients)
    after = house.spared()
    assert (after["core"]["pid"], after["core"]["epoch"]) == (
        before["spare"]["pid"],
        before["core"]["epoch"] + 1,
    )
    assert after["budget"]["used"] == before["budget"]["used"]
    until(lambda: old.gone, "the old core to have left")
    story = house.closed(1)
    assert (story["planned"], story["outcome"], story["diagnosis"]) == (True, "recovered", "OPERATOR")


def test_a_restart_right_after_a_start_waits_for_its_spare(new_house: MakeHouse) -> None:
    house = new_house(**WITH_SPARE).up()
    before = house.running()
    done = house.cli("--json", "restart")
    assert done.code == 0, done
    after = house.running()
    assert after["core"]["pid"] != before["core"]["pid"]
    assert after["core"]["epoch"] == before["core"]["epoch"] + 1


def test_a_stop_in_the_middle_of_a_switch_ends_all_of_them(new_house: MakeHouse) -> None:
    house = new_house(**WITH_SPARE).up()
    house.spared()
    house.order("restart")
    house.order("down")
    assert house.launcher is not None
    assert house.launcher.wait(30) == 0
    assert house.processes() == {}


def test_a_core_that_dies_while_it_is_drained_is_followed_by_the_spare(new_house: MakeHouse) -> None:
    house = new_house(**WITH_SPARE).up()
    before = house.spared()
    house.open_accounts()
    old = house.hold("core")
    with at_work(house, 2, "drained", patient=False) as clients:
        until(lambda: len(clients.told) > 10, "the load to run")
        house.order("restart")
        old.hit(signal.SIGKILL)
        house.until(lambda s: s["core"]["ready"] and s["core"]["pid"] != old.pid, "the next core")
        told = len(clients.told)
        until(lambda: len(clients.told) > told + 10, "its answers")
    assert {told.status for told in clients.told} == {201}, clients.told
    assert_exactly_once(house, clients)
    assert house.spared()["core"]["epoch"] == before["core"]["epoch"] + 1
