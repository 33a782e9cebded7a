"""A core that leaks is told of before its limit and changed for another in a quiet moment; nobody notices."""

import asyncio
import json
import os
from pathlib import Path

from hardcore.host import core_control
from tests.integration.house import WITH_SPARE, House, whole
from tests.integration.houses import MakeHouse

#: Hours in seconds: a stretch of a second, a horizon of a minute.
QUICK = {
    "forecast_interval_sec": 1,
    "forecast_warmup_sec": 0,
    "forecast_confirm_sec": 1,
    "forecast_horizon_sec": 60,
    "memory_limit_mb": 400,
}
ANSWER_S = 10.0


def test_a_core_that_leaks_is_changed_for_another_before_its_limit_and_no_request_fails(
    new_house: MakeHouse,
) -> None:
    house = new_house(**WITH_SPARE, **QUICK).up()
    house.open_accounts()
    before = house.spared()["core"]
    _leak(house, 8)
    statuses = [house.book(f"beside-{one}").status for one in range(20)]
    house.until(lambda s: s["forecasts"] and s["forecasts"][0]["resource"] == "memory", "a forecast")
    story = whole(house, 1)
    after = house.running()["core"]
    assert after["pid"] != before["pid"]
    assert after["epoch"] == before["epoch"] + 1
    assert after["rss_bytes"] < QUICK["memory_limit_mb"] << 20
    statuses += [house.book(f"after-{one}").status for one in range(5)]
    assert statuses == [201] * 25
    assert len(house.booked()) == len(set(house.booked())) == 25
    assert (story["diagnosis"], story["planned"], story["outcome"]) == ("LEAK", True, "recovered")
    assert any("MiB" in one["text"] for one in story["evidence"]), story["evidence"]


def _leak(house: House, mb_per_s: int) -> None:
    """Have the core that serves take so much a second and keep it."""
    generation = json.loads((house.folders.run / "generation").read_text("utf-8"))["generation"]
    around = Path(f"/proc/{house.status()['core']['pid']}/environ").read_bytes().split(b"\0")
    (control,) = (
        os.fsdecode(one.partition(b"=")[2]) for one in around if one.startswith(b"HARDCORE_CONTROL=")
    )
    order = {"verb": "drill", "fault": "leak", "mb_per_s": mb_per_s, "seconds": 120, "generation": generation}
    assert asyncio.run(core_control.give(Path(control), order, ANSWER_S)) == ""
