"""Cases on the disk: their room is what lies there now, whoever took others away."""

import asyncio
import os
import time
from pathlib import Path

import pytest

from hardcore.crisis import cases
from hardcore.crisis.cases import KEPT_S, Cases, Draft


def a_draft(number: int, body: bytes = b"x" * 100) -> Draft:
    return Draft(
        f"{number:032x}", "peer:127.0.0.1", None, "0" * 64, "POST", "/t", (), (body,), body_bytes=len(body)
    )


class Told:
    """Hears what is filed, and lets a test wait for it."""

    def __init__(self, folder: Path) -> None:
        self.names: list[str] = []
        self.came = asyncio.Event()
        self.cases = Cases(asyncio.get_running_loop(), folder, self._hear)

    def _hear(self, name: str) -> None:
        self.names.append(name)
        self.came.set()

    async def file(self, draft: Draft) -> None:
        self.came.clear()
        self.cases.file(draft)
        await asyncio.wait_for(self.came.wait(), 20)


def test_cases_that_the_guard_took_away_take_no_room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async def course(*, taken_away: bool) -> list[str]:
        there = tmp_path / str(taken_away)
        told = Told(there)
        await told.file(a_draft(1))
        monkeypatch.setattr(
            cases, "CASES_BYTES_MAX", (there / f"{a_draft(1).name}.json").stat().st_size + 100
        )
        if taken_away:
            (there / f"{a_draft(1).name}.json").unlink()
        told.cases.file(a_draft(2))
        await told.cases.finish()
        return told.names

    assert asyncio.run(course(taken_away=False)) == [a_draft(1).name]
    assert asyncio.run(course(taken_away=True)) == [a_draft(1).name, a_draft(2).name]


def test_a_case_that_was_handed_over_is_told_of_no_more_and_can_be_filed_again(tmp_path: Path) -> None:
    async def course() -> list[str]:
        told, draft = Told(tmp_path), a_draft(1)
        made = told.cases
        made.start()
        await told.file(draft)
        made.hand_over(draft.name)
        made.tell([draft.name])
        assert not made.has(draft.name)
        assert (
            tmp_path / f"{draft.name}.json"
        ).exists()  # the guard takes it away, once its letter is written
        made.file(draft)
        await made.finish()
        return told.names

    assert len(asyncio.run(course())) == 2


def test_a_case_is_let_go_when_it_is_a_day_old_though_the_gateway_lives_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cases, "SWEEP_S", 0)

    async def course() -> bool:
        told = Told(tmp_path)
        made = told.cases
        await told.file(a_draft(1))
        old_s = time.time() - KEPT_S - 60
        os.utime(tmp_path / f"{a_draft(1).name}.json", (old_s, old_s))
        made.upkeep()
        await made.finish()
        return made.has(a_draft(1).name)

    assert asyncio.run(course()) is False
    assert not list(tmp_path.iterdir())
