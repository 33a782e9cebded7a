"""When a drill on a schedule is due, and when the moment for one is not there."""

import asyncio
import datetime as dt
import json
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

import pytest
from msgspec import structs

from hardcore.calendar import Calendar, is_due, is_moment
from hardcore.host.folders import Folders
from hardcore.model.phases import HAState
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.policy import Policy
from hardcore.recovery.reading import Reading
from tests.unit.recovery.play import Play

ZONE = dt.timezone(dt.timedelta(hours=9))


def at(day: int, hour: int, minute: int = 0) -> dt.datetime:
    return dt.datetime(2026, 11, day, hour, minute, tzinfo=ZONE)


@pytest.mark.parametrize(
    ("now", "last", "every_h", "due"),
    [
        (at(22, 4), None, 0, False),
        (at(22, 4), None, 24, True),
        (at(22, 5), None, 24, False),
        (at(23, 4), at(22, 4, 30), 24, True),
        (at(22, 4, 59), at(22, 4, 1), 24, False),
        (at(23, 5), at(22, 4), 24, False),
        (at(25, 4), at(22, 4), 168, False),
        (at(29, 4), at(22, 4), 168, True),
        (at(22, 9, 59), at(22, 4), 6, False),
        (at(22, 10), at(22, 4), 6, True),
        (at(22, 4), at(23, 4), 24, False),
    ],
)
def test_a_drill_is_due_at_its_hour_and_after_its_time(
    now: dt.datetime, last: dt.datetime | None, every_h: int, *, due: bool
) -> None:
    assert is_due(now, last, every_h, 4) is due


@pytest.fixture
def well() -> Reading:
    return structs.replace(
        Play().begin().running().manager.reading(), state=HAState.OPERATIONAL, incident=None
    )


def test_nobody_is_broken_who_is_not_well_or_not_alone(well: Reading) -> None:
    assert is_moment(well, quiet=True)
    assert not is_moment(well, quiet=False)
    for other in (
        {"state": HAState.DEGRADED},
        {"incident": "0199a000-0000-7000-8000-00000000000f"},
        {"safe": Diagnosis.DISK_FULL},
        {"deaths": 1},
        {"switch_waits": True},
    ):
        assert not is_moment(structs.replace(well, **other), quiet=True), other


class Hands:
    """Hands that work at once and keep what they note."""

    def __init__(self) -> None:
        self.begun: list[asyncio.Task[object]] = []
        self.noted: list[dict[str, object]] = []

    def begin(self, work: Coroutine[Any, Any, object]) -> None:
        self.begun.append(asyncio.get_running_loop().create_task(work))

    async def in_hand(self, work: Callable[..., Any], *args: Any) -> Any:
        return work(*args)

    def note(self, kind: str, **particulars: object) -> None:
        self.noted.append({"kind": kind, **particulars})


def looked(folders: Folders, policy: Policy, reading: Reading) -> Hands:
    async def look() -> Hands:
        hands = Hands()
        Calendar(folders, policy, hands).look(reading, quiet=True)
        await asyncio.gather(*hands.begun)
        return hands

    return asyncio.run(look())


def test_a_policy_without_a_schedule_has_nothing_begun(tmp_path: Path, well: Reading) -> None:
    assert not looked(Folders(tmp_path, tmp_path), Policy(), well).begun


def test_a_drill_is_written_down_before_it_is_begun_and_not_begun_twice(
    tmp_path: Path, well: Reading
) -> None:
    folders = Folders(tmp_path, tmp_path / "run")
    for folder in (folders.run, folders.state, folders.logs):
        folder.mkdir()
    folders.calendar.write_text(json.dumps({"at": at(1, 4).isoformat(), "number": 5}))
    policy = Policy(drill_every_hours=12, drill_faults=("gc", "crash"))
    first = looked(folders, policy, well)  # nobody guards this folder: the command says so and ends
    assert [line.get("fault") for line in first.noted] == ["gc", "gc"]
    assert json.loads(folders.calendar.read_text())["number"] == 6
    assert looked(folders, policy, well).noted == []
