"""Folders moved, copied, removed and misnamed under a house: it comes back, or says what is wrong."""

import shutil
import signal
import sys
from pathlib import Path

import pytest

from tests.integration.clients import assert_exactly_once, at_work
from tests.integration.conftest import MakeHouse
from tests.integration.house import House
from tests.waiting import until


def counted(house: House, mark: str) -> int:
    return sum(mark in line for line in house.processes().values())


def test_a_folder_with_spaces_and_korean_letters_is_a_folder_like_any_other(new_house: MakeHouse) -> None:
    house = new_house()
    house.data = house.data.with_name("우리 집 가계부 'x' $HOME \"y\"")
    house.up()
    house.open_accounts()
    house.hit("core")
    assert house.book("in-hangul").status == 201
    assert house.closed(1)["outcome"] == "recovered"
    assert house.cli("down").code == 0
    assert house.cli("--json", "verify").told["ok"]


def refused(house: House) -> None:
    """Wait until the ledger is taken for damaged: it can be read, and a person is asked."""
    told = house.until(
        lambda s: s["safe"] == "STORE_CORRUPT" and s["core"]["ready"], "a core that reads only"
    )
    assert (told["state"], told["waits_for"]) == ("MANUAL_INTERVENTION", "STORE_CORRUPT")
    house.url = told["url"]


def test_a_moved_data_folder_is_found_whole_where_it_is_now(new_house: MakeHouse) -> None:
    house = new_house().up()
    house.open_accounts()
    assert house.book("before-the-move").status == 201
    assert house.cli("down").code == 0
    old_run = house.folders.run
    house.data = house.data.rename(house.data.with_name("moved"))
    house.up()
    assert house.folders.run != old_run
    assert house.booked() == ["before-the-move"]


@pytest.mark.in_a_file
def test_an_older_ledger_put_back_is_written_to_only_when_the_operator_says_so(new_house: MakeHouse) -> None:
    house = new_house().up()
    house.open_accounts()
    assert house.book("in-the-copy").status == 201
    assert house.cli("down").code == 0
    kept = house.data.with_name("kept.db")
    shutil.copyfile(house.data / "ledger.db", kept)
    house.up()
    assert house.book("after-the-copy").status == 201
    assert house.cli("down").code == 0
    shutil.copyfile(kept, house.data / "ledger.db")

    house.begin()
    refused(house)
    assert "docs/recover.md" in house.cli("status").out
    assert house.booked() == ["in-the-copy"]
    assert house.book("and-on").status == 503
    assert house.cli("resume").code == 1, "a plain resume must not write to what lost an acknowledged record"
    assert house.cli("resume", "--accept-ledger").code == 0
    assert house.booked() == ["in-the-copy"]
    assert house.book("and-on").status == 201


def test_a_data_folder_removed_and_begun_anew_at_the_same_path_is_a_new_ledger(new_house: MakeHouse) -> None:
    house = new_house().up()
    house.open_accounts()
    assert house.book("of-the-old-ledger").status == 201
    old_run = house.folders.run
    assert house.cli("down").code == 0
    shutil.rmtree(house.data)
    house.up()
    assert house.folders.run == old_run
    assert house.booked() == []
    house.open_accounts()
    assert house.book("of-the-new-ledger").status == 201
    house.hit("core")
    house.hit("sentinel")
    house.running()
    assert house.booked() == ["of-the-new-ledger"]


@pytest.mark.in_a_file
def test_a_ledger_that_vanished_from_its_data_folder_is_never_replaced_by_an_empty_one(
    new_house: MakeHouse,
) -> None:
    house = new_house().up()
    house.open_accounts()
    assert house.cli("down").code == 0
    for path in house.data.glob("ledger.db*"):
        path.unlink()
    house.begin()
    told = house.until(lambda status: status["phase"] == "FATAL", "the refusal of an empty ledger")
    assert told["waits_for"] == "STORE_CORRUPT"


