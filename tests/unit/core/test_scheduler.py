"""What falls due is done, once, by whoever may write."""

import asyncio
import base64
import datetime as dt
import json
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec
from sqlalchemy import Connection

from core.guarded.poison import name_of
from core.guarded.recorder import NoRecorder
from core.journal import queries
from core.keeping.daily import DailyBackup, is_due
from core.keeping.shelf import SUFFIX
from core.keeping.shelf import name_of as copy_name
from core.ledger.commands import Command
from core.rulings import Rulings
from core.scheduler import Errand, Scheduler
from core.service import Service
from core.settings import Settings
from tests.unit.core.books import closing, opening
from tests.unit.core.test_service import serving

NOW = dt.datetime(2026, 11, 23, 9, 0, tzinfo=dt.UTC)
DAY = dt.timedelta(days=1)
QUICK = Settings(schedule_every_ms=10)


def errand(key: str, command: Command) -> Errand:
    return Errand(key, "test.errand", command, "/api/ledger/accounts", b'{"a": 1}')


class Source:
    """Names accounts to open that are not there yet, and counts how often it was asked."""

    def __init__(self, *names: str) -> None:
        self.names, self.asked = names, 0

    def __call__(self, connection: Connection, now: dt.datetime, limit: int) -> Sequence[Errand]:
        self.asked += 1
        missing = [name for name in self.names if queries.get_account(connection, name) is None]
        return [errand(f"open:{name}:{now:%Y}", opening(name)) for name in missing][:limit]


def scheduler(service: Service, *sources: Source, rulings: Rulings | None = None) -> Scheduler:
    return Scheduler(
        service, service.readers, NoRecorder(), QUICK, rulings or Rulings(), sources, clock=lambda: NOW
    )


async def until(holds: Callable[[], bool]) -> None:
    async with asyncio.timeout(20):
        while not holds():  # noqa: ASYNC110  a thread brings it about
            await asyncio.sleep(0.005)


async def asked(source: Source, times: int) -> None:
    await until(lambda: source.asked >= times)


def test_what_is_due_is_done_once_however_often_it_is_looked(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with serving(tmp_path) as service:
            source = Source("bank", "food")
            work = asyncio.create_task(scheduler(service, source).run())
            await asked(source, 4)
            work.cancel()
            assert service.head_seq == 2

    asyncio.run(scenario())


def test_a_core_that_only_reads_runs_no_errand_and_asks_for_none(tmp_path: Path) -> None:
    async def scenario() -> None:
        for name in ("reads", "writes"):
            (tmp_path / name).mkdir()
        async with serving(tmp_path / "reads") as reading, serving(tmp_path / "writes") as writing:
            reading.safe = "DISK_FULL"
            never, ever = Source("bank"), Source("bank")
            work = [
                asyncio.create_task(scheduler(service, source).run())
                for service, source in ((reading, never), (writing, ever))
            ]
            await asked(ever, 5)
            for task in work:
                task.cancel()
            assert (never.asked, reading.head_seq, writing.head_seq) == (0, 0, 1)

    asyncio.run(scenario())


def test_an_errand_that_the_book_refuses_is_asked_once_and_the_others_go_on(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with serving(tmp_path) as service:
            heard: list[str] = []
            carry_out = service.carry_out

            async def listening(command: Command, key: str | None, *rest: object, **named: object) -> object:
                heard.append(str(key))
                return await carry_out(command, key, *rest, **named)  # type: ignore[arg-type]

            service.carry_out = listening  # type: ignore[method-assign,assignment]
            good = Source("bank")
            calls = 0

            def bad(_connection: Connection, _now: dt.datetime, _limit: int) -> Sequence[Errand]:
                nonlocal calls
                calls += 1
                return [errand("close:nothing", closing("nothing"))]

            made = Scheduler(
                service, service.readers, NoRecorder(), QUICK, Rulings(), (bad, good), clock=lambda: NOW
            )
            work = asyncio.create_task(made.run())
            await asked(good, 5)
            work.cancel()
            assert heard.count("close:nothing") == 1
            assert calls >= 5
            assert service.head_seq == 1

    asyncio.run(scenario())


def test_a_suspect_errand_waits_for_its_trial_with_its_case_filed_and_the_others_go_on(
    tmp_path: Path,
) -> None:
    async def scenario() -> None:
        async with serving(tmp_path) as service:
            cases = tmp_path / "cases"
            rulings = Rulings(cases=cases)
            key = f"open:bank:{NOW:%Y}"
            rulings.quarantine.rules = msgspec.structs.replace(
                rulings.quarantine.rules, suspects=frozenset({name_of(key)})
            )
            source = Source("bank", "food")
            work = asyncio.create_task(scheduler(service, source, rulings=rulings).run())
            await asked(source, 3)
            work.cancel()
            assert service.head_seq == 1  # the other one
            case = json.loads((cases / f"{name_of(key)}.json").read_bytes())
            assert (case["source"], case["key"]) == ("scheduler", key)
            assert base64.b64decode(case["case"]["request"]["body"]) == b'{"a": 1}'

    asyncio.run(scenario())


def test_a_round_that_stands_still_is_left_behind_and_begun_anew(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with serving(tmp_path) as service:
            source = Source()
            made = scheduler(service, source)
            work = asyncio.create_task(made.run())
            await asked(source, 1)
            made.stall()
            await until(lambda: made._turns.is_busy and not made._turns._stalls)
            before = source.asked
            source.names = ("bank",)
            made.begin_anew()
            await asked(source, before + 2)
            await until(lambda: service.head_seq == 1)
            work.cancel()

    asyncio.run(scenario())


def kept(*ages: dt.timedelta) -> list[str]:
    names = [copy_name(NOW - age, 5) for age in ages]
    return [*names, *(name + SUFFIX for name in names)]


def test_a_backup_is_due_when_the_newest_proven_one_is_a_day_old_or_of_a_time_to_come() -> None:
    assert is_due([], NOW, DAY)
    assert is_due(kept(DAY, 3 * DAY), NOW, DAY)
    assert not is_due(kept(DAY - dt.timedelta(seconds=1), 3 * DAY), NOW, DAY)
    assert is_due([copy_name(NOW, 5)], NOW, DAY)  # one that was never proven
    assert is_due(kept(-2 * DAY), NOW, DAY)  # the clock was put back
    assert not is_due(kept(-dt.timedelta(minutes=5)), NOW, DAY)


def test_the_first_backup_rests_and_one_that_fails_is_tried_again_after_an_hour(tmp_path: Path) -> None:
    async def scenario() -> None:
        failed: list[str] = []
        deed = DailyBackup(tmp_path, Settings(backup_after_ms=60_000), failed.append)
        made: list[int] = []

        async def make() -> str | None:
            made.append(1)
            return "there is no ledger"

        deed._make = make  # type: ignore[method-assign]
        for minutes, count in ((0, 0), (0.9, 0), (1, 1), (30, 1), (61, 2), (121, 3)):
            await deed(NOW + dt.timedelta(minutes=minutes))
            assert len(made) == count
        assert failed == ["there is no ledger"] * 3

    asyncio.run(scenario())
