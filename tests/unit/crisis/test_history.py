"""The outages that are over: kept over the gateway's death, and read back only where they make sense."""

import asyncio
import json
from pathlib import Path

import pytest

from hardcore.crisis.estimate import SAMPLES_MAX, Sample, sample
from hardcore.crisis.history import History, read_samples
from hardcore.host.files import read_json


def test_what_was_remembered_is_read_back(tmp_path: Path) -> None:
    kept = tmp_path / "recoveries.json"

    async def run() -> tuple[Sample, ...]:
        history = History(asyncio.get_running_loop(), kept)
        for total in range(SAMPLES_MAX + 5):
            history.add(sample(total, [(1, 0), (3, total // 2)]))
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
    ],
)
def test_a_row_that_makes_no_sense_is_passed_over(row: object) -> None:
    good = {"total_ms": 5, "reached_ms": [0, 1, 2, 3]}
    kept = json.loads(json.dumps({"recoveries": [row, good]}))
    assert read_samples(kept) == (Sample(5, (0, 1, 2, 3)),)
