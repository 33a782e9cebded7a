"""What must not be served is not served: a damaged store, a locked one, a loop of deaths. A person is asked."""

import json
import os
import shutil
import sqlite3
import threading
from contextlib import closing

import pytest

from tests import stores
from tests.integration.conftest import MakeHouse
from tests.integration.house import House
from tests.waiting import until

#: A policy that has a lock of somebody else's wait for a person.
A_PERSON = {"DB_LOCKED": ["SEND_ALERT", "SNAPSHOT", "AWAIT_OPERATOR"]}


def stopped_with_records(house: House) -> None:
    """Book three transactions and stop everything."""
    house.up()
    house.open_accounts()
    for number in range(3):
        assert house.book(f"record-{number}").status == 201
    assert house.cli("down").code == 0


def flipped(seq: int) -> str:
    return f"UPDATE event SET body = hash WHERE seq = {seq}"


def refused_at_once(house: House) -> None:
    """Nothing is served, and nobody waits for it: the hold would be 25 s."""
    status = house.until(lambda s: s["phase"] == "FATAL", "the guard to stop trying")
    assert (status["state"], status["core"]["pid"]) == ("MANUAL_INTERVENTION", None)
    house.url = status["url"]
    house.until(lambda s: s["gateway"]["pid"], "a gateway")
    answer = until(lambda: house.book("refused", timeout_s=10), "an answer")
    assert (answer.status, answer.outcome) == (503, "not_done")
    assert house.ask("GET", "/readyz").status == 503
    assert house.cli("status").code == 4
    assert not any("-m core serve" in line for line in house.processes().values())


def read_only_at_once(house: House) -> None:
    """It can be read, nothing is entered, a person is called, and nobody waits for it: the hold would be 25 s."""
    status = house.until(
        lambda s: s["safe"] == "STORE_CORRUPT" and s["core"]["ready"], "a core that reads only"
    )
    assert (status["state"], status["waits_for"]) == ("MANUAL_INTERVENTION", "STORE_CORRUPT")
    house.url = status["url"]
    house.until(lambda s: s["gateway"]["pid"], "a gateway")
    answer = until(lambda: house.book("refused", timeout_s=10), "an answer")
    assert (answer.status, answer.outcome) == (503, "not_done")
    assert house.ask("GET", "/api/ledger/accounts").status == 200
    assert house.ask("GET", "/readyz").status == 503
    assert house.cli("status").code == 4


def test_a_ledger_with_a_flipped_byte_is_only_read_and_the_place_is_named(new_house: MakeHouse) -> None:
    house = new_house()
    stopped_with_records(house)
    stores.tamper(house.data, flipped(5))
    house.begin()
    read_only_at_once(house)
    story = house.closed(1)
    assert (story["diagnosis"], story["outcome"]) == ("STORE_CORRUPT", "safe_mode")
    assert "event 5" in str(story["core"]["last_words"]), story
    assert "5" in house.cli("verify").err


def test_a_flipped_byte_before_the_last_witness_is_found_after_a_reboot(new_house: MakeHouse) -> None:
    house = new_house()
    stopped_with_records(house)
    stores.tamper(house.data, flipped(4))
    shown = house.cli("verify")
    assert shown.code == 1
    assert "4" in shown.err
    shutil.rmtree(house.folders.run)
    house.begin()
    read_only_at_once(house)
    assert house.closed(1)["diagnosis"] == "STORE_CORRUPT"


def test_a_ledger_that_lost_its_last_commit_is_only_read(new_house: MakeHouse) -> None:
    house = new_house().up()
    house.open_accounts()
    assert house.book("soon-lost").status == 201
    core, sentinel = house.hold("core"), house.hold("sentinel")
    assert house.launcher is not None
    house.launcher.kill()
    house.launcher.wait(10)
    sentinel.hit(9)
    core.hit(9)
    until(lambda: core.gone and sentinel.gone, "both to be gone")
    stores.tamper(
        house.data,
        "DELETE FROM idempotency WHERE seq = 3",
        "DELETE FROM posting WHERE seq = 3",
        "DELETE FROM booking WHERE seq = 3",
        "DELETE FROM event WHERE seq = 3",
        "UPDATE account SET posted = 0",
        "UPDATE meta SET head_seq = 2, head_hash = (SELECT hash FROM event WHERE seq = 2)",
    )
    house.begin()
    read_only_at_once(house)
    story = house.closed(1)
    assert "event 3 had been committed" in str(story["core"]["last_words"]), story


