"""What a guard remembers of suspects, over its own death."""

import datetime as dt
import json
from pathlib import Path

import pytest

from hardcore.host import suspects
from hardcore.host.folders import Folders
from hardcore.model.trials import CourtMemory, Ordeal, Suspect
from hardcore.model.verdicts import Diagnosis

NOW = dt.datetime(2026, 11, 22, 12, tzinfo=dt.UTC)
OPEN = Suspect("a" * 32, "incident", blame=Diagnosis.CRASHED)
TRIED = Suspect("b" * 32, "incident", ordeal=Ordeal.DIED, letter="letter")


@pytest.fixture
def folders(tmp_path: Path) -> Folders:
    made = Folders(tmp_path, tmp_path / "run")
    made.state.mkdir()
    return made


def test_a_court_is_remembered(folders: Folders) -> None:
    memory = CourtMemory((OPEN, TRIED), settled_seq=7)
    since = suspects.times({}, CourtMemory(), memory, NOW)
    suspects.write(folders, memory, since, durable=True)
    assert suspects.read(folders, NOW) == (memory, since)


def test_what_was_settled_a_day_ago_is_forgotten_and_what_is_open_never(folders: Folders) -> None:
    memory = CourtMemory((OPEN, TRIED))
    suspects.write(folders, memory, suspects.times({}, CourtMemory(), memory, NOW), durable=False)
    assert suspects.read(folders, NOW + dt.timedelta(hours=25))[0].suspects == (OPEN,)


def test_who_has_not_changed_keeps_its_time() -> None:
    memory = CourtMemory((OPEN, TRIED))
    first = suspects.times({}, CourtMemory(), memory, NOW)
    later = suspects.times(first, memory, CourtMemory((TRIED,)), NOW + dt.timedelta(hours=1))
    assert later == {TRIED.name: first[TRIED.name]}


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"version": 1, "at": {}, "memory": {"Suspect": {}}}', "\x00"]
)
def test_a_memory_that_can_not_be_read_is_none(folders: Folders, text: str) -> None:
    folders.suspects.write_text(text)
    assert suspects.read(folders, NOW) == (CourtMemory(), {})


def test_a_time_that_makes_no_sense_is_an_old_one(folders: Folders) -> None:
    suspects.write(folders, CourtMemory((TRIED,)), {TRIED.name: "yesterday"}, durable=False)
    assert json.loads(folders.suspects.read_text())["at"] == {TRIED.name: "yesterday"}
    assert suspects.read(folders, NOW)[0].suspects == ()


def test_what_another_version_of_the_guard_has_written_beside_it_costs_no_suspect(folders: Folders) -> None:
    suspects.write(folders, CourtMemory((OPEN,), settled_seq=7), {}, durable=False)
    told = json.loads(folders.suspects.read_text())
    told["memory"]["CourtMemory"]["parked"] = [3]
    told["memory"]["CourtMemory"]["suspects"][0]["Suspect"]["of_tomorrow"] = True
    folders.suspects.write_text(json.dumps(told))
    assert suspects.read(folders, dt.datetime.now(dt.UTC))[0] == CourtMemory((OPEN,), settled_seq=7)
