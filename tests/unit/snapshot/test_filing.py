import asyncio
import json
import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from hardcore.host import clock
from hardcore.model import verdicts
from hardcore.model.actions import AddAudit, DeathNote, Incident
from hardcore.model.observations import LedgerAudited, RequestOutcome, RequestsSettled
from hardcore.model.trials import AddTrials, Ordeal, TrialNote
from hardcore.model.verdicts import Colour, Diagnosis, Grade
from hardcore.snapshot import writer
from hardcore.snapshot.filing import Filing
from postmortem import bundle, reading

ID = "0199a000-0000-7000-8000-00000000000f"


class Hands:
    """Hands that work at once and keep what they note."""

    def __init__(self, on_note: Callable[[], None]) -> None:
        self.halted = asyncio.Event()
        self.noted: list[dict[str, object]] = []
        self.reported: list[str] = []
        self._on_note = on_note

    async def in_hand(self, work: Callable[..., Any], *args: Any) -> Any:
        return work(*args)

    def note(self, kind: str, **particulars: object) -> None:
        self.noted.append({"kind": kind, **particulars})
        self._on_note()

    async def report(self, folder: Path) -> None:
        self.reported.append(folder.name)


def incident() -> Incident:
    return Incident(
        id=ID,
        opened_ns=1,
        diagnosis=Diagnosis.KILLED_FROM_OUTSIDE,
        grade=Grade.CERTAIN,
        evidence=(),
        planned=False,
        drill=None,
        reason="",
        life=1,
        epoch=1,
        exit=None,
        last_words=None,
        in_flight=(),
        suspects=(),
        timeline=(("fault", 1), ("closed", 2)),
        deaths=(),
        requests=(),
        proof=None,
        witness=None,
        next_epoch=None,
        audit=None,
        outcome="manual",
        waits_for=Diagnosis.DB_LOCKED,
        closed_ns=2,
    )


def settled(*paths: str) -> RequestsSettled:
    requests = tuple(RequestOutcome("POST", path, "", "not_done", 503, 10) for path in paths)
    return RequestsSettled(3, ID, requests)


def facts(folder: Path) -> dict[str, Any]:
    data = bundle.read_file(folder, bundle.FACTS)
    assert isinstance(data, bytes), data
    told: dict[str, Any] = json.loads(data)
    return told


def test_facts_that_could_not_be_written_are_tried_again(tmp_path: Path) -> None:
    place = tmp_path / "incidents"
    place.write_bytes(b"a file where the folder should be")

    async def close() -> Hands:
        hands = Hands(lambda: place.unlink() if place.is_file() else None)
        await Filing(place, hands, hands.report, (0.0,)).close(incident(), None, "", [])
        return hands

    hands = asyncio.run(close())
    assert "failed" in hands.noted[0]
    assert facts(place / ID)["waits_for"] == "DB_LOCKED"
    assert hands.reported == [ID]


def test_an_incident_says_which_code_schema_and_policy_it_met(tmp_path: Path) -> None:
    ran = {"build": "ab" * 8, "schema": 4, "policy_sha256": "cd" * 32}

    async def both() -> None:
        hands = Hands(lambda: None)
        filing = Filing(tmp_path, hands, hands.report, (), ran=lambda _: ran)
        await filing.open(going_on(), 7, "n", [])
        assert reading.all_reports(tmp_path)[0].incident.versions.build == ran["build"]
        await filing.close(incident(), 7, "n", [])

    asyncio.run(both())
    told = facts(tmp_path / ID)
    assert {name: told[name] for name in ran} == ran
    assert reading.all_reports(tmp_path)[0].incident.versions.schema == 4


def going_on(*deaths: DeathNote) -> Incident:
    return replace(
        incident(),
        evidence=(verdicts.Testimony("pidfd", Colour.RED, "the core ended by SIGKILL"),),
        timeline=(("fault", 1),),
        deaths=deaths,
        outcome="open",
        waits_for=None,
        closed_ns=0,
    )


