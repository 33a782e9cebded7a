"""Rows under suspicion: their file waits behind them, their case is filed, and everybody else goes on."""

import asyncio
import json
from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from uuid import UUID

import pytest

from core.guarded.poison import name_of
from core.guarded.recorder import NoRecorder
from core.imports import importer as importing
from core.imports.folder import Imports
from core.imports.importer import IN_FLIGHT_MAX, Importer
from core.imports.jobs import Job
from core.imports.outcomes import Booked, Outcome, meaning_of
from core.imports.reading.candidates import Result, SkippedRow
from core.imports.records import Manifest, Problem, Progress
from core.imports.states import State, Waiting
from core.imports.suspected import Suspected
from core.journal.answers import Limited, SetAside
from core.rulings import Rulings
from tests.unit.core.test_importer import rows
from tests.waiting import WAIT_S

ONE, OTHER = str(UUID(int=1)), str(UUID(int=2))


class Booking(Importer):
    """An importer whose rows are all booked."""

    def __init__(self, suspected: Suspected) -> None:
        self.frames: list[dict[str, Any]] = []
        hub = SimpleNamespace(tell=lambda told: self.frames.extend(json.loads(one.text) for one in told))
        service: Any = SimpleNamespace(hub=hub, draining=False, safe=None)
        super().__init__(service, NoRecorder(), suspected)
        self.booked: list[tuple[str, int]] = []

    def said_of(self, import_id: str) -> list[str | None]:
        """Why the pages of an import were told that it waits, each change once."""
        said = [one["waiting"] for one in self.frames if one["id"] == import_id]
        return [one for one, before in zip(said, [None, *said], strict=False) if one != before]

    async def _row(self, job: Job, ordinal: int, _result: Result) -> Outcome | SkippedRow:
        self.booked.append((job.manifest.id, ordinal))
        return Booked()


def job(data: Path, import_id: str, count: int) -> Job:
    imports = Imports(data)
    made = Manifest(import_id, State.COMMITTING, "bank.csv", 1, "00", 0, account="bank", currency="KRW")
    imports.begin(import_id)
    imports.unfinished(import_id).keep_manifest(made)
    return Job(imports.finish(import_id), made, count, rows(count), Progress(), one_by_one=count)


def suspect(state: Path, *names: str, stopped: str = "", until: str = "") -> None:
    state.mkdir(exist_ok=True)
    said = {"version": 1, "serial": 1, "rules": [], "suspects": [{"name": name} for name in names]}
    if stopped:
        said["sources"] = [{"source": stopped, "until": until}]
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
    told: list[Sequence[str]] = []

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
    assert told == [[name]]
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


def test_the_suspects_of_a_wave_are_filed_and_said_at_once(tmp_path: Path, rulings: Rulings) -> None:
    wave = [name_of(f"{ONE}:{n}") for n in range(5, 5 + IN_FLIGHT_MAX)]
    beyond = name_of(f"{ONE}:{5 + 2 * IN_FLIGHT_MAX}")
    suspect(tmp_path / "state", *wave, beyond)
    told: list[Sequence[str]] = []

    async def scenario() -> None:
        importer = Booking(Suspected(rulings, told.append))
        waits = job(tmp_path, ONE, 60)
        importer.add(waits)
        importer.start()
        await until(lambda: told)
        suspect(tmp_path / "state", *wave[3:], beyond)
        rulings.read()
        await until(lambda: waits.waits_for == wave[3])
        assert told == [wave], "each is said once"
        suspect(tmp_path / "state", beyond)
        rulings.read()
        await until(lambda: len(told) > 1)
        suspect(tmp_path / "state")
        rulings.read()
        await until(lambda: importer.job(ONE) is None)
        await importer.stop()
        assert waits.progress == Progress(done=60, booked=60)

    asyncio.run(scenario())
    assert told == [wave, [beyond]]


def test_a_case_is_said_again_while_its_row_waits(
    tmp_path: Path, rulings: Rulings, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(importing, "SAY_AGAIN_NS", 1)
    name = name_of(f"{ONE}:1")
    suspect(tmp_path / "state", name)
    told: list[Sequence[str]] = []

    async def scenario() -> None:
        importer = Booking(Suspected(rulings, told.append))
        importer.add(job(tmp_path, ONE, 3))
        importer.start()
        await until(lambda: len(told) > 1)
        (tmp_path / "state" / "cases" / f"{name}.json").unlink()
        before = len(told)
        await until(lambda: len(told) > before + 1)
        await importer.stop()

    asyncio.run(scenario())
    assert {tuple(names) for names in told} == {(name,)}
    assert (tmp_path / "state" / "cases" / f"{name}.json").exists(), "filed anew where it is gone"


def test_an_import_that_is_stopped_rests_until_its_time_and_says_why(
    tmp_path: Path, rulings: Rulings
) -> None:
    suspect(tmp_path / "state", stopped=f"import:{ONE}", until="2999-01-01T00:00:00Z")

    async def scenario() -> None:
        importer = Booking(Suspected(rulings))
        rests, goes_on = job(tmp_path, ONE, 20), job(tmp_path, OTHER, 20)
        importer.add(rests)
        importer.add(goes_on)
        importer.start()
        await until(lambda: importer.job(OTHER) is None)
        assert (rests.waiting, rests.progress) == (Waiting.SOURCE_STOPPED, Progress())
        suspect(tmp_path / "state", stopped=f"import:{ONE}", until="2020-01-01T00:00:00Z")
        rulings.read()
        await until(lambda: importer.job(ONE) is None)
        await importer.stop()
        assert rests.progress == Progress(done=20, booked=20)
        assert importer.said_of(ONE) == ["source-stopped", None]

    asyncio.run(scenario())


def test_its_pages_hear_that_an_import_waits_for_a_trial_and_that_it_goes_on(
    tmp_path: Path, rulings: Rulings
) -> None:
    suspect(tmp_path / "state", name_of(f"{ONE}:2"))

    async def scenario() -> None:
        importer = Booking(Suspected(rulings))
        importer.add(job(tmp_path, ONE, 3))
        importer.start()
        await until(lambda: importer.said_of(ONE) == ["trial"])
        suspect(tmp_path / "state")
        rulings.read()
        await until(lambda: importer.job(ONE) is None)
        await importer.stop()
        assert importer.said_of(ONE) == ["trial", None]

    asyncio.run(scenario())


def test_a_case_that_finds_no_room_is_filed_later(tmp_path: Path, rulings: Rulings) -> None:
    suspect(tmp_path / "state", name_of(f"{ONE}:1"))
    (tmp_path / "state" / "cases").write_text("in the way")
    told: list[Sequence[str]] = []

    async def scenario() -> None:
        importer = Booking(Suspected(rulings, told.append))
        importer.add(job(tmp_path, ONE, 3))
        importer.start()
        await until(lambda: any(one.file_again_ns for one in importer._jobs))
        assert not told
        assert not any(one.filed for one in importer._jobs)
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
