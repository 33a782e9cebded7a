"""The operator's words about the core that waits: restart, drill, status, and a start without one."""

from collections.abc import Iterator

import pytest

from tests.integration import houses
from tests.integration.conftest import MakeHouse
from tests.integration.house import WITH_SPARE, House


@pytest.fixture(scope="module")
def shared_house(tmp_path_factory: pytest.TempPathFactory) -> Iterator[House]:
    """A house that keeps a spare."""
    house = House(tmp_path_factory.mktemp("spared") / "data", WITH_SPARE)
    try:
        yield house.up()
    finally:
        house.end()


house = houses.house


def test_a_restart_says_that_the_spare_has_taken_over_and_for_how_long_nobody_was_served(
    house: House,
) -> None:
    spare = house.spared()["spare"]["pid"]
    done = house.cli("--json", "restart", "--reason", "to see it")
    assert done.code == 0, done
    assert done.told["ok"] is True
    assert done.told["outage_ms"] >= 0
    assert house.status()["core"]["pid"] == spare


def test_a_spare_that_is_killed_on_purpose_is_followed_by_another_and_nobody_notices(house: House) -> None:
    before = house.spared()
    done = house.cli("--json", "drill", "spare")
    assert done.code == 0, done
    after = house.spared()
    assert after["spare"]["pid"] == done.told["spare"] != before["spare"]["pid"]
    assert (after["core"]["pid"], after["last_incident"]) == (before["core"]["pid"], before["last_incident"])
    assert after["state"] == "OPERATIONAL"


def test_up_can_be_told_to_keep_no_spare_over_each_guards_death(new_house: MakeHouse) -> None:
    house = new_house(**WITH_SPARE).up("--no-spare")
    sentinel = house.hit("sentinel")
    house.until(lambda s: s["sentinel"]["pid"] not in {None, sentinel.pid}, "another sentinel")
    status = house.running()
    assert (status["spare"], status["spare_lack"]) == (None, "off")
    assert house.cli("drill", "spare").code == 1
    assert len([line for line in house.processes().values() if "-m core serve" in line]) == 1


def test_a_running_guard_is_not_told_afterwards_to_keep_no_spare(new_house: MakeHouse) -> None:
    house = new_house(**WITH_SPARE).up()
    assert house.launcher is not None
    house.launcher.kill()
    house.launcher.wait()
    second = house.begin("--no-spare")
    assert second.wait(30) == 1
    assert "--no-spare" in house.said
    assert house.spared()["spare"]["ready"] is True