@pytest.mark.in_a_file
def test_a_whole_data_folder_put_back_from_a_copy_is_written_to_only_when_the_operator_says_so(
    new_house: MakeHouse,
) -> None:
    house = new_house().up()
    house.open_accounts()
    assert house.book("in-the-copy").status == 201
    assert house.cli("down").code == 0
    kept = house.data.with_name("kept")
    shutil.copytree(house.data, kept, symlinks=True)
    house.up()
    assert house.book("after-the-copy").status == 201
    assert house.cli("down").code == 0
    shutil.rmtree(house.data)
    kept.rename(house.data)

    house.begin()
    refused(house)
    assert house.cli("resume", "--accept-ledger").code == 0
    assert house.booked() == ["in-the-copy"]


@pytest.mark.in_a_file
def test_an_older_ledger_that_was_accepted_is_served_by_the_next_guard_too(new_house: MakeHouse) -> None:
    house = new_house().up()
    house.open_accounts()
    assert house.book("in-the-copy").status == 201
    assert house.cli("down").code == 0
    kept = house.data.with_name("kept.db")
    shutil.copyfile(house.data / "ledger.db", kept)
    house.up()
    assert [house.book(f"after-the-copy-{number}").status for number in range(5)] == [201] * 5
    assert house.cli("down").code == 0
    shutil.copyfile(kept, house.data / "ledger.db")
    house.begin()
    refused(house)
    assert house.cli("resume", "--accept-ledger").code == 0
    before = house.running()

    guard = house.hit("sentinel")
    until(lambda: guard.gone, "the guard to be gone")
    told = house.until(
        lambda s: s["phase"] in {"FATAL", "RUNNING"} and s["sentinel"]["pid"] != guard.pid, "the next guard"
    )
    assert (told["phase"], told["safe"]) == ("RUNNING", None)
    assert told["core"]["epoch"] == before["core"]["epoch"], "it goes on with the core that serves"
    assert house.booked() == ["in-the-copy"]


def test_a_copy_lives_beside_its_original_and_neither_touches_the_other(
    house: House, new_house: MakeHouse
) -> None:
    before = house.status()
    copy = new_house()
    shutil.copytree(house.data, copy.data, symlinks=True)
    copy.up()
    assert copy.folders.run != house.folders.run
    assert copy.cli("down").code == 0
    after = house.status()
    assert (after["core"]["pid"], after["sentinel"]["pid"]) == (
        before["core"]["pid"],
        before["sentinel"]["pid"],
    )


def up_in_a_session(house: House, runtime: Path) -> None:
    """Start it as a login session does: with a runtime folder that no other environment names."""
    runtime.mkdir(mode=0o700)
    policy = str(house.settle_policy())
    argv = [sys.executable, "-m", "hardcore.cli", "--data", str(house.data)]
    house.begin_as(
        ["env", f"XDG_RUNTIME_DIR={runtime}", *argv, "up", "--port", "0", "--policy", policy],
    )
    until((house.data / "run").is_symlink, "the link to the run folder")
    house.running()
    assert house.folders.run.parent == runtime


def test_one_data_folder_has_one_guard_from_whatever_environment_it_is_asked(new_house: MakeHouse) -> None:
    house = new_house()
    up_in_a_session(house, house.data.with_name("r"))
    before = house.status()
    second = house.cli("up", "--port", "0")
    assert second.code == 1
    assert house.url in second.err
    told = house.cli("--json", "status").told
    assert (told["state"], told["core"]["pid"]) == ("OPERATIONAL", before["core"]["pid"])
    assert counted(house, "-m core serve") == 1
    assert house.cli("down").code == 0
    until(lambda: not house.processes(), "everything to be stopped")


def test_a_guard_that_nothing_leads_to_is_not_joined_by_a_second(new_house: MakeHouse) -> None:
    house = new_house()
    up_in_a_session(house, house.data.with_name("r"))
    house._runs.add(house.folders.run)
    link = house.data / "run"
    run = link.readlink()
    launcher = house.hold_pid(house.status()["launcher"]["pid"])
    link.unlink()
    assert "hardcore" in house.cli("up", "--port", "0").err
    launcher.hit(signal.SIGKILL)
    until(lambda: launcher.gone, "the launcher to be gone")
    assert house.cli("up", "--port", "0").code == 1
    assert counted(house, "hardcore.runtime") == 1
    link.symlink_to(run)
    assert house.cli("down").code == 0