def test_an_incident_that_goes_on_says_what_is_known_of_it(tmp_path: Path) -> None:
    async def begin() -> None:
        hands = Hands(lambda: None)
        await Filing(tmp_path, hands, hands.report, ()).open(going_on(), 7, "n", [])
        assert hands.reported == []

    asyncio.run(begin())
    (one,) = reading.all_reports(tmp_path)
    told = one.incident
    assert (told.diagnosis, told.grade, told.outcome) == ("KILLED_FROM_OUTSIDE", "certain", "open")
    assert (told.opened_at is not None, told.closed_at, told.pid) == (True, None, 7)
    assert [words.text for words in told.evidence] == ["the core ended by SIGKILL"]
    assert writer.find_abandoned(tmp_path), "it is open: only a guard that is gone has left it so"


def test_what_was_known_of_it_is_not_lost_with_its_guard(tmp_path: Path) -> None:
    hands = Hands(lambda: None)
    asyncio.run(Filing(tmp_path, hands, hands.report, ()).open(going_on(), None, "", []))
    (found,) = writer.find_abandoned(tmp_path)
    asyncio.run(Filing(tmp_path, hands, hands.report, ()).close_abandoned([found]))
    told = facts(tmp_path / ID)
    assert (told["diagnosis"], told["outcome"], told["closed_at"] is not None) == (
        "KILLED_FROM_OUTSIDE",
        "abandoned",
        True,
    )
    assert [line["kind"] for line in told["evidence"]] == ["pidfd", "guard"]


def test_the_report_that_a_dead_guard_did_not_come_to_is_made_by_the_next_one_once(tmp_path: Path) -> None:
    async def closed_by_one_that_dies() -> None:
        async def dies(_: Path) -> None:
            raise asyncio.CancelledError

        with suppress(asyncio.CancelledError):
            await Filing(tmp_path, Hands(lambda: None), dies, ()).close(incident(), 7, "n", [])

    asyncio.run(closed_by_one_that_dies())
    assert not writer.find_abandoned(tmp_path), "it is closed"
    hands = Hands(lambda: None)
    asyncio.run(Filing(tmp_path, hands, hands.report, ()).close_abandoned([]))
    assert hands.reported == [ID]
    (tmp_path / ID / bundle.REPORT).write_text("# told")
    asyncio.run(Filing(tmp_path, hands, hands.report, ()).close_abandoned([]))
    assert hands.reported == [ID]


def test_an_opening_that_no_disk_takes_keeps_no_closing_waiting(tmp_path: Path) -> None:
    place = tmp_path / "incidents"
    place.write_bytes(b"a file where the folder should be")

    async def work() -> None:
        hands = Hands(lambda: None)
        filing = Filing(place, hands, hands.report, (3600.0,))
        opening = asyncio.create_task(filing.open(going_on(), None, "", []))
        await asyncio.sleep(0)
        assert not opening.done()
        place.unlink()
        await filing.close(incident(), None, "", [])
        opening.cancel()

    asyncio.run(work())
    assert facts(place / ID)["outcome"] == "manual"
    assert not bundle.is_there(place / ID / bundle.OPENING)


def test_of_an_incident_that_goes_on_the_newest_is_told(tmp_path: Path) -> None:
    async def twice() -> None:
        hands, taken = Hands(lambda: None), asyncio.Event()
        filing = Filing(tmp_path, hands, hands.report, ())
        first = asyncio.create_task(filing.open(going_on(), None, "", [taken]))
        await asyncio.sleep(0)
        await filing.open(going_on(DeathNote(1, Diagnosis.CRASHED, None)), None, "", [])
        taken.set()
        await first

    asyncio.run(twice())
    (one,) = reading.all_reports(tmp_path)
    assert len(one.incident.deaths) == 1


def test_a_guard_that_ends_waits_for_no_pause(tmp_path: Path) -> None:
    place = tmp_path / "incidents"
    place.write_bytes(b"")

    async def close() -> Hands:
        hands = Hands(lambda: None)
        hands.halted.set()
        await Filing(place, hands, hands.report, (3600.0, 3600.0)).close(incident(), None, "", [])
        return hands

    hands = asyncio.run(close())
    assert len(hands.noted) == 1
    assert hands.reported == []


