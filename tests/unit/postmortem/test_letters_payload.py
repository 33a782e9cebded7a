import json
from typing import Any

import pytest

from postmortem.dead_letters import slip as slips
from postmortem.dead_letters.payload import decoded, sums, without_secrets
from tests.unit.postmortem.letter_slips import posting, request_case, slip


def test_no_header_that_says_who_somebody_is_gets_into_a_letter() -> None:
    found = slips.letter(slip())
    assert found is not None
    assert "canary" not in json.dumps(found.case)
    assert found.case is not None
    assert found.case["request"]["headers"] == [["Content-Type", "application/json"]]


@pytest.mark.parametrize(
    "headers", [None, "x", [["Cookie"]], [[1, 2]], [["Cookie", "canary", "x"]], {"a": 1}]
)
def test_headers_of_another_shape_are_none(headers: object) -> None:
    assert without_secrets(request_case({}, headers=headers))["request"]["headers"] == []


def test_what_goes_in_somewhere_is_added_up_by_currency() -> None:
    postings = [posting("10.50", "USD"), posting("2", "KRW"), posting("-2", "KRW"), posting("0.50", "USD")]
    assert sums({"postings": postings}) == ("2 KRW", "11.00 USD")
    assert sums({"transactions": [{"postings": postings}, {"postings": postings}]}) == ("4 KRW", "22.00 USD")
    assert sums({"amount": "-12000", "currency": "KRW", "account": "x"}) == ("12000 KRW",)


@pytest.mark.parametrize(
    "payload",
    [
        None,
        "x",
        3,
        [],
        {"postings": "x"},
        {"postings": [3]},
        {"amount": 3},
        {"amount": "NaN"},
        {"amount": "x"},
    ],
)
def test_what_moves_nothing_has_no_sum(payload: object) -> None:
    assert sums(payload) == ()


def test_a_short_text_that_is_a_giant_number_is_not_one() -> None:
    assert sums({"amount": "1e999999999", "currency": "KRW"}) == ()


@pytest.mark.parametrize("body", [b"\xff", b"[" * 100_000, b"{", b"1e999", b"NaN", b'"\\ud800"', b""])
def test_whatever_was_sent_can_be_shown_as_json(body: bytes) -> None:
    json.dumps(decoded(request_case(body)), allow_nan=False)


def test_a_form_is_read_as_its_fields() -> None:
    headers = [["content-type", "application/x-www-form-urlencoded"]]
    assert decoded(request_case(b"amount=3&memo=%3Cb%3E", headers=headers)) == {"amount": "3", "memo": "<b>"}


@pytest.mark.parametrize("field", [name for name in slip() if name not in ("id", "name")])
@pytest.mark.parametrize(
    "value", [None, 7, -1, True, "x" * 2_000_000, ["x"] * 9_999, {"a": {}}, [[[]]], 1e308]
)
def test_a_field_of_another_shape_makes_no_letter_disappear(field: str, value: object) -> None:
    found = slips.letter(slip() | {field: value})
    assert found is not None
    assert len(repr(found)) < 500_000 or field == "case"


@pytest.mark.parametrize(
    "wrong", [{"id": "../../x"}, {"id": ""}, {"id": None}, {"name": "x"}, {"name": "A" * 32}]
)
def test_a_letter_without_a_number_or_a_name_is_none(wrong: dict[str, Any]) -> None:
    assert slips.letter(slip(**wrong)) is None


def test_a_lone_surrogate_can_be_stored() -> None:
    found = slips.letter(slip(kind="\ud800"))
    assert found is not None
    found.kind.encode()
