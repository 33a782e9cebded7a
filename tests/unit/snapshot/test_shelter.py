"""Evidence that its disk does not take: kept elsewhere within bounds, moved home when there is room, named until then."""

import asyncio
import json
import os
from collections.abc import Callable
from pathlib import Path

from hardcore.snapshot import storing, writer
from hardcore.snapshot.filing import Filing
from hardcore.snapshot.subject import EvidenceFailed, Kept
from postmortem import bundle
from tests.unit.snapshot.test_filing import ID, Hands, facts, incident

FILES = {"recorder.bin": b"page", "stacks.json": b"[]"}


def nothing() -> None:
    pass


def filed(
    tmp_path: Path, on_report: Callable[[], None] = nothing, lost: EvidenceFailed | None = None
) -> Hands:
    """Close one incident whose evidence waits in the shelter, if it does, or was lost."""

    async def close() -> Hands:
        hands = Hands(nothing)

        async def report(folder: Path) -> None:
            await hands.report(folder)
            on_report()

        filing = Filing(tmp_path / "incidents", hands, report, (0.0,), tmp_path / "shelter")
        if lost is not None:
            filing.lose(ID, lost)
        await filing.close(incident(), None, "", [])
        return hands

    return asyncio.run(close())


def missing(tmp_path: Path) -> dict[str, str]:
    manifest = bundle.read_manifest(tmp_path / "incidents" / ID)
    assert isinstance(manifest, bundle.Manifest), manifest
    return dict(manifest.missing)


def test_evidence_that_was_lost_is_named_where_its_incident_is_told(tmp_path: Path) -> None:
    lost = EvidenceFailed("no room on the disk", None, (), 1)
    hands = filed(tmp_path, lost=lost)
    assert missing(tmp_path) == {"evidence": "no room on the disk"}
    assert hands.reported == [ID]


def test_evidence_that_came_late_after_all_is_not_told_missing(tmp_path: Path) -> None:
    late = EvidenceFailed("the disk had not taken it in time", None, (), 1, Kept.PERHAPS)
    assert isinstance(bundle.write_bundle(tmp_path / "incidents", ID, FILES, {}), Path)
    filed(tmp_path, lost=late)
    assert missing(tmp_path) == {}


def test_what_waits_in_the_shelter_is_in_the_incident_before_its_report(tmp_path: Path) -> None:
    assert isinstance(storing.shelter_life(tmp_path / "shelter", ID, FILES, {"log.txt": "none"}), Path)
    hands = filed(tmp_path)
    home = tmp_path / "incidents" / ID
    assert {name: (home / name).read_bytes() for name in FILES} == FILES
    assert missing(tmp_path) == {"log.txt": "none"}
    assert bundle.verify_bundle(home) == []
    assert list((tmp_path / "shelter").iterdir()) == []
    assert hands.reported == [ID]


def test_what_can_not_be_moved_home_is_named_until_it_is(tmp_path: Path) -> None:
    assert isinstance(storing.shelter_life(tmp_path / "shelter", ID, FILES, {}), Path)
    home = tmp_path / "incidents" / ID
    assert isinstance(bundle.write_bundle(home.parent, ID, {"log.txt": b"of another life"}, {}), Path)
    obstacle = home / f".recorder.bin.{os.getpid()}.partial"  # a folder where a file is to be made
    obstacle.mkdir()
    told = []

    def look() -> None:
        told.append(set(missing(tmp_path)))
        if obstacle.exists():
            obstacle.rmdir()

    hands = filed(tmp_path, look)
    assert told == [{storing.WAITING}, set()]
    assert hands.reported == [ID, ID]
    assert (home / "recorder.bin").read_bytes() == b"page"
    assert bundle.verify_bundle(home) == []


def test_facts_that_no_disk_took_are_told_by_the_next_guard(tmp_path: Path) -> None:
    incidents, shelter = tmp_path / "incidents", tmp_path / "shelter"
    incidents.write_bytes(b"a file where the folder should be")
    assert isinstance(storing.shelter_life(shelter, ID, FILES, {}), Path)

    async def die() -> None:
        hands = Hands(nothing)
        hands.halted.set()
        await Filing(incidents, hands, hands.report, (3600.0,), shelter).close(incident(), None, "", [])

    asyncio.run(die())
    incidents.unlink()
    found = writer.find_abandoned(incidents, shelter)
    assert [one.id for one in found] == [ID]
    hands = Hands(nothing)
    asyncio.run(Filing(incidents, hands, hands.report, (), shelter).close_abandoned(found))
    assert facts(incidents / ID)["waits_for"] == "DB_LOCKED"
    assert (incidents / ID / "recorder.bin").read_bytes() == b"page"
    assert hands.reported == [ID]
    assert writer.find_abandoned(incidents, shelter) == ()


def test_an_incident_of_which_only_sheltered_evidence_is_left_is_closed_by_the_next_guard(
    tmp_path: Path,
) -> None:
    incidents, shelter = tmp_path / "incidents", tmp_path / "shelter"
    assert isinstance(storing.shelter_life(shelter, ID, FILES, {}), Path)
    hands = Hands(nothing)
    found = writer.find_abandoned(incidents, shelter)
    asyncio.run(Filing(incidents, hands, hands.report, (), shelter).close_abandoned(found))
    assert facts(incidents / ID)["outcome"] == "abandoned"
    assert bundle.verify_bundle(incidents / ID) == []


def test_the_shelter_is_bounded_in_number_and_in_bytes(tmp_path: Path) -> None:
    for number in range(storing.SHELTERED_MAX):
        assert isinstance(storing.shelter_life(tmp_path, f"{ID}{number}", FILES, {}), Path)
    assert isinstance(storing.shelter_life(tmp_path, ID, FILES, {}), bundle.BundleFailed)
    large = {"recorder.bin": b"\0" * storing.SHELTERED_BYTES_MAX}
    assert isinstance(storing.shelter_life(tmp_path, f"{ID}0", large, {}), bundle.BundleFailed)
    assert isinstance(storing.shelter_life(tmp_path, f"{ID}0", FILES, {}), Path), "a second life of one"


def test_a_torn_bundle_in_the_shelter_is_in_nobodys_way(tmp_path: Path) -> None:
    incidents, shelter = tmp_path / "incidents", tmp_path / "shelter"
    assert isinstance(storing.shelter_life(shelter, ID, FILES, {}), Path)
    (shelter / ID / bundle.MANIFEST).write_bytes(b"\xff")
    assert storing.bring_home(shelter, incidents, ID) is None
    assert storing.sheltered(shelter) == []


def test_facts_are_tried_as_long_as_the_guard_lives(tmp_path: Path) -> None:
    place = tmp_path / "incidents"
    place.write_bytes(b"a file where the folder should be")

    async def close() -> Hands:
        hands = Hands(lambda: place.unlink() if len(hands.noted) == 20 else None)
        await Filing(place, hands, hands.report, (0.0, 0.0)).close(incident(), None, "", [])
        return hands

    hands = asyncio.run(close())
    assert hands.reported == [ID]
    assert json.loads((place / ID / bundle.FACTS).read_bytes())["id"] == ID
