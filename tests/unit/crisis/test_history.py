"""The outages that are over: kept over the gateway's death, and read back only where they make sense."""

import asyncio
import json
from pathlib import Path

import pytest

from hardcore.crisis.estimate import SAMPLES_MAX, Sample, Told, Way, sample
from hardcore.crisis.history import History, estimate_score, read_samples
from hardcore.host.files import read_json


def test_what_was_remembered_is_read_back(tmp_path: Path) -> None:
    kept = tmp_path / "recoveries.json"

    async def run() -> tuple[Sample, ...]:
        history = History(asyncio.get_running_loop(), kept)
        for total in range(SAMPLES_MAX + 5):
            history.add(sample(total, [(1, 0), (3, total // 2)], Way.SPARE, Told(0, 1)))
        await history.finish()
        return history.samples

    samples = asyncio.run(run())
    assert len(samples) == SAMPLES_MAX
    assert read_samples(read_json(kept)) == samples
    assert samples[-1].total_ms == SAMPLES_MAX + 4


def test_a_folder_that_takes_nothing_costs_the_memory_alone(tmp_path: Path) -> None:
    async def run() -> tuple[Sample, ...]:
        history = History(asyncio.get_running_loop(), tmp_path / "no" / "recoveries.json")
        history.add(sample(1, ()))
        await history.finish()
        return history.samples

    assert asyncio.run(run()) == (sample(1, ()),)


@pytest.mark.parametrize(
    "row",
    [
        None,
        {},
        {"total_ms": True, "reached_ms": [0, 0, 0, 0]},
        {"total_ms": -1, "reached_ms": [0, 0, 0, 0]},
        {"total_ms": 10**12, "reached_ms": [0, 0, 0, 0]},
        {"total_ms": 5, "reached_ms": [0, 0, 0]},
        {"total_ms": 5, "reached_ms": [0, 3, 2, 4]},
        {"total_ms": 5, "reached_ms": [0, 0, 0, 9]},
        {"total_ms": 5, "reached_ms": [0, 0, 0, "4"]},
        {"total_ms": 5, "reached_ms": [0, 0, 0, None]},
        {"total_ms": 5, "reached_ms": [0, 0, 0, 0], "way": "sideways"},
        {"total_ms": 5, "reached_ms": [0, 0, 0, 0], "way": ["cold"]},
    ],
)
def test_a_row_that_makes_no_sense_is_passed_over(row: object) -> None:
    good = {"total_ms": 5, "reached_ms": [0, 1, 2, 3]}
    kept = json.loads(json.dumps({"recoveries": [row, good]}))
    assert read_samples(kept) == (Sample(5, (0, 1, 2, 3)),)


def test_a_file_of_an_earlier_version_knows_cold_starts_without_promises() -> None:
    (read,) = read_samples({"recoveries": [{"total_ms": 5, "reached_ms": [0, 1, 2, 3]}]})
    assert (read.way, read.told) == (Way.COLD, None)


@pytest.mark.parametrize("told", [None, [1], [3, 1], ["1", 2], {"low_s": 1}])
def test_a_promise_that_makes_no_sense_is_none(told: object) -> None:
    (read,) = read_samples({"recoveries": [{"total_ms": 5, "reached_ms": [0, 1, 2, 3], "told_s": told}]})
    assert read.told is None


def test_how_good_the_estimates_were_is_read_out_of_the_file() -> None:
    row = {"total_ms": 5_000, "reached_ms": [0, 1, 2, 3], "way": "spare"}
    rows = [row, row | {"told_s": [0, 4]}, row | {"told_s": [1, 5]}]
    assert estimate_score({"recoveries": rows}) == {"samples": 3, "scored": 2, "within": 1}
