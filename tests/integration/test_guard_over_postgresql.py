"""What the guard promises holds over a PostgreSQL server too: struck under load, one after the other, in one household."""

import json
from collections.abc import Iterator

import pytest

from core.store_file import STORE_FILE
from tests import postgres, stores
from tests.integration.clients import assert_exactly_once, at_work
from tests.integration.conftest import SHARED
from tests.integration.house import WITH_SPARE, House
from tests.waiting import until

#: Each has its incident; what is promised of each is held by the drill itself.
POLICY = {**WITH_SPARE, "max_restart_count": 100}
FAULTS = ("crash", "freeze", "block", "deadlock", "segv")


@pytest.fixture(scope="module")
def server() -> Iterator[postgres.Postgres]:
    with postgres.served() as made:
        SHARED.add(made.folder)  # its sessions come and go with the cores
        yield made


@pytest.fixture(scope="module")
def shared_house(tmp_path_factory: pytest.TempPathFactory, server: postgres.Postgres) -> Iterator[House]:
    """A household whose ledger lies in a server, with a spare."""
    made = House(tmp_path_factory.mktemp("server") / "data", POLICY)
    made.data.mkdir(mode=0o700)
    (made.data / STORE_FILE).write_text(server.place(), encoding="utf-8")
    try:
        made.up()
        made.open_accounts()
        yield made
    finally:
        made.end()


@pytest.mark.parametrize("fault", FAULTS)
def test_what_a_drill_promises_comes_so_and_every_booking_is_there_once(house: House, fault: str) -> None:
    house.spared()
    count = len(house.incidents())
    with at_work(house, 2, fault) as clients:
        until(lambda: len(clients.told) > 3, "the load to run")
        struck = house.cli("--json", "drill", fault, "--yes")
        assert struck.code == 0, struck
        told = len(clients.told)
        until(lambda: len(clients.told) > told + 3, "answers of the next core")
    house.closed(count + 1)
    assert_exactly_once(house, clients)


def test_a_switch_under_load_fails_nobody(house: House) -> None:
    house.spared()
    with at_work(house, 2, "switch", patient=False) as clients:
        until(lambda: len(clients.told) > 3, "the load to run")
        done = house.cli("--json", "restart")
        assert done.code == 0, done
        told = len(clients.told)
        until(lambda: len(clients.told) > told + 3, "answers of the new core")
    assert {one.status for one in clients.told} == {201}
    assert_exactly_once(house, clients)


@pytest.mark.parametrize("who", ["sentinel", "gateway"])
def test_the_ledger_goes_on_over_the_death_of_who_stands_around_it(house: House, who: str) -> None:
    house.running()
    epoch = house.status()["core"]["epoch"]
    with at_work(house, 2, who) as clients:
        until(lambda: len(clients.told) > 3, "the load to run")
        house.hit(who)
        told = len(clients.told)
        until(lambda: len(clients.told) > told + 3, "answers after the death")
    house.running()
    assert house.status()["core"]["epoch"] == epoch
    assert_exactly_once(house, clients)


def test_after_all_of_it_the_whole_book_is_proven(house: House) -> None:
    house.running()
    proven = house.cli("--json", "verify")
    assert proven.told["ok"], proven


def test_a_stranger_s_lock_in_the_server_ends_no_core_and_is_told_to_who_asks(house: House) -> None:
    core = house.running()["core"]
    count = len(house.incidents())
    with stores.locked(house.data):
        waited = house.book("behind-a-stranger")
        assert (waited.status, waited.outcome) == (503, "not_done")
        assert waited.body["type"] == "/problems/store-busy"
    again = until(lambda: (told := house.book("behind-a-stranger")).status == 201 and told, "it to be booked")
    assert again
    assert house.running()["core"]["pid"] == core["pid"]
    assert len(house.incidents()) == count


def test_a_server_that_goes_away_for_a_while_ends_no_core(house: House, server: postgres.Postgres) -> None:
    core = house.running()["core"]
    with server.away():
        refused = house.book("nobody-there")
        assert (refused.status, refused.outcome) == (503, "not_done")
        assert house.ask("GET", "/api/ledger/accounts").status == 503
    until(lambda: house.book("nobody-there").status == 201, "it to be booked")
    assert house.running()["core"]["pid"] == core["pid"]


def test_a_death_while_the_server_is_away_is_told_as_that_and_over_when_it_is_back(
    house: House, server: postgres.Postgres
) -> None:
    house.running()
    assert house.book("before-it-went").status == 201
    count = len(house.incidents())
    with server.away():
        house.hit("core")
        status = house.until(lambda s: "can't be reached" in s["start_fault"], "a start that finds no server")
        assert (status["safe"], status["waits_for"]) == (None, None), "nothing to read, and nobody is needed"
    assert house.book("after-it-came").status == 201
    story = house.closed(count + 1)
    assert story["outcome"] == "recovered"
    facts = json.loads((house.folders.incidents / story["id"] / "incident.json").read_text())
    assert {death["diagnosis"] for death in facts["deaths"][1:]} == {"STORE_AWAY"}
    told = house.cli("incidents", "show", story["id"])
    assert "could not be reached" in told.out
    assert "another program" not in told.out.lower()
    assert house.booked().count("before-it-went") == 1


def test_what_locks_a_file_is_no_drill_for_a_server(house: House) -> None:
    house.running()
    refused = house.cli("drill", "dblock", "--yes")
    assert refused.code == 1
    assert "database server" in refused.err
