"""What is on record of an incident that does not end as it should: waiting for a person, or its guard dies too."""

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest

from postmortem import bundle, cli
from tests import stores
from tests.integration import test_full_disk as full_disk
from tests.integration.conftest import MakeHouse
from tests.integration.house import START_S, House
from tests.waiting import until

HALF, EMPTY = "0199a000-0000-7000-8000-00000000000d", "0199a000-0000-7000-8000-00000000000e"


def story_of(house: House, incident_id: str) -> dict[str, Any]:
    story = cli.show_incident(house.folders.incidents, incident_id)
    assert isinstance(story, dict), story
    return story


def text_of(house: House, incident_id: str, name: str) -> str:
    data = bundle.read_file(house.folders.incidents / incident_id, name)
    return "" if isinstance(data, bundle.BundleFailed) else data.decode()


def has_report(house: House, incident_id: str) -> bool:
    told = bundle.read_manifest(house.folders.incidents / incident_id)  # written last
    return isinstance(told, bundle.Manifest) and "report.md" in told.files


def test_an_incident_that_waits_for_a_person_names_its_requests_and_what_it_waits_for(
    new_house: MakeHouse,
) -> None:
    house = new_house(actions={"DB_LOCKED": ["SNAPSHOT", "SEND_ALERT", "AWAIT_OPERATOR"]}).up()
    house.open_accounts()
    with stores.locked(house.data), ThreadPoolExecutor(1) as client:
        house.hit("core")
        held = client.submit(house.book, "held")
        status = house.until(lambda s: s["phase"] == "FATAL", "the guard to stop trying")
        assert held.result().status == 503
        incident = status["last_incident"]
        until(lambda: story_of(house, incident)["requests"], "the requests to be on record", START_S)
        until(lambda: "/api/ledger/transactions" in text_of(house, incident, "report.md"), "the report")
        story = story_of(house, incident)
    assert (story["diagnosis"], story["waits_for"]) == ("KILLED_FROM_OUTSIDE", "DB_LOCKED")
    assert [(one["method"], one["path"]) for one in story["requests"]] == [
        ("POST", "/api/ledger/transactions")
    ]
    assert story["summary"].endswith(
        "waits for a person: DB_LOCKED — another program holds the ledger's lock."
    )
    assert "hardcore resume" in text_of(house, incident, "report.md")


def test_an_incident_whose_guard_died_is_closed_by_the_next_guard(new_house: MakeHouse) -> None:
    house = new_house().up()
    incidents = house.folders.incidents

    def opened() -> list[bundle.Found]:
        return [one for one in bundle.find_bundles(incidents) if not (one.path / bundle.FACTS).exists()]

    with stores.locked(house.data):  # so that it can't end before the guard does
        house.hit("core")
        (first,) = until(lambda: [one for one in opened() if not one.partial], "its evidence", START_S)
        (incidents / f".{HALF}.partial").mkdir()
        (incidents / f".{HALF}.partial" / "log.txt").write_text("the last line\n")
        (incidents / f".{EMPTY}.partial").mkdir()
        house.hit("sentinel")
        left = {first.id, HALF, EMPTY}
        until(lambda: left.isdisjoint(one.id for one in opened()), "what was left open to be closed", START_S)
        until(lambda: all(has_report(house, one) for one in (first.id, HALF)), "reports", START_S)
    for incident in (first.id, HALF):
        story = story_of(house, incident)
        assert story["closed_at"] is not None
        assert story["outcome"] == "abandoned", "nobody saw how it ended, so no other word is true"
        assert "the guard itself ended before it" in story["summary"]
        assert set(story["bundle"]["faults"]) <= {
            "its evidence was never finished",
            "'observations.jsonl' is not in its manifest",  # the guard died between the two
            "'opening.json' is not in its manifest",  # as above
        }
    assert story_of(house, first.id)["core"]["pid"] is not None
    assert text_of(house, HALF, "log.txt") == "the last line\n"
    assert not list(incidents.glob(".*"))
    house.running()


@pytest.mark.skipif(not full_disk.own_mounts(), reason="no mounts of one's own here: that needs root")
def test_facts_and_evidence_that_a_full_disk_refused_are_in_their_place_when_there_is_room(
    new_house: MakeHouse,
) -> None:
    house = new_house()
    disk = full_disk.begin_on_a_small_disk(house)
    (disk / "ballast").unlink(missing_ok=True)  # freed at the fence, it would make room for the evidence too
    full_disk.fill(disk)
    house.hit("core")
    status = house.until(lambda s: s["safe"] == "DISK_FULL" and s["core"]["ready"], "a core that reads only")
    facts = disk / "incidents" / status["incident"] / bundle.FACTS
    assert not facts.exists()
    sheltered = house.folders.shelter / status["incident"]
    until((sheltered / "recorder.bin").exists, "the evidence to be kept elsewhere", START_S)
    (disk / "filler").unlink()
    until(facts.exists, "the facts to be tried again", 2 * START_S)
    until((facts.parent / "report.md").exists, "the report", START_S)
    assert (facts.parent / "recorder.bin").exists()
    assert not sheltered.exists()
    assert bundle.verify_bundle(facts.parent) == []
