"""The history of the state: each change once, over the lives of guards, and never more than fits."""

import asyncio
from collections.abc import Callable, Coroutine, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from hardcore import chronicle
from hardcore.chronicle import CHANGES_MAX, Chronicle
from hardcore.host import files
from hardcore.host.folders import Folders
from hardcore.model.phases import HAState, Phase
from hardcore.recovery.reading import StateChange


@dataclass
class Hands:
    """Hands that do at once what they are given."""

    noted: list[str] = field(default_factory=list)
    spooled: list[Mapping[str, Any]] = field(default_factory=list)

    def begin(self, work: Coroutine[Any, Any, object]) -> None:
        asyncio.run(work)

    async def in_hand(self, work: Callable[..., Any], *args: Any) -> Any:
        return work(*args)

    def note(self, kind: str, **particulars: object) -> None:
        del particulars
        self.noted.append(kind)

    def spool(self, kind: str, fields: Mapping[str, Any]) -> None:
        assert kind == "state"
        self.spooled.append(fields)


@pytest.fixture
def folders(tmp_path: Path) -> Folders:
    made = Folders(tmp_path, tmp_path / "run")
    made.state.mkdir()
    return made


def change(number: int, reason: str = "the beats are back") -> StateChange:
    return StateChange(number * 1_000_000_000, HAState.DEGRADED, HAState.OPERATIONAL, Phase.RUNNING, reason)


def test_each_change_is_kept_and_told_once(folders: Folders) -> None:
    hands = Hands()
    kept = Chronicle(folders, hands, hands.spool)
    kept.take(())
    kept.take((change(1),))
    kept.take((change(1),))
    kept.take((change(1), change(2), change(3)))
    assert len(kept.told()) == len(hands.spooled) == 3
    assert chronicle.read(folders) == tuple(kept.told())
    assert kept.told()[0]["reason"] == "the beats are back"


def test_the_next_guard_goes_on_with_the_history_of_the_one_before(folders: Folders) -> None:
    hands = Hands()
    Chronicle(folders, hands, hands.spool).take((change(1),))
    after = Chronicle(folders, hands, hands.spool)
    after.take((change(1), change(2)))  # its own manager's: the first is another change than the one before
    assert len(after.told()) == 3


def test_the_history_is_bounded(folders: Folders) -> None:
    hands = Hands()
    kept = Chronicle(folders, hands, hands.spool)
    for number in range(3):
        kept.take(tuple(change(number * CHANGES_MAX + each) for each in range(CHANGES_MAX)))
    assert len(kept.told()) == len(chronicle.read(folders)) == CHANGES_MAX


def test_a_disk_that_takes_no_history_is_told_and_the_history_is_known_all_the_same(folders: Folders) -> None:
    folders.state.rmdir()
    hands = Hands()
    kept = Chronicle(folders, hands, hands.spool)
    kept.take((change(1),))
    assert hands.noted == ["history"]
    folders.state.mkdir()
    kept.take((change(1), change(2)))
    assert len(chronicle.read(folders)) == 2, "what was not taken is written with the next"


def test_a_damaged_history_is_no_history(folders: Folders) -> None:
    files.write_json(folders.history, {"changes": [1, {"at": "x"}, "y"]})
    assert chronicle.read(folders) == ()
    files.write_whole(folders.history, b"{")
    assert chronicle.read(folders) == ()