def test_a_ledger_that_another_program_holds_is_read_meanwhile_and_written_to_when_it_is_let_go(
    new_house: MakeHouse,
) -> None:
    house = new_house()
    stopped_with_records(house)
    with stores.locked(house.data):
        house.begin()
        status = house.until(
            lambda s: s["safe"] == "DB_LOCKED" and s["core"]["ready"], "a core that reads only"
        )
        assert (status["state"], status["waits_for"]) == ("SAFE_MODE", None)
        if not stores.in_server():  # who holds a server's lock, that alone knows
            assert any(f"process {os.getpid()} (" in worry for worry in status["worries"]), status["worries"]
        house.url = status["url"]
        until(lambda: sorted(house.booked()) == ["record-0", "record-1", "record-2"], "the records")
        assert house.book("refused").status == 503
        until(lambda: [one["diagnosis"] for one in house.incidents()] == ["DB_LOCKED"], "the open incident")
        (story,) = house.incidents()
        assert (story["outcome"], story["grade"], story["closed_at"]) == ("open", "certain", None)
    house.running()
    story = house.closed(1)
    assert (story["diagnosis"], story["outcome"]) == ("DB_LOCKED", "safe_mode")
    if not stores.in_server():
        assert any(f"process {os.getpid()} (" in fact["text"] for fact in story["evidence"]), story[
            "evidence"
        ]
    assert sorted(house.booked()) == ["record-0", "record-1", "record-2"]
    assert house.book("after-the-lock").status == 201


def test_what_waited_for_a_person_is_told_as_over_when_a_core_serves_again(new_house: MakeHouse) -> None:
    house = new_house(actions=A_PERSON)
    stopped_with_records(house)
    with stores.locked(house.data):
        house.begin()
        refused_at_once(house)
        assert house.closed(1)["next_step"]["en"] is not None
        assert "needs a person" in house.cli("incidents").out
    assert house.cli("resume").code == 0
    until(lambda: house.incidents()[0]["served_again_at"], "the incident to be told as over")
    assert house.incidents()[0]["outcome"] == "manual"
    listed = house.cli("incidents").out
    assert "open again" in listed
    assert "person" not in listed
    assert house.closed(1)["next_step"]["en"] is None


@pytest.mark.in_a_file
def test_a_file_that_is_no_ledger_is_left_alone(new_house: MakeHouse) -> None:
    house = new_house()
    house.data.mkdir(parents=True)
    with closing(sqlite3.connect(house.data / "ledger.db")) as connection:
        connection.execute("CREATE TABLE recipes (name TEXT)")
        connection.commit()
    house.begin("--policy", str(house.settle_policy()))
    refused_at_once(house)
    assert house.closed(1)["diagnosis"] == "CONFIG_INVALID"
    with closing(sqlite3.connect(house.data / "ledger.db")) as connection:
        assert connection.execute("SELECT name FROM sqlite_master").fetchall() == [("recipes",)]


def test_a_core_that_dies_again_and_again_ends_in_a_word_for_a_person_not_in_a_loop(
    new_house: MakeHouse,
) -> None:
    house = new_house(max_restart_count=3, slow_retry_sec=0).up()
    house.open_accounts()
    enough = threading.Event()

    def kill_every_core() -> None:
        while not enough.is_set():
            for pid, line in house.processes().items():
                if "-m core serve" in line:
                    victim = house.hold_pid(pid)
                    victim.hit(9)
                    until(lambda: victim.gone, "it to be gone")  # noqa: B023  # called at once

    killer = threading.Thread(target=kill_every_core, daemon=True)
    killer.start()
    try:
        refused_at_once(house)
    finally:
        enough.set()
        killer.join(20)
    assert not killer.is_alive()
    story = house.closed(1)
    assert story["outcome"] == "manual"
    assert len(story["deaths"]) == 4, "three deaths were allowed"
    assert house.status()["budget"]["used"] == 4
    assert house.cli("resume").code == 0
    assert house.running()["budget"]["used"] == 0
    assert house.book("after-the-loop").status == 201


def test_the_pause_grows_for_cores_that_prove_nothing(new_house: MakeHouse) -> None:
    house = new_house(backoff_initial_ms=40, backoff_max_ms=10_000, probation_ms=30_000).up_unproven()
    for _ in range(3):
        core = house.hit("core")
        house.until(lambda s: s["core"]["pid"] not in {None, core.pid}, "the next core")  # noqa: B023  # called at once
    lines = (house.folders.logs / "sentinel.log").read_text("utf-8").splitlines()
    phases = [line for line in map(json.loads, lines) if line["kind"] == "phase"]
    begun = [line["at_ns"] for line in phases if line["after"] == "BACKOFF"]
    ended = [line["at_ns"] for line in phases if line["before"] == "BACKOFF"]
    pauses = [after - before for before, after in zip(begun, ended, strict=True)]
    assert len(pauses) == 3
    assert pauses[0] < pauses[1] < pauses[2], pauses
