"""Imports on a whole guarded house: through the gateway, over deaths, twice at once, and never a row twice."""

import http.client
import io
import itertools
import json
import os
import uuid
from collections import Counter
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import openpyxl
import pytest
from msoffcrypto.format.ooxml import OOXMLFile  # type: ignore[import-untyped]  # it has no types

from hardcore.host.recorder import PageReader
from hardcore.model.recorder import ComponentBeat, Page
from tests.integration.house import ANSWER_S, BANK, Answer, House, bytes_of
from tests.integration.lone_core import ready, started
from tests.waiting import until

ROWS = 2_000
IMPORT_S = 60.0
HEADER = "거래일시,적요,출금액,입금액,잔액"

numbers = itertools.count()


def statement(count: int, mark: str, *more: str) -> bytes:
    """A bank's file of `count` invented rows, each with a description of its own."""
    lines = [HEADER]
    balance = 10_000_000
    for n in range(count):
        balance -= 100 + n % 7
        lines.append(f"2026-03-{n % 28 + 1:02d} 09:00:00,{mark}-{n},{100 + n % 7},0,{balance}")
    return "\n".join([*lines, *more]).encode()


def form(file: bytes, fields: Mapping[str, str], name: str) -> tuple[bytes, str]:
    """A multipart body and its content type."""
    boundary = uuid.uuid4().hex
    parts = [
        f'--{boundary}\r\nContent-Disposition: form-data; name="{field}"\r\n\r\n{value}\r\n'.encode()
        for field, value in fields.items()
    ]
    head = f'--{boundary}\r\nContent-Disposition: form-data; name="file"; filename="{name}"\r\n\r\n'.encode()
    body = b"".join([*parts, head, file, f"\r\n--{boundary}--\r\n".encode()])
    return body, f"multipart/form-data; boundary={boundary}"


def upload(
    house: House, file: bytes, *, key: str | None = None, name: str = "bank.csv", **fields: str
) -> Answer:
    """Upload a file through the gateway, once."""
    body, kind = form(file, {"account": BANK, **fields}, name)
    connection = http.client.HTTPConnection(house.url.removeprefix("http://"), timeout=ANSWER_S)
    try:
        headers = {"Content-Type": kind, "Idempotency-Key": key or uuid.uuid4().hex}
        connection.request("POST", "/api/ledger/imports", body, headers)
        answer = connection.getresponse()
        told = json.loads(answer.read())
    finally:
        connection.close()
    return Answer(answer.status, {name.lower(): value for name, value in answer.headers.items()}, told)


def uploaded(house: House, file: bytes, **fields: str) -> str:
    answer = upload(house, file, **fields)
    assert answer.status == 201, answer
    made: str = answer.body["id"]
    return made


def commit(house: House, import_id: str, **body: Any) -> Answer:
    return house.ask("POST", f"/api/ledger/imports/{import_id}/commit", body, key=uuid.uuid4().hex)


def committed(house: House, import_id: str, **body: Any) -> str:
    answer = commit(house, import_id, **body)
    assert answer.status == 202, answer
    return import_id


def seen(house: House, import_id: str) -> dict[str, Any]:
    answer = house.ask("GET", f"/api/ledger/imports/{import_id}")
    assert answer.status == 200, answer
    return answer.body


def over(house: House, import_id: str) -> dict[str, Any]:
    """Wait until an import has ended; return how."""

    def look() -> dict[str, Any] | None:
        now = seen(house, import_id)
        return now if now["state"] != "committing" else None

    ended = until(look, f"the import to end, of which is seen {seen(house, import_id)['done']}", IMPORT_S)
    assert ended is not None
    return ended


def in_ledger(house: House, mark: str) -> Counter[str]:
    return Counter(one for one in house.booked() if one.startswith(f"{mark}-"))


def assert_each_once(house: House, mark: str, count: int) -> None:
    assert in_ledger(house, mark) == Counter({f"{mark}-{n}": 1 for n in range(count)})
    verdict = house.ask("GET", "/api/ledger/verify").body
    assert verdict["ok"] is True, verdict


@pytest.fixture
def mark() -> str:
    """A word that no other test's rows begin with."""
    return f"row{next(numbers)}"


def test_an_import_goes_on_after_each_death_and_books_every_row_once(house: House, mark: str) -> None:
    file = statement(ROWS, mark)
    import_id = committed(house, uploaded(house, file))
    for at_least in (300, 1_000):
        until(lambda least=at_least: seen(house, import_id)["done"] >= least, "rows to be booked", IMPORT_S)  # type: ignore[misc]
        assert seen(house, import_id)["state"] == "committing"
        # A person's booking is served in the middle of it.
        assert house.book(f"by-hand-{mark}-{at_least}").status == 201
        house.hit("core")
    ended = over(house, import_id)
    assert (ended["state"], ended["rows"]) == (
        "done",
        {"total": ROWS, "good": ROWS, "new": ROWS, "duplicates": 0, "refused": 0, "skipped": 0},
    )
    assert_each_once(house, mark, ROWS)
    again = over(house, committed(house, uploaded(house, file)))
    assert (again["rows"]["new"], again["rows"]["duplicates"]) == (0, ROWS)
    assert_each_once(house, mark, ROWS)