def test_requests_that_come_late_join_the_facts_in_order_and_up_to_a_maximum(tmp_path: Path) -> None:
    async def settle() -> Hands:
        hands = Hands(lambda: None)
        filing = Filing(tmp_path, hands, hands.report, ())
        evidence = asyncio.Event()
        async with asyncio.TaskGroup() as group:
            group.create_task(filing.close(incident(), None, "", [evidence]))
            group.create_task(filing.add_late(settled("/a", "/b")))
            group.create_task(filing.add_late(settled(*["/c"] * writer.REQUESTS_MAX)))
            group.create_task(filing.add_late(RequestsSettled(3, "../elsewhere", settled("/x").requests)))
            await asyncio.sleep(0)  # all of them have begun before the evidence is there
            evidence.set()
        return hands

    hands = asyncio.run(settle())
    paths = [one["path"] for one in facts(tmp_path / ID)["requests"]]
    assert len(paths) == writer.REQUESTS_MAX
    assert paths[:3] == ["/a", "/b", "/c"]
    assert hands.reported == [ID, ID], "once when it was closed, once for all that came late"
    assert bundle.verify_bundle(tmp_path / ID) == []


def test_the_proof_of_the_whole_ledger_joins_the_facts_of_its_incident_and_waits_for_them(
    tmp_path: Path,
) -> None:
    async def settle() -> Hands:
        hands = Hands(lambda: None)
        filing = Filing(tmp_path, hands, hands.report, ())
        evidence = asyncio.Event()
        async with asyncio.TaskGroup() as group:
            group.create_task(filing.close(incident(), None, "", [evidence]))
            group.create_task(filing.add_audit(AddAudit(ID, LedgerAudited(5, 2, None, "event 5 is odd"))))
            await asyncio.sleep(0)  # both have begun before the evidence is there
            evidence.set()
        return hands

    hands = asyncio.run(settle())
    told = facts(tmp_path / ID)
    assert (told["audit"]["ok"], told["audit"]["fault"]) == (False, "event 5 is odd")
    assert told["waits_for"] == "DB_LOCKED"
    assert hands.reported == [ID, ID]


@pytest.mark.parametrize("closed", [False, True])
def test_what_came_of_its_trials_joins_the_facts_of_an_incident_whether_it_is_open_or_closed(
    tmp_path: Path, *, closed: bool
) -> None:
    order = AddTrials(ID, (TrialNote("a" * 32, "command", Ordeal.DIED, "letter", 12),))

    async def settle() -> Hands:
        hands = Hands(lambda: None)
        filing = Filing(tmp_path, hands, hands.report, (0.0,))
        await filing.open(replace(incident(), outcome="open", closed_ns=0), None, "", ())
        if not closed:
            await filing.add_trials(order)
        await filing.close(incident(), None, "", ())
        if closed:
            await filing.add_trials(order)
        return hands

    hands = asyncio.run(settle())
    (told,) = facts(tmp_path / ID)["trials"]
    assert (told["ordeal"], told["letter"], told["took_ms"]) == ("died", "letter", 12)
    assert len(hands.reported) == 1 + closed


def test_an_incident_left_open_is_closed_as_soon_as_its_folder_can_be_written(tmp_path: Path) -> None:
    assert isinstance(bundle.write_bundle(tmp_path, ID, {"log.txt": b"the last line"}, {}), Path)
    obstacle = tmp_path / ID / f".{bundle.FACTS}.{os.getpid()}.partial"  # a folder where a file is to be made
    obstacle.mkdir()

    async def close() -> Hands:
        hands = Hands(lambda: obstacle.rmdir() if obstacle.exists() else None)
        found = writer.find_abandoned(tmp_path)
        await Filing(tmp_path, hands, hands.report, (0.0,)).close_abandoned(found)
        return hands

    hands = asyncio.run(close())
    assert hands.noted[0]["failed"]
    assert hands.reported == [ID]
    told = facts(tmp_path / ID)
    assert (told["outcome"], told["opened_at"]) == ("abandoned", "2025-10-01T13:39:38.624Z")
    assert bundle.verify_bundle(tmp_path / ID) == []


def test_what_recovery_had_stopped_at_is_told_when_a_core_serves_again(tmp_path: Path) -> None:
    hands = Hands(lambda: None)

    async def filed() -> None:
        filing = Filing(tmp_path, hands, hands.report, pauses_s=())
        await filing.close(incident(), None, "", ())
        assert "served_again_at" not in facts(tmp_path / ID)
        await filing.served_again(5)

    asyncio.run(filed())
    assert facts(tmp_path / ID)["served_again_at"]
    assert facts(tmp_path / ID)["outcome"] == "manual"
    assert hands.reported == [ID, ID]


