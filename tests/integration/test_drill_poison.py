"""`hardcore drill poison` and `hardcore drill restore`, as a person runs them."""

import json

from tests.integration.house import House
from tests.waiting import until


def drills(house: House) -> list[dict[str, object]]:
    """What the drills have left for the investigators, or what those have taken in."""
    found = [json.loads(path.read_text("utf-8")) for path in house.folders.spool.glob("*.json")]
    return [one for one in found if one["type"] == "drill"]


def test_the_drill_shows_one_death_a_letter_and_a_refusal(house: House) -> None:
    done = house.cli("--json", "drill", "poison", "--yes")
    assert (done.code, done.told["ok"]) == (0, True), done
    assert (done.told["status"], done.told["story"]["drill"]) == (422, "poison")
    rules = house.order("quarantine")["quarantine"]["rules"]
    assert [rule["id"] for rule in rules] == [done.told["letter"]]
    assert not house.folders.armed.exists(), "nobody dies of it any more"


def test_a_restore_can_be_drilled_beside_the_core_that_serves(house: House) -> None:
    core = house.running()["core"]["pid"]
    done = house.cli("--json", "drill", "restore")
    assert (done.code, done.told["ok"]) == (0, True), done
    assert house.status()["core"]["pid"] == core


def test_an_act_of_an_operator_is_told_to_the_investigators(house: House) -> None:
    added = house.order("rule-add", rule={"type": "deadline", "kind": "transaction.post", "limit_ms": 9000})
    assert added["ok"], added
    shown = house.order("quarantine")["quarantine"]["rules"]
    assert added["id"] in {rule["id"] for rule in shown}
    until(
        lambda: (
            any(
                json.loads(path.read_text("utf-8")).get("verb") == "rule-add"
                for path in house.folders.spool.glob("*.json")
            )
            or not list(house.folders.spool.glob("*.json"))
        ),
        "the act to be told or taken in",
    )
