"""Files that mean harm or none: each gets a clear answer, good rows are booked, and the ledger proves itself afterwards."""

import io
import uuid
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.integration.lone_core import Answer, Core, ready, started
from tests.integration.test_imports import form
from tests.waiting import until

BANK = "bank"
HEADER = "거래일시,적요,출금액,입금액,잔액\n"
END_S = 30.0


def row(what: str = "good", date: str = "2026-03-02", out: str = "100") -> str:
    return f"{date},{what},{out},0,1000\n"


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("bad") / "data"


@pytest.fixture(scope="module")
def core(data: Path) -> Iterator[Core]:
    with started(data) as made:
        assert ready(made).open(BANK).status == 201
        yield made


def uploaded(core: Core, file: bytes) -> Answer:
    body, kind = form(file, {"account": BANK}, "bank.csv")
    return core.ask("POST", "/api/ledger/imports", body, Content_Type=kind, Idempotency_Key=uuid.uuid4().hex)


def proven(core: Core) -> bool:
    return core.ask("GET", "/api/ledger/verify").body["ok"] is True


def bomb() -> bytes:
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("bank.csv", b"0" * (64 << 20))
    return made.getvalue()


@pytest.mark.parametrize(
    ("file", "reason"),
    [
        ((HEADER + row()).encode() + b"\0" + row().encode(), "binary"),
        ((",".join(["a"] * 1_000_000) + "\n" + row()).encode(), "too-many-columns"),
        (bomb(), "zip-bomb"),
        ((HEADER + row("x" * (10 << 20))).encode(), "cell-too-long"),
        (b'<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b "c">]><OFX><STMTTRN></OFX>', "unsupported"),
        (b"!Type:Invst\nD01/01/2026\n^\n", "no-table"),
    ],
    ids=[
        "nul",
        "a million columns",
        "a zip bomb",
        "a cell of 10 MB",
        "a document type",
        "no list of movements",
    ],
)
def test_a_file_that_gives_no_rows_says_why_and_leaves_nothing(core: Core, file: bytes, reason: str) -> None:
    answer = uploaded(core, file)
    assert (answer.status, answer.body["reason"]) == (422, reason), answer
    assert proven(core)


def test_rows_that_can_not_be_meant_are_refused_with_line_and_reason_and_the_others_go_on(core: Core) -> None:
    bad = {3: ("2026-02-30", "1", "no-such-date"), 4: ("2026-03-02", "1" * 40, "amount-out-of-range")}
    lines = [row("first"), *(row("bad", date, out) for date, out, _ in bad.values()), row("last")]
    ended = imported(core, (HEADER + "".join(lines)).encode())
    assert (ended["rows"]["new"], ended["rows"]["refused"]) == (2, 2)
    told = {one["line"]: (one["reason"], one["cells"][0]) for one in ended["problems"]}
    assert told == {line: (reason, date) for line, (date, _, reason) in bad.items()}
    assert proven(core)


def test_letters_of_two_encodings_are_a_guess_that_is_said_and_the_raw_file_is_kept(
    core: Core, data: Path
) -> None:
    file = b"date,description,amount\n2026-03-02,caf\xe9,1\n2026-03-03," + "é".encode() + b",1\n"
    answer = uploaded(core, file)
    assert answer.status == 201, answer
    assert "encoding-guessed" in [one["reason"] for one in answer.body["notes"]]
    kept = data / "imports" / answer.body["id"] / "file"
    assert kept.read_bytes() == file


def imported(core: Core, file: bytes) -> dict[str, Any]:
    answer = uploaded(core, file)
    assert answer.status == 201, answer
    path = f"/api/ledger/imports/{answer.body['id']}"
    assert core.ask("POST", f"{path}/commit", {}).status == 202

    def look() -> dict[str, Any] | None:
        now: dict[str, Any] = core.ask("GET", path).body
        return now if now["state"] != "committing" else None

    ended = until(look, "the import to end", END_S)
    assert ended is not None
    return ended
