"""Components of a real core: each stands still alone, is begun anew alone, and the ledger answers all the while."""

import csv
import io
import json
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from tests.integration.lone_core import UnixConnection
from tests.integration.wired_core import Guard, Wired, guarding
from tests.waiting import WAIT_S, until

ROWS = 300
COMPONENTS = ("importer", "exporter", "notifier", "auditor", "scheduler")


@pytest.fixture(scope="module")
def life(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Wired]:
    """One core for all: that nothing of one component hurts another is what is promised."""
    with guarding(tmp_path_factory.mktemp("parts")) as guard:
        made = guard.core()
        made.core.open("bank")
        made.core.open("food", "expense")
        for amount in range(1, 6):
            assert made.core.move(amount, "food", "bank").status == 201
        yield made


def works(life: Wired, name: str) -> bool:
    return any(one.name == name and one.since_ns for one in life.page().components)


def stalls(life: Wired, name: str) -> None:
    """Have a component stand still: it has work, and does not beat."""
    assert life.order(verb="drill", fault="stall", component=name) == {"ok": True}
    until(lambda: works(life, name), f"{name} to have work")

    def stands() -> bool:
        before = next(one.beat_ns for one in life.page().components if one.name == name)
        for _ in range(3):
            assert life.core.ask("GET", "/api/ledger/accounts").status == 200
        return next(one.beat_ns for one in life.page().components if one.name == name) == before

    until(stands, f"{name} to stand still: its work is told a moment before its last beat")


def begins_anew(life: Wired, name: str) -> None:
    assert life.order(verb="component", name=name) == {"ok": True}
    until(lambda: not works(life, name), f"{name} to be done with what it had")


@pytest.mark.parametrize("name", COMPONENTS)
def test_a_component_that_stands_still_is_begun_anew_while_the_ledger_answers(life: Wired, name: str) -> None:
    stalls(life, name)
    assert life.core.move(1, "food", "bank").status == 201
    begins_anew(life, name)
    assert life.core.ask("GET", "/api/ledger/verify").body["ok"]


def test_a_component_that_is_not_there_is_refused_by_name(life: Wired) -> None:
    assert life.order(verb="component", name="nobody") == {
        "ok": False,
        "error": "This core has no such component now.",
    }


def exported(life: Wired, form: str = "csv") -> bytes:
    return life.core.raw("GET", f"/api/ledger/export?format={form}")


def test_an_export_is_of_one_moment_and_adds_up(life: Wired) -> None:
    answer = json.loads(exported(life, "json"))
    rows = list(csv.DictReader(io.StringIO(exported(life).decode("utf-8-sig"))))
    assert sum(int(row["amount"]) for row in rows) == 0
    assert max(int(row["seq"]) for row in rows) == answer["seq"]
    assert {row["transaction"] for row in rows} == {one["id"] for one in answer["transactions"]}
    assert [one["id"] for one in answer["accounts"]] == ["bank", "food"]


def test_a_format_that_is_not_there_is_refused_with_those_that_are(life: Wired) -> None:
    refused = life.core.ask("GET", "/api/ledger/export?format=abacus")
    assert (refused.status, refused.body["type"]) == (400, "/problems/export-format-unknown")
    assert "csv, json, beancount, hledger" in refused.body["detail"]


def test_an_export_whose_reading_hangs_is_whole_once_the_exporter_is_begun_anew(life: Wired) -> None:
    assert life.order(verb="drill", fault="stall", component="exporter") == {"ok": True}
    until(lambda: works(life, "exporter"), "the exporter to hang")
    connection = life.core.connect()
    connection.request("GET", "/api/ledger/export?format=json")
    begins = life.order(verb="component", name="exporter")
    assert begins == {"ok": True}
    answer = connection.getresponse()
    assert json.loads(answer.read())["transactions"]
    connection.close()


def test_more_exports_than_there_are_places_for_are_refused(life: Wired) -> None:
    stalls(life, "exporter")
    waiting = [life.core.connect() for _ in range(2)]
    for connection in waiting:
        connection.request("GET", "/api/ledger/export?format=csv")
    until(lambda: _export_status(life) == 503, "every place to be taken")
    begins_anew(life, "exporter")
    for connection in waiting:
        assert connection.getresponse().read()
        connection.close()
    assert _export_status(life) == 200


def _export_status(life: Wired) -> int | None:
    """The status of one more export; None where it waits like the others."""
    connection = UnixConnection(life.core.socket or Path())
    connection.connect()
    connection.sock.settimeout(0.5)
    with closing(connection):
        connection.request("GET", "/api/ledger/export?format=csv")
        try:
            return connection.getresponse().status
        except TimeoutError:
            return None


