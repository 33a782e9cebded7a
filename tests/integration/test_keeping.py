"""Backing up while everything is at work, going back to it, and what is refused on the way."""

from pathlib import Path

from tests.integration.clients import at_work
from tests.integration.house import House, run_cli
from tests.waiting import until


def test_a_backup_made_under_load_is_gone_back_to_elsewhere_and_holds_what_was_booked_before_it(
    house: House, tmp_path: Path
) -> None:
    with at_work(house, 2, "kept", patient=False) as clients:
        until(lambda: len(clients.told) > 5, "the load to run")
        before = house.status()["core"]["last_seq"]
        made = house.cli("--json", "backup", "--keep", "2")
        assert made.code == 0, made
    assert made.told["events"] >= before

    refused = house.cli("restore", made.told["path"])
    assert refused.code == 1
    assert "hardcore down" in refused.err

    folder = tmp_path / "back"
    again = run_cli("--data", str(folder), "--json", "restore", made.told["path"], env=house.environment())
    assert again.code == 0, again
    proven = run_cli("--data", str(folder), "--json", "verify", env=house.environment())
    assert (proven.told["ok"], proven.told["events"], proven.told["head"]) == (
        True,
        made.told["events"],
        made.told["head"],
    )

    rehearsed = house.cli("--json", "drill", "restore")
    assert rehearsed.code == 0, rehearsed
    assert rehearsed.told["restore"]["backup"] == Path(made.told["path"]).name
