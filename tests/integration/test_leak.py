"""What shows slowly ends nobody: a core that leaks is changed for another, a part that stands still is begun anew."""

import json
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest

from tests.integration.house import WITH_SPARE, House

#: Hours in seconds: a stretch of a second, a horizon of a minute.
QUICK = {
    "forecast_interval_sec": 1,
    "forecast_warmup_sec": 0,
    "forecast_confirm_sec": 1,
    "forecast_horizon_sec": 60,
    "memory_limit_mb": 400,
}


@pytest.fixture(scope="module")
def shared_house(tmp_path_factory: pytest.TempPathFactory) -> Iterator[House]:
    """The house of this module; the part that stands still comes first, because it changes no core."""
    house = House(tmp_path_factory.mktemp("slow") / "data", {**WITH_SPARE, **QUICK})
    try:
        house.up()
        house.open_accounts()
        yield house
    finally:
        house.end()


def drilled(house: House, *words: str) -> Any:
    done = house.cli("drill", *words, "--yes", "--json")
    assert done.code == 0, done
    return json.loads(done.out)["story"]


def test_a_part_that_stands_still_is_begun_anew_alone_and_its_drill_counts_on_nothing(house: House) -> None:
    before = house.spared()["core"]
    story = drilled(house, "stall", "notifier")
    after = house.running()
    assert after["core"]["pid"] == before["pid"]
    assert after["budget"]["used"] == 0
    assert (story["diagnosis"], story["outcome"], story["drill"]) == (
        "COMPONENT_STALLED",
        "recovered",
        "stall",
    )
    assert house.book("after-the-stall").status == 201


def test_a_core_that_leaks_is_changed_for_another_before_its_limit_and_no_request_fails(house: House) -> None:
    before = house.spared()["core"]
    count = len(house.booked())
    with ThreadPoolExecutor(1) as beside:
        drill = beside.submit(drilled, house, "leak", "--seconds", "60")
        statuses = [house.book(f"beside-{one}").status for one in range(20)]
        story = drill.result()
    after = house.running()["core"]
    assert after["pid"] != before["pid"]
    assert after["epoch"] == before["epoch"] + 1
    assert after["rss_bytes"] < QUICK["memory_limit_mb"] << 20
    statuses += [house.book(f"after-{one}").status for one in range(5)]
    assert statuses == [201] * 25
    assert len(house.booked()) == len(set(house.booked())) == count + 25
    assert (story["diagnosis"], story["planned"], story["outcome"], story["drill"]) == (
        "LEAK",
        True,
        "recovered",
        "leak",
    )
    assert any("MiB" in one["text"] for one in story["evidence"]), story["evidence"]