def test_a_leak_takes_memory_until_it_is_told_to_stop(life: Wired) -> None:
    def taken() -> int:
        return int(Path(f"/proc/{life.pid}/statm").read_text().split()[1])

    before = taken()
    assert life.order(verb="drill", fault="leak", mb_per_s=80, seconds=1) == {"ok": True}
    until(lambda: taken() - before > 20 * 256, "20 MB to be gone")
    assert life.order(verb="drill", fault="leak", mb_per_s=0) == {"ok": True}
    until(lambda: taken() - before < 20 * 256, "them to be given back")


def bank_file() -> bytes:
    lines = [f"2026-03-{1 + n % 28:02d},shop {n},-{n + 1}" for n in range(ROWS)]
    return "\n".join(["Date,Description,Amount", *lines]).encode()


def begun_import(life: Wired) -> str:
    connection = life.core.connect()
    boundary = "b0undary"
    body = (
        (
            f'--{boundary}\r\nContent-Disposition: form-data; name="account"\r\n\r\nbank\r\n'
            f'--{boundary}\r\nContent-Disposition: form-data; name="file"; filename="bank.csv"\r\n\r\n'
        ).encode()
        + bank_file()
        + f"\r\n--{boundary}--\r\n".encode()
    )
    head = {"Content-Type": f"multipart/form-data; boundary={boundary}"}
    connection.request("POST", "/api/ledger/imports", body, head)
    response = connection.getresponse()
    made: dict[str, Any] = json.loads(response.read())
    assert response.status == 201, made
    wish = {"account": "bank", "mapping": made["mapping"], "skip_duplicates": True}
    committed = life.core.ask("POST", f"/api/ledger/imports/{made['id']}/commit", wish)
    assert committed.status == 202, committed.body
    return str(made["id"])


def test_an_import_that_hangs_is_gone_on_with_and_books_every_row_once(life: Wired) -> None:
    stalls(life, "importer")
    import_id = begun_import(life)
    assert life.core.ask("GET", f"/api/ledger/imports/{import_id}").body["state"] == "committing"
    assert life.order(verb="component", name="importer") == {"ok": True}
    # Once more in the middle of it: what the first one had at the writer comes true once.
    assert life.order(verb="component", name="importer") == {"ok": True}

    def done() -> dict[str, Any] | None:
        found: dict[str, Any] = life.core.ask("GET", f"/api/ledger/imports/{import_id}").body
        return found if found["state"] != "committing" else None

    found = until(done, "the import to end")
    assert found is not None
    assert found["state"] == "done", found
    booked = [one for one in json.loads(exported(life, "json"))["transactions"] if one["entry"]]
    assert len(booked) == ROWS
    assert life.core.ask("GET", "/api/ledger/verify").body["ok"]


def test_the_log_is_lines_of_json_and_its_warnings_are_counted_on_the_page(life: Wired) -> None:
    lines = [json.loads(line) for line in life.core.said().splitlines()]
    assert {tuple(line) for line in lines} == {("at", "level", "logger", "text", "epoch")}
    counts = life.reader.log_counts()
    assert counts is not None
    assert counts.warnings == sum(line["level"] == "WARNING" for line in lines)
    assert {line["epoch"] for line in lines} == {1}


def test_a_core_that_hangs_in_every_component_still_leaves_when_asked(tmp_path: Path) -> None:
    with guarding(tmp_path) as guard:
        made = guard.core(CORE_CLOSE_MS="300", CORE_DRAIN_MS="300")
        for name in COMPONENTS:
            stalls(made, name)
        made.core.process.terminate()
        assert made.core.ends_with() == 0


def test_a_start_goes_by_the_newest_checkpoint_unless_it_is_told_not_to(tmp_path: Path) -> None:
    with guarding(tmp_path) as guard:
        first = guard.core()
        first.core.open("bank")
        first.core.open("food", "expense")
        made = first.order(verb="checkpoint")
        assert (made["ok"], made["seq"]) == (True, 2)
        for amount in range(1, 4):
            first.core.move(amount, "food", "bank")
        _kill(first)
        second = _started_again(guard)
        assert second.order(verb="status")["checkpoint"] == made["name"]
        assert second.core.ask("GET", "/healthz").body["checkpoint"] == made["name"]
        assert second.hears("READY")["X_TAIL"] == "3"
        _kill(second)
        third = _started_again(guard, HARDCORE_STATE_RECOVERY="0", HARDCORE_CHECKPOINT_S="1")
        assert third.hears("READY")["X_TAIL"] == "5"
        third.core.move(9, "food", "bank")
        until(
            lambda: list((guard.data / "checkpoints").glob("6-*.json")), "the next one to be made by itself"
        )


def _kill(life: Wired) -> None:
    life.core.process.kill()
    life.core.process.wait(WAIT_S)


def _started_again(guard: Guard, **environ: str) -> Wired:
    return guard.core(**environ)
