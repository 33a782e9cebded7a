"""What a report says of a real death in a real house: whose command it was, or that it was nobody's; and its papers."""

import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.integration.house import BANK, SALARY, House
from tests.integration.poisoning import armed, house_story, letter_of, name_of
from tests.waiting import until

#: Stands in the description of the poison: on the disk it is masked, and it never leaves in an archive.
CANARY = "lantern7Qx9Canary"


@pytest.fixture(scope="module")
def shared_house(tmp_path_factory: pytest.TempPathFactory) -> Iterator[House]:
    house = House(tmp_path_factory.mktemp("culprits") / "data", {"transaction_timeout_ms": 1000})
    try:
        house.up().open_accounts()
        yield house
    finally:
        house.end()


def story_of(house: House, count: int) -> dict[str, Any]:
    incident = house.closed(count)["id"]
    folder = house.folders.incidents / incident
    until((folder / "report.md").exists, "its report")
    return house_story(house, incident)


def test_a_poison_is_named_with_its_account_and_its_transaction_and_leaves_no_secret_in_the_archive(
    house: House, tmp_path: Path
) -> None:
    key, before = armed(house), len(house.incidents())
    body = {
        "date": "2026-11-21",
        "description": f"password {CANARY}",
        "postings": [
            {"account": BANK, "amount": "1", "currency": "KRW"},
            {"account": SALARY, "amount": "-1", "currency": "KRW"},
        ],
    }
    refused = house.ask("POST", "/api/ledger/transactions", body, key=key)
    letter = letter_of(house, key)
    assert refused.body["letter"] == letter, refused
    incident = house.closed(before + 1)["id"]
    until(lambda: house_story(house, incident)["trials"], "the trials in the incident")
    story = house_story(house, incident)
    culprit = story["culprit"]
    assert (culprit["confidence"], set(culprit["account_ids"])) == ("certain", {BANK, SALARY})
    slot = next(one for one in story["in_flight"] if one["key_hash"] == name_of(key))
    assert culprit["transaction_id"] == slot["transaction_id"]
    assert "poison_died" in {finding["rule"] for finding in story["findings"]}

    done = house.cli("--json", "incidents", "export", incident, "--out", str(tmp_path / "incident.zip"))
    assert (done.code, done.told["ok"]) == (0, True), done
    with zipfile.ZipFile(tmp_path / "incident.zip") as archive:
        assert {"report.html", "contents.txt"} <= set(archive.namelist())
        told = [archive.read(name) for name in archive.namelist()]
    assert not [one for one in told if CANARY.encode() in one]


def test_the_same_death_again_is_known_as_the_same(house: House) -> None:
    stories = []
    for _ in range(2):
        before = len(house.incidents())
        assert house.order("drill", fault="slow-tx", yes=True)["ok"]
        stories.append(story_of(house, before + 1))
        house.running()
    first, second = stories
    assert first["culprit"]["account_ids"] == second["culprit"]["account_ids"] == ["system:drill"]
    assert first["fingerprint"] == second["fingerprint"]
    assert second["why"][0] == "diagnosis TRANSACTION_TIMEOUT"
    assert second["repetition"] == {"count": first["repetition"]["count"] + 1, "last": first["id"]}
    policy = next(change for change in second["changes"] if change["what"] == "policy")
    assert policy["before"] == policy["now"], "nobody has changed it"