def test_the_same_file_in_two_tabs_books_each_row_once(house: House, mark: str) -> None:
    file = statement(400, mark)
    tabs = [uploaded(house, file) for _ in range(2)]
    for import_id in tabs:
        assert seen(house, import_id)["rows"]["duplicates"] == 0
    with ThreadPoolExecutor(len(tabs)) as hands:
        told = list(hands.map(lambda one: commit(house, one), tabs))
    assert [answer.status for answer in told] == [202, 202]
    rows = [over(house, import_id)["rows"] for import_id in tabs]
    assert sum(one["new"] for one in rows) == sum(one["duplicates"] for one in rows) == 400
    assert_each_once(house, mark, 400)


def test_a_planned_restart_stops_an_import_between_two_rows_and_the_next_core_goes_on(
    house: House, mark: str
) -> None:
    import_id = committed(house, uploaded(house, statement(800, mark)))
    until(lambda: seen(house, import_id)["done"] > 0, "the first rows", IMPORT_S)
    assert house.cli("restart", "--reason", "a test").code == 0
    assert over(house, import_id)["rows"]["new"] == 800
    assert_each_once(house, mark, 800)


def test_a_row_that_was_taken_back_does_not_come_again_unless_it_is_wanted(house: House, mark: str) -> None:
    file = statement(3, mark)
    over(house, committed(house, uploaded(house, file)))
    entries = house.ask("GET", f"/api/ledger/entries?q={mark}").body["items"]
    entry = next(one for one in entries if one["description"] == f"{mark}-1")
    assert house.ask("DELETE", f"/api/ledger/entries/{entry['id']}", key=uuid.uuid4().hex).status == 200
    again = over(house, committed(house, uploaded(house, file)))
    assert again["rows"]["duplicates"] == 3
    wanted = over(house, committed(house, uploaded(house, file), skip_duplicates=False))
    assert wanted["rows"]["new"] == 3


def test_refused_rows_stand_with_line_reason_and_sentence_and_the_good_ones_are_booked(
    house: House, mark: str
) -> None:
    file = statement(2, mark, "2026-02-30 10:00:00,never,1,0,5", "2026-03-01 10:00:00,<script>,abc,0,5")
    ended = over(house, committed(house, uploaded(house, file)))
    assert (ended["rows"]["new"], ended["rows"]["refused"]) == (2, 2)
    problems = [(one["line"], one["reason"]) for one in ended["problems"]]
    assert problems == [(4, "no-such-date"), (5, "bad-amount")]
    assert all(one["sentence"] and one["cells"] for one in ended["problems"])
    assert_each_once(house, mark, 2)


def test_a_row_in_a_currency_that_the_account_does_not_hold_is_refused(house: House, mark: str) -> None:
    lines = [
        "Date,Description,Amount,Currency",
        f"2026-03-01,{mark}-0,-5000,KRW",
        f"2026-03-02,{mark}-1,-5.00,USD",
    ]
    made = upload(house, "\n".join(lines).encode())
    assert made.status == 201, made
    assert made.body["rows"]["good"] == 1
    ended = over(house, committed(house, made.body["id"]))
    assert [one["reason"] for one in ended["problems"]] == ["other-currency"]
    assert "USD" in ended["problems"][0]["sentence"]
    assert_each_once(house, mark, 1)


def test_a_wish_that_is_kept_can_be_repeated_and_not_changed(house: House, mark: str) -> None:
    import_id = committed(house, uploaded(house, statement(5, mark)))
    over(house, import_id)
    assert commit(house, import_id).status == 202
    refused = commit(house, import_id, skip_duplicates=False)
    assert (refused.status, refused.body["type"]) == (409, "/problems/import-committed")
    assert house.ask("POST", f"/api/ledger/imports/{import_id}/preview", {"format": ""}).status == 409
    assert_each_once(house, mark, 5)


def test_an_upload_with_the_same_key_makes_one_import(house: House, mark: str) -> None:
    file = statement(2, mark)
    first, second = (upload(house, file, key=f"upload-{mark}") for _ in range(2))
    assert second.headers["idempotent-replayed"] == "true"
    assert first.body["id"] == second.body["id"]
    other = upload(house, statement(3, mark), key=f"upload-{mark}")
    assert (other.status, other.body["type"]) == (422, "/problems/key-reused")


def test_an_upload_into_the_outage_is_held_and_answered(house: House, mark: str) -> None:
    house.hit("core")
    import_id = committed(house, uploaded(house, statement(10, mark)))
    assert over(house, import_id)["rows"]["new"] == 10
    assert_each_once(house, mark, 10)


