"""Cases and a court's words are somebody else's: read whole, bounded, and never believed beyond their form."""

import json
import os
from pathlib import Path
from typing import Any

import pytest

from hardcore.host import docket
from hardcore.host.docket import Case, Heard, Said, Unknown
from hardcore.model.trials import Ordeal

NAME = "0123456789abcdef" * 2
DIGEST = "ab" * 32


def filed(folder: Path, name: str = NAME, **changes: Any) -> Path:
    request = {"method": "POST", "path": "/x", "headers": [["Idempotency-Key", "k"]], "body": ""}
    told = {
        "version": 1,
        "name": name,
        "at": "2026-11-22T00:00:00Z",
        "source": "browser:0011223344556677",
        "key": "k",
        "digest": DIGEST,
        "case": {"name": name, "request": request},
    }
    path = folder / f"{name}.json"
    path.write_text(json.dumps({**told, **changes}))
    return path


def why(found: Case | Unknown) -> str:
    assert isinstance(found, Unknown)
    return found.why


def test_a_case_is_read_as_it_was_filed(tmp_path: Path) -> None:
    filed(tmp_path)
    found = docket.read_case(tmp_path, NAME)
    assert isinstance(found, Case)
    assert (found.name, found.key, found.digest) == (NAME, "k", DIGEST)


def test_no_secret_leaves_a_case(tmp_path: Path) -> None:
    headers = [["Cookie", "a=1"], ["authorization", "b"], ["Accept", "*/*"], "odd", [1, 2]]
    request = {"method": "POST", "path": "/x", "headers": headers, "body": ""}
    filed(tmp_path, case={"name": NAME, "request": request})
    found = docket.read_case(tmp_path, NAME)
    assert isinstance(found, Case)
    assert found.case["request"]["headers"] == [["Accept", "*/*"]]


@pytest.mark.parametrize("name", ["", "../../etc/passwd", NAME.upper(), NAME + "0"])
def test_a_name_that_is_a_path_is_none(tmp_path: Path, name: str) -> None:
    assert why(docket.read_case(tmp_path, name)) == "that is no name of a suspect"


@pytest.mark.parametrize(
    "changes",
    [
        {"name": "f" * 32},
        {"case": {"name": "f" * 32, "request": {}}},
        {"case": {"name": NAME}},
        {"case": 5},
        {"digest": "short"},
        {"version": 2},
    ],
)
def test_a_case_that_is_anothers_or_none_is_not_tried(tmp_path: Path, changes: dict[str, Any]) -> None:
    filed(tmp_path, **changes)
    assert why(docket.read_case(tmp_path, NAME)).startswith("its request")


def test_no_link_is_followed_and_nothing_too_large_is_read(tmp_path: Path) -> None:
    real = filed(tmp_path, "f" * 32)
    (tmp_path / f"{NAME}.json").symlink_to(real)
    assert why(docket.read_case(tmp_path, NAME)).startswith("its request can't be read")
    real.write_bytes(b" " * (docket.CASE_BYTES_MAX + 1))
    assert why(docket.read_case(tmp_path, "f" * 32)) == "its request is too large"
    os.mkfifo(tmp_path / f"{'e' * 32}.json")
    assert why(docket.read_case(tmp_path, "e" * 32)) == "its request is no file"


def test_dockets_are_cut_where_they_would_grow_too_large() -> None:
    def case(size_bytes: int) -> Case:
        return Case(NAME, "", None, "", {}, size_bytes)

    assert docket.cut([]) == []
    assert [len(part) for part in docket.cut([case(docket.DOCKET_BYTES_MAX)] * 2 + [case(1)])] == [1, 1, 1]
    assert [len(part) for part in docket.cut([case(1)] * (docket.CASES_MAX + 1))] == [docket.CASES_MAX, 1]


@pytest.mark.parametrize(
    "line",
    [
        b"",
        b"\xff",
        b"[1]",
        b"5",
        b'{"type": "tried"}',
        b"[" * 5000,
        json.dumps({"type": "tried", "name": "f" * 32, "ordeal": "died"}).encode(),
        json.dumps({"type": "tried", "name": NAME, "ordeal": "eaten"}).encode(),
    ],
)
def test_a_line_that_says_nothing_convicts_nobody(line: bytes) -> None:
    assert isinstance(docket.read_line(line, frozenset({NAME}), 1), Unknown)


def test_a_verdict_is_taken_with_every_field_bounded() -> None:
    line = {
        "type": "tried",
        "name": NAME,
        "ordeal": "died",
        "fingerprint": "no",
        "kind": "k" * 5000,
        "account_ids": ["\x1b[2Jassets:cash", 5, *["a"] * 50],
        "transaction_id": None,
        "exit": {"signal": 11, "code": True},
        "ms": 7,
        "frame": "decide (decider.py:1)",
        "seq": "5",
        "why": "",
    }
    heard = docket.read_line(json.dumps(line).encode(), frozenset({NAME}), 9)
    assert isinstance(heard, Heard)
    tried = heard.tried
    assert (tried.ordeal, tried.signal, tried.code, tried.seq, tried.took_ms) == (
        Ordeal.DIED,
        11,
        None,
        None,
        7,
    )
    assert len(tried.kind) == docket.TEXT_CHARACTERS_MAX
    assert len(tried.account_ids) == docket.ACCOUNTS_MAX
    assert tried.account_ids[0] == " [2Jassets:cash"
    assert tried.fingerprint == ""


def test_a_court_says_how_far_it_is() -> None:
    assert docket.read_line(b'{"type": "copied", "seq": 1, "ms": 2}', frozenset(), 1) == Said()
    assert docket.read_line(b'{"type": "over"}', frozenset(), 1) == Said(over=True)


def test_old_cases_of_nobody_are_removed(tmp_path: Path) -> None:
    kept, old, fresh = (filed(tmp_path, digit * 32) for digit in "abc")
    for path in (kept, old):
        os.utime(path, (1, 1))
    docket.sweep(tmp_path, {"a" * 32}, 60)
    assert (kept.exists(), old.exists(), fresh.exists()) == (True, False, True)
