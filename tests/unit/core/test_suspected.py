"""Rows under suspicion: their file waits behind them, their case is filed, and everybody else goes on."""

import asyncio
import json
from hashlib import sha256
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from uuid import UUID

import pytest

from core.guarded.poison import name_of
from core.guarded.recorder import NoRecorder
from core.imports.folder import Imports
from core.imports.importer import Booked, Importer, Job, Outcome, meaning_of
from core.imports.reading.candidates import Result, SkippedRow
from core.imports.records import Manifest, Problem, Progress
from core.imports.states import State
from core.imports.suspected import Suspected
from core.journal.answers import Limited, SetAside
from core.rulings import Rulings
from tests.unit.core.test_importer import rows
from tests.waiting import WAIT_S

ONE, OTHER = str(UUID(int=1)), str(UUID(int=2))


class Booking(Importer):
    """An importer whose rows are all booked."""

    def __init__(self, suspected: Suspected) -> None:
        service: Any = SimpleNamespace(hub=SimpleNamespace(tell=lambda _: None), draining=False, safe=None)
        super().__init__(service, NoRecorder(), suspected)
        self.booked: list[tuple[str, int]] = []

    async def _row(self, manifest: Manifest, ordinal: int, _result: Result) -> Outcome | SkippedRow:
        self.booked.append((manifest.id, ordinal))
        return Booked()


def job(data: Path, import_id: str, count: int) -> Job:
    imports = Imports(data)
    made = Manifest(import_id, State.COMMITTING, "bank.csv", 1, "00", 0, account="bank", currency="KRW")
    imports.begin(import_id)
    imports.unfinished(import_id).keep_manifest(made)
    return Job(imports.finish(import_id), made, count, rows(count), Progress())


def suspect(state: Path, *names: str) -> None:
    state.mkdir(exist_ok=True)
    said = {"version": 1, "serial": 1, "rules": [], "suspects": [{"name": name} for name in names]}
    (state / "quarantine.json").write_text(json.dumps(said))


@pytest.fixture
def rulings(tmp_path: Path) -> Rulings:
    return Rulings.beside(tmp_path / "state" / "quarantine.json")


async def until(look: Any) -> None:
    async with asyncio.timeout(WAIT_S):
        while not look():  # noqa: ASYNC110  what is waited for tells nobody
            await asyncio.sleep(0.01)


def test_a_file_waits_behind_its_suspect_and_another_goes_on(tmp_path: Path, rulings: Rulings) -> None:
    name = name_of(f"{ONE}:5")
    suspect(tmp_path / "state", name)
    told: list[str] = []

    async def scenario() -> None:
        importer = Booking(Suspected(rulings, told.append))
        waits, goes_on = job(tmp_path, ONE, 40), job(tmp_path, OTHER, 60)
        importer.add(waits)
        importer.add(goes_on)
        importer.start()  # it reads the suspects by itself
        await until(lambda: importer.job(OTHER) is None and told)
        assert waits.progress == Progress(done=4, booked=4)
        assert {n for import_id, n in importer.booked if import_id == ONE} == {1, 2, 3, 4}
        suspect(tmp_path / "state")
        rulings.read()
        await until(lambda: importer.job(ONE) is None)
        assert waits.progress == Progress(done=40, booked=40)
        await importer.stop()

    asyncio.run(scenario())
    assert told == [name], "once in a life"
    case = json.loads((tmp_path / "state" / "cases" / f"{name}.json").read_text())
    assert case.pop("at").endswith("Z")
    assert case == {
        "version": 1,
        "name": name,
        "source": f"import:{ONE}",
        "key": f"{ONE}:5",
        "digest": sha256(f"{ONE}:5".encode()).hexdigest(),
        "case": {"name": name, "row": {"import": ONE, "ordinal": 5}},
    }


def test_a_case_that_finds_no_room_is_filed_later(tmp_path: Path, rulings: Rulings) -> None:
    suspect(tmp_path / "state", name_of(f"{ONE}:1"))
    (tmp_path / "state" / "cases").write_text("in the way")
    told: list[str] = []

    async def scenario() -> None:
        importer = Booking(Suspected(rulings, told.append))
        importer.add(job(tmp_path, ONE, 3))
        importer.start()
        await until(lambda: any(one.file_again_ns for one in importer._jobs))
        assert not told
        (tmp_path / "state" / "cases").unlink()
        await until(lambda: told)
        assert not importer.booked
        await importer.stop()

    asyncio.run(scenario())


def test_a_row_that_is_set_aside_is_refused_with_its_number_and_the_rest_goes_on() -> None:
    row: Any = next(rows(1))
    for answer, reason, values in (
        (SetAside("L"), "set-aside", {"letter": "L"}),
        (SetAside("L", "bank"), "account-set-aside", {"letter": "L", "account": "bank"}),
        (Limited("R", None), "limited", {"rule": "R"}),
    ):
        status, outcome = meaning_of(answer, row)
        assert isinstance(outcome, Problem)
        assert (status, outcome.reason, outcome.values) == (422, reason, values)
    assert meaning_of(Limited("R", 5), row) == (503, None), "it is asked again"


def test_without_a_guard_nothing_is_suspect() -> None:
    alone = Suspected()
    alone.look_again()
    assert not alone.any
    assert not alone.holds("0a" * 16)