def test_the_guard_sees_on_the_recorder_whether_the_importer_works(house: House, mark: str) -> None:
    before = importer(house)
    assert before.since_ns == 0
    import_id = committed(house, uploaded(house, statement(600, mark)))
    until(lambda: importer(house).since_ns > 0, "the importer to say that it works")
    over(house, import_id)
    until(lambda: importer(house).since_ns == 0, "the importer to say that it has nothing to do")
    after = importer(house)
    assert after.beat_ns > before.beat_ns
    assert after.done >= before.done + 600


def importer(house: House) -> ComponentBeat:
    """What the serving core says of its importer on its recorder page."""
    pid = house.status()["core"]["pid"]
    for path in house.folders.run.glob("recorder-*"):
        if path.suffix != ".stacks":
            reader = PageReader(path, path.name.removeprefix("recorder-"))
            page = reader.read()
            reader.close()
            if isinstance(page, Page) and page.pid == pid:
                return next(one for one in page.components if one.name == "importer")
    raise AssertionError(f"no page of {pid}")


def test_what_was_chosen_is_looked_at_again(house: House, mark: str) -> None:
    answer = upload(house, statement(4, mark), account="")
    assert answer.status == 201
    assert (answer.body["account"], answer.body["currency"]) == (None, None)
    import_id = answer.body["id"]
    assert commit(house, import_id).body["type"] == "/problems/import-without-account"
    mapping = {**answer.body["mapping"], "date": None}
    faulty = house.ask(
        "POST", f"/api/ledger/imports/{import_id}/preview", {"account": BANK, "mapping": mapping}
    )
    assert [one["reason"] for one in faulty.body["faults"]] == ["mapping-no-date"]
    assert commit(house, import_id).body["type"] == "/problems/import-mapping"
    good = house.ask(
        "POST", f"/api/ledger/imports/{import_id}/preview", {"mapping": answer.body["mapping"]}
    ).body
    assert (good["account"], good["currency"], good["rows"]["good"], good["faults"]) == (BANK, "KRW", 4, [])
    assert over(house, committed(house, import_id))["rows"]["new"] == 4


@pytest.mark.parametrize(
    ("file", "status", "reason"),
    [
        (b"", 422, "empty"),
        (b"\0\1\2", 422, "binary"),
        (os.urandom(4_000), 422, None),
        (b"PK\3\4 no archive", 422, None),
        (b"x" * (21 << 20), 413, None),
    ],
)
def test_a_file_that_gives_no_rows_is_refused_with_its_reason(
    house: House, file: bytes, status: int, reason: str | None
) -> None:
    answer = upload(house, file)
    assert answer.status == status, answer
    assert answer.body["detail"]
    assert reason in {None, answer.body.get("reason")}


@pytest.mark.parametrize(
    "import_id", ["5c0f3d4e-8a34-4e0e-9d53-1b1f6c2a7e90", "..", "%2e%2e", "a" * 300, "x"]
)
def test_an_import_that_is_none_is_not_found(house: House, import_id: str) -> None:
    assert house.ask("GET", f"/api/ledger/imports/{import_id}").status == 404


def test_the_password_of_a_locked_file_is_kept_nowhere(house: House, mark: str) -> None:
    password = f"canary-{uuid.uuid4().hex}"
    file = locked_workbook(password, mark)
    assert upload(house, file, name="bank.xlsx").body["reason"] == "locked"
    assert upload(house, file, name="bank.xlsx", password="wrong").body["reason"] == "wrong-password"
    import_id = committed(house, uploaded(house, file, name="bank.xlsx", password=password))
    assert over(house, import_id)["rows"]["new"] == 3
    # Also the evidence of a death right after it holds none of it.
    incidents = len(house.incidents())
    upload(house, file, name="bank.xlsx", password=password)
    house.hit("core")
    house.closed(incidents + 1)
    searched = [path for path in files_of(house) if password.encode() in bytes_of(path)]
    assert searched == []


def locked_workbook(password: str, mark: str) -> bytes:
    book = openpyxl.Workbook()
    sheet = book.active
    assert sheet is not None
    for line in statement(3, mark).decode().splitlines():
        sheet.append(line.split(","))
    plain, locked = io.BytesIO(), io.BytesIO()
    book.save(plain)
    plain.seek(0)
    OOXMLFile(plain).encrypt(password, locked)
    return locked.getvalue()


def files_of(house: House) -> list[Path]:
    """Everything that is kept of a house, the recorder's pages and its logs among it."""
    folders = (house.data, house.folders.run)
    return [
        path for folder in folders for path in folder.rglob("*") if path.is_file() and not path.is_symlink()
    ] + sorted(house.data.parent.glob(f"{house.data.name}.up-*.txt"))


def test_where_no_room_is_left_an_upload_says_so_and_leaves_nothing(tmp_path: Path) -> None:
    body, kind = form(b"x" * (3 << 20), {}, "bank.csv")
    with started(tmp_path / "data", file_bytes_max=2 << 20) as core:
        answer = ready(core).ask("POST", "/api/ledger/imports", body, Content_Type=kind)
        assert (answer.status, answer.body["type"]) == (507, "/problems/import-not-kept")
        assert list((tmp_path / "data" / "imports").iterdir()) == []
        assert core.open("cash").status == 201