def test_the_first_core_of_a_guard_is_told_to_the_incidents_of_the_guards_before_it_once(
    tmp_path: Path,
) -> None:
    hands = Hands(lambda: None)

    async def filed() -> None:
        await Filing(tmp_path, hands, hands.report, pauses_s=()).close(incident(), None, "", ())
        later = Filing(tmp_path, hands, hands.report, pauses_s=())
        await later.served_again(5)
        told = facts(tmp_path / ID)["served_again_at"]
        await later.served_again(5_000_000_000)
        await Filing(tmp_path, hands, hands.report, pauses_s=()).served_again(9_000_000_000)
        assert facts(tmp_path / ID)["served_again_at"] == told

    asyncio.run(filed())
    assert hands.reported == [ID, ID]


def test_an_incident_that_ended_well_is_not_told_again(tmp_path: Path) -> None:
    hands = Hands(lambda: None)

    async def filed() -> None:
        filing = Filing(tmp_path, hands, hands.report, pauses_s=())
        await filing.close(replace(incident(), outcome="recovered", waits_for=None), None, "", ())
        await filing.served_again(5)

    asyncio.run(filed())
    assert "served_again_at" not in facts(tmp_path / ID)
    assert hands.reported == [ID]


NOTED = {
    "id": ID,
    "opened_at": "2026-11-21T14:08:18.000Z",
    "diagnosis": "KILLED_FROM_OUTSIDE",
    "grade": "certain",
    "planned": False,
    "deaths": [{"at": "2026-11-21T14:08:18.000Z", "diagnosis": "KILLED_FROM_OUTSIDE", "exit": {"signal": 9}}],
    "timeline": [{"at": "2026-11-21T14:08:18.000Z", "offset_ms": 0.0, "step": "fault"}],
    "evidence": [],
    "outage_ms": None,
}


@pytest.mark.parametrize("released_at", [None, "2026-11-21T14:08:18.440Z"])
def test_a_death_that_was_only_noted_beside_a_deed_is_told_with_its_outage(
    tmp_path: Path, released_at: str | None
) -> None:
    hands = Hands(lambda: None)
    filing = Filing(tmp_path, hands, hands.report, ())

    async def follow() -> None:
        found = writer.find_abandoned(tmp_path, None, ID)
        await filing.close_abandoned(found, {**NOTED, "released_at": released_at})
        await filing.served_again(clock.now_ns())

    asyncio.run(follow())
    told = facts(tmp_path / ID)
    assert (told["diagnosis"], told["outcome"]) == ("KILLED_FROM_OUTSIDE", "abandoned")
    assert told["served_again_at"] is not None
    assert told["outage_ms"] == 440.0 if released_at else told["outage_ms"] > 0
    assert writer.find_abandoned(tmp_path, None, ID) == ()


def test_an_incident_that_was_written_as_a_whole_is_not_closed_once_more(tmp_path: Path) -> None:
    hands = Hands(lambda: None)
    asyncio.run(Filing(tmp_path, hands, hands.report, ()).close(incident(), None, "", []))
    assert writer.find_abandoned(tmp_path, None, ID) == ()


def test_the_end_of_a_guard_in_the_middle_of_an_outage_names_that_outage(tmp_path: Path) -> None:
    hands = Hands(lambda: None)
    filing = Filing(tmp_path, hands, hands.report, ())
    filing.left_open = "01a20310-1"
    asyncio.run(filing.close(replace(incident(), diagnosis=Diagnosis.SENTINEL_LOST), None, "", []))
    told = facts(tmp_path / ID)
    assert told["left_open"] == "01a20310-1"
    assert "01a20310-1" in told["evidence"][-1]["text"]


@pytest.mark.parametrize("held_ms", [None, 1100])
def test_that_the_ledger_went_on_without_its_guard_is_told_only_where_its_gateway_did_too(
    tmp_path: Path, held_ms: int | None
) -> None:
    async def told() -> dict[str, Any]:
        hands = Hands(lambda: None)
        filing = Filing(tmp_path, hands, hands.report)
        filing.gateway_is_awaited()
        lost = replace(incident(), diagnosis=Diagnosis.SENTINEL_LOST, outcome="recovered", waits_for=None)
        closing = asyncio.create_task(filing.close(lost, 1, "", ()))
        filing.gateway_is_back(held_ms)
        await closing
        return facts(tmp_path / ID)

    assert asyncio.run(told())["outage_ms"] == held_ms
