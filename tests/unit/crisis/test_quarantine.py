"""The rules of the quarantine as the gateway reads them, and which requests name an account."""

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hardcore.crisis.quarantine import FILE_BYTES_MAX, Rules, read_rules
from hardcore.crisis.touching import Accounts

NAME, DIGEST = "a" * 32, "b" * 64
FORM = ((b"Content-Type", b"application/x-www-form-urlencoded"),)
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=12), inner, max_size=4),
    max_leaves=20,
)


def file_of(**fields: Any) -> bytes:
    return json.dumps({"version": 1, "serial": 1, "rules": [], **fields}).encode()


def letter(**fields: Any) -> dict[str, Any]:
    return {"id": "l1", "type": "letter", "name": NAME, "digest": DIGEST, "fingerprint": None, **fields}


def read(**fields: Any) -> Rules:
    rules = read_rules(file_of(**fields))
    assert isinstance(rules, Rules)
    return rules


def test_a_letter_refuses_by_its_name_and_by_its_digest() -> None:
    rules = read(rules=[letter()])
    assert rules.names == {NAME: "l1"}
    assert rules.digests == {DIGEST: "l1"}


def test_a_held_letter_refuses_by_its_name_alone() -> None:
    assert read(rules=[letter(digest=None)]).digests == {}


@pytest.mark.parametrize(
    "odd",
    [
        None,
        "text",
        {},
        {"id": 5, "type": "letter", "name": NAME},
        letter(id="../etc"),
        letter(id="x" * 65),
        letter(name="A" * 32, digest="short"),
        letter(name={"a": 1}, digest=["b"]),
        {"id": "p1", "type": "parked", "seq": 812},
        {"id": "n1", "type": "of-a-later-version", "name": NAME},
    ],
)
def test_a_rule_that_makes_no_sense_here_is_passed_over_alone(odd: object) -> None:
    assert read(rules=[odd, letter(name="c" * 32)]).names == {"c" * 32: "l1"}


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"[]",
        b"{}",
        b"\xff",
        b"[" * 100_000,
        b'{"version": 2, "serial": 1}',
        b'{"version": 1}',
        b'{"version": 1, "serial": true}',
        b" " * (FILE_BYTES_MAX + 1),
    ],
)
def test_a_file_that_is_none_says_why(data: bytes) -> None:
    assert isinstance(read_rules(data), str)


@given(JSON, JSON, JSON)
def test_nothing_in_a_file_breaks_its_reader(rules: object, rule: object, sources: object) -> None:
    assert isinstance(read_rules(file_of(rules=rules, sources=sources)), Rules)
    assert isinstance(read_rules(file_of(rules=[rule, letter(name=rule, id=rule)])), Rules)


def test_a_source_is_stopped_until_its_time_and_only_if_that_is_one() -> None:
    until = ["1970-01-01T00:01:00Z", "soon", "2026-01-01", "9999-12-31T23:59:59+99:99", 7, None]
    sources = [{"source": f"peer:{n}", "until": one} for n, one in enumerate(until)]
    assert read(sources=sources).sources == {"peer:0": 60.0}


@pytest.mark.parametrize(
    ("path", "headers", "body", "named"),
    [
        (b"/api/accounts/assets%3Acash", (), b"", True),
        (b"/api/accounts/assets:cash/close", (), b"", True),
        (b"/api/accounts/assets:cashier", (), b"", False),
        (b"/t", (), b'{"account": "assets:cash"}', True),
        (b"/t", (), b'{"account": "assets:cashier"}', False),
        (b"/t", (), '{"account":"자산:현금"}'.encode(), True),
        (b"/t", (), json.dumps({"account": "자산:현금"}).encode(), True),
        (b"/t", FORM, b"account=assets%3Acash&amount=1", True),
        (b"/t", FORM, b"memo=assets%3Acash+and+more", False),
        (b"/t", FORM, b"a=1&" * 2000, False),
    ],
)
def test_an_account_is_named_by_a_whole_part(
    path: bytes, headers: tuple[tuple[bytes, bytes], ...], body: bytes, *, named: bool
) -> None:
    assert Accounts({"assets:cash", "자산:현금"}).named_in(path, headers, body) is named