def test_a_runtime_folder_that_goes_with_its_session_is_replaced_and_nothing_is_lost(
    new_house: MakeHouse,
) -> None:
    house = new_house()
    runtime = house.data.with_name("r")
    up_in_a_session(house, runtime)
    house.open_accounts()
    house._runs.add(house.folders.run)
    sentinel, core = house.hold("sentinel"), house.hold("core")
    shutil.rmtree(runtime)
    runtime.write_text("nobody can make a folder here any more")
    until(lambda: sentinel.gone, "the sentinel nobody can reach to make way")
    house.running()
    assert core.gone
    assert house.folders.run.parent != runtime
    assert house.book("after-the-session").status == 201
    assert counted(house, "-m core serve") == 1
    until(lambda: counted(house, "hardcore.crisis") == 1, "one gateway")
    assert house.cli("down").code == 0


def test_a_run_folder_removed_under_the_living_is_made_anew_and_nothing_is_lost(house: House) -> None:
    house.open_accounts()
    sentinel = house.hold("sentinel")
    with at_work(house, 2, "run-removed") as clients:
        until(lambda: len(clients.told) > 20, "the load to run")
        shutil.rmtree(house.folders.run)
        until(lambda: sentinel.gone, "the sentinel nobody can reach to make way")
        house.running()
        told = len(clients.told)
        until(lambda: len(clients.told) > told + 20, "answers again")
    assert {told.status for told in clients.told} == {201}
    assert_exactly_once(house, clients)
    assert counted(house, "-m core serve") == 1
    assert counted(house, "hardcore.runtime") == 1


def test_down_after_the_run_folder_was_removed_stops_everything(new_house: MakeHouse) -> None:
    house = new_house().up()
    shutil.rmtree(house.folders.run)
    assert house.cli("down").code == 0
    until(lambda: not house.processes(), "everything to be stopped")
    assert house.cli("--json", "status").told["wanted"] == "DOWN"


def test_a_data_folder_taken_away_under_the_living_is_never_replaced_by_an_empty_ledger(
    new_house: MakeHouse,
) -> None:
    house = new_house(max_restart_count=2).up()
    house.open_accounts()
    assert house.book("not-forgotten").status == 201
    aside = house.data.rename(house.data.with_name("aside"))
    house.hit("core")
    status = house.until(lambda s: s["phase"] == "FATAL", "the guard to stop trying")
    assert status["state"] == "MANUAL_INTERVENTION"
    assert house.book("lost-if-taken", timeout_s=20).status == 503
    until(lambda: not counted(house, "postmortem"), "the report to be written, if it can be")
    if house.data.exists():
        house.data.rename(house.data.with_name("what-the-guard-wrote"))
    aside.rename(house.data)
    assert house.order("resume")["changed"]
    house.running()
    assert house.booked() == ["not-forgotten"]


def test_a_log_that_can_not_be_written_stops_nothing(new_house: MakeHouse) -> None:
    house = new_house().up()
    house.open_accounts()
    log = house.folders.logs / "sentinel.log"
    log.unlink()
    log.mkdir()
    house.hit("core")
    assert house.book("without-a-log").status == 201
    assert house.closed(1)["outcome"] == "recovered"


def test_incidents_that_can_not_be_written_keep_no_core_from_coming_back(new_house: MakeHouse) -> None:
    house = new_house().up()
    house.open_accounts()
    shutil.rmtree(house.folders.incidents)
    house.folders.incidents.write_text("in the way")
    for number in (signal.SIGKILL, signal.SIGSTOP):
        old = house.hit("core", number)
        assert house.book(f"without-evidence-{number}").status == 201
        assert old.gone
        house.running()


def test_a_core_log_that_can_not_be_opened_is_said_and_healed(new_house: MakeHouse) -> None:
    house = new_house(max_restart_count=2).up()
    house.open_accounts()
    log = house.folders.logs / "core.log"
    log.unlink()
    log.mkdir()
    house.hit("core")
    house.until(lambda s: s["phase"] == "FATAL", "the guard to stop trying")
    story = house.closed(1)
    assert any("no process could be started" in fact["text"] for fact in story["evidence"]), story["evidence"]
    log.rmdir()
    assert house.cli("resume").code == 0
    assert house.book("the-log-is-back").status == 201
