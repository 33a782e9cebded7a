"""A dead letter's way back into the ledger, in a real house: set aside, tried, run once, and looked at with all of it stopped."""

import json
from pathlib import Path

import pytest

from tests.integration.house import House, transaction
from tests.integration.poisoning import armed, letter_of, rules
from tests.waiting import until


@pytest.mark.timeout(150)  # a dozen commands one after the other, on a machine that does much else
def test_a_letter_that_was_corrected_is_booked_as_another_request_and_stays_refused(
    house: House, tmp_path: Path
) -> None:
    key = armed(house)
    refused = house.ask("POST", "/api/ledger/transactions", transaction("the corrected poison"), key=key)
    assert refused.status == 422, refused
    letter = letter_of(house, key)
    until(lambda: house.cli("--json", "dlq", "show", letter).code == 0, "the letter to be in the archive")
    changed = tmp_path / "changed.json"
    changed.write_text(json.dumps(transaction("what was meant")))
    done = house.cli("--json", "dlq", "correct", letter, "--file", str(changed))
    assert (done.code, done.told["state"]) == (0, "DISCARDED"), done
    booked = house.booked()
    assert (booked.count("what was meant"), booked.count("the corrected poison")) == (1, 0)
    again = house.ask("POST", "/api/ledger/transactions", transaction("the corrected poison"), key=key)
    assert (again.status, letter in {rule["id"] for rule in rules(house)}) == (422, True)


@pytest.mark.timeout(150)  # as above
def test_a_letter_is_tried_and_run_once_and_can_be_read_with_everything_stopped(house: House) -> None:
    key = armed(house)
    refused = house.ask("POST", "/api/ledger/transactions", transaction("the poison"), key=key)
    letter = letter_of(house, key)
    assert refused.status == 422, refused

    until(lambda: house.cli("--json", "dlq", "show", letter).code == 0, "the letter to be in the archive")
    early = house.cli("--json", "dlq", "retry", letter)
    assert early.code == 1, "nothing is retried that was not tried"
    assert house.cli("dlq", "discard", letter).code == 2
    assert "the poison" not in house.booked()

    # The drill was disarmed by its conviction, so the code is as good as mended.
    tried = house.cli("--json", "dlq", "dry-run", letter)
    assert (tried.code, tried.told["dry_run"]["ordeal"]) == (0, "survived"), tried
    assert "the poison" not in house.booked(), "a dry run books nothing"

    done = house.cli("--json", "dlq", "retry", letter)
    assert (done.code, done.told["state"]) == (0, "RESOLVED"), done
    assert house.booked().count("the poison") == 1
    assert letter not in {rule["id"] for rule in rules(house)}
    again = house.ask("POST", "/api/ledger/transactions", transaction("the poison"), key=key)
    assert (again.status, house.booked().count("the poison")) == (201, 1), "it is the same one"

    tries = [one["what"] for one in house.cli("--json", "dlq", "show", letter).told["history"]]
    assert tries == ["trial", "dry-run", "retry"]
    assert house.cli("down").code == 0
    stopped = house.cli("--json", "dlq", "list", "--where", "state=RESOLVED")
    assert [one["id"] for one in stopped.told] == [letter]
    away = house.cli("dlq", "retry", "../../etc/passwd")
    assert away.code == 1
