"""The guard's rules as a core reads them: what they mean, and that no file can hurt whoever reads it."""

import json
import os
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.guarded.quarantine import (
    FILE_BYTES_MAX,
    NO_RULES,
    Limit,
    Parked,
    Quarantine,
    Rules,
    Unreadable,
    read_rules,
)

NAME, DIGEST, WISH = "0a" * 16, "0b" * 32, "0c" * 32
LETTER = {
    "id": "L1",
    "type": "letter",
    "name": NAME,
    "digest": DIGEST,
    "fingerprint": WISH,
    "reason": "HUNG_CORE",
}


def file_of(*rules: Any, **more: Any) -> bytes:
    return json.dumps({"version": 1, "serial": 3, "rules": rules, **more}).encode()


def rules_of(*rules: Any, **more: Any) -> Rules:
    found = read_rules(file_of(*rules, **more))
    assert isinstance(found, Rules), found
    return found


def test_a_letter_is_known_by_its_name_its_request_and_its_wish() -> None:
    found = rules_of(LETTER)
    assert (found.names, found.digests, found.fingerprints) == ({NAME: "L1"}, {DIGEST: "L1"}, {WISH: "L1"})
    assert found.refuse


@pytest.mark.parametrize("reason", ["UNPROVEN", "OPERATOR_HOLD"])
def test_what_is_only_held_is_known_by_its_name_alone(reason: str) -> None:
    found = rules_of({**LETTER, "reason": reason})
    assert (found.names, found.digests, found.fingerprints) == ({NAME: "L1"}, {}, {})


def test_a_parked_event_marks_its_accounts() -> None:
    found = rules_of({"id": "L2", "type": "parked", "seq": 812, "account_ids": ["assets:cash"]})
    assert (found.parked, found.marked) == ({812: Parked("L2", ("assets:cash",))}, {"assets:cash": "L2"})
    assert not found.refuse, "only what is decided shows what it would book on"


def test_kinds_are_limited_and_have_their_deadlines() -> None:
    found = rules_of(
        {"id": "A", "type": "limit", "kind": "entry.record", "per_minute": 30, "body_bytes_max": None},
        {"id": "B", "type": "deadline", "kind": "entry.record", "limit_ms": 2_000},
        {"id": "C", "type": "fingerprint", "fingerprint": WISH},
    )
    assert found.limits == {"entry.record": Limit("A", 30, None)}
    assert (found.deadlines_ms, found.fingerprints, found.count) == ({"entry.record": 2_000}, {WISH: "C"}, 3)


def test_suspects_are_names_and_nothing_else() -> None:
    said = [{"name": NAME, "account_ids": ["a"]}, {"name": "../x"}, {"name": 7}, "x", None]
    assert rules_of(suspects=said).suspects == {NAME}


def test_a_source_is_stopped_until_a_moment_and_by_nothing_that_is_none() -> None:
    until = {"source": "import:1", "until": "2026-11-22T14:00:00.250Z"}
    strange = [
        {"source": "a", "until": "soon"},
        {"source": "b", "until": "2026-11-22T14:00:00"},
        {"source": "c", "until": 5},
        {"source": "d", "until": "0001-01-01T00:00:00+14:00"},
        {"source": None, "until": until["until"]},
        {"until": until["until"]},
        "import:2",
        None,
    ]
    found = dict(rules_of(sources=[*strange, until]).sources)
    assert found.pop("import:1") == 1_795_356_000 * 10**9
    assert all(moment <= 0 for moment in found.values())
    assert rules_of(sources="import:1").sources == {}


@pytest.mark.parametrize(
    "rule",
    [
        {"id": "L", "type": "of another version"},
        {"id": "L"},
        {"type": "letter", "name": NAME},
        {"id": "L\r\nX: 1", "type": "letter", "name": NAME},
        {"id": "L", "type": "letter", "name": "0A" * 16},
        {"id": "L", "type": "letter", "name": None},
        {"id": "L", "type": "parked", "seq": True, "account_ids": []},
        {"id": "L", "type": "parked", "seq": 0, "account_ids": []},
        {"id": "L", "type": "parked", "seq": 1, "account_ids": [None]},
        {"id": "L", "type": "fingerprint", "fingerprint": "x"},
        {"id": "L", "type": "limit", "kind": "a", "per_minute": -1},
        {"id": "L", "type": "limit", "kind": "", "per_minute": 1},
        {"id": "L", "type": "deadline", "kind": "a", "limit_ms": 0},
        {"id": "L", "type": ["letter"]},
        "letter",
        None,
    ],
)
def test_a_rule_that_says_nothing_is_passed_over_and_those_beside_it_count(rule: object) -> None:
    found = rules_of(rule, LETTER)
    assert (found.names, found.count, found.passed_over) == ({NAME: "L1"}, 1, 1)


@pytest.mark.parametrize(
    "raw",
    [
        b"",
        b"{",
        b"[]",
        b"null",
        b"\xff",
        b"[" * 100_000,
        b'{"version": 2, "rules": []}',
        b'{"version": 1, "rules": 1}',
    ],
)
def test_what_is_no_file_of_rules_says_so(raw: bytes) -> None:
    assert isinstance(read_rules(raw), Unreadable)


NAMES = ["id", "type", "name", "seq", "account_ids", "kind", "limit_ms", "version", "rules", "suspects"]
WORDS = st.sampled_from(["letter", "parked", "limit", "deadline", "fingerprint", NAME, DIGEST])
ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text(max_size=8) | WORDS,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.sampled_from(NAMES), inner, max_size=5),
)


@given(ANYTHING)
def test_no_rule_raises(said: object) -> None:
    assert isinstance(read_rules(json.dumps(said).encode()), Rules | Unreadable)
    assert isinstance(read_rules(file_of(said)), Rules)
    assert isinstance(read_rules(file_of(sources=[said, {"source": "a", "until": said}])), Rules)


def test_a_file_that_cannot_be_read_leaves_the_rules_before_it_in_force(tmp_path: Path) -> None:
    path = tmp_path / "quarantine.json"
    rules = Quarantine(path)
    assert rules.read() is None
    assert rules.rules == NO_RULES
    path.write_bytes(file_of(LETTER))
    assert rules.read() is None
    kept = rules.rules
    assert kept.names == {NAME: "L1"}
    for spoil in (lambda: path.write_bytes(b"{"), path.unlink, lambda: os.mkfifo(path)):
        spoil()
        rules.read()
        assert rules.rules is kept
    path.unlink()
    with path.open("wb") as file:
        file.truncate(FILE_BYTES_MAX + 1)
    assert isinstance(rules.read(), Unreadable)
    assert rules.rules is kept


def test_a_trial_goes_by_what_is_parked_alone(tmp_path: Path) -> None:
    path = tmp_path / "quarantine.json"
    path.write_bytes(file_of(LETTER, {"id": "L2", "type": "parked", "seq": 5, "account_ids": ["a"]}))
    rules = Quarantine(path, parked_only=True)
    rules.read()
    assert list(rules.rules.parked) == [5]
    assert (rules.rules.refuse, dict(rules.rules.marked)) == (False, {})
