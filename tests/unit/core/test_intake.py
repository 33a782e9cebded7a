import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.ledger.commands import NoBody, TransactionBody
from core.ledger.reasons import Reason
from core.web.intake import check_key, decode_body, make_position, read_position
from core.web.problems import Problem, ProblemError

WHOLE = b'{"date":"2026-11-21","description":"d","postings":[{"account":"a","amount":"1","currency":"KRW"}]}'


def refused(body: bytes) -> Problem:
    with pytest.raises(ProblemError) as caught:
        decode_body(body, TransactionBody)
    return caught.value.problem


@pytest.mark.parametrize(
    ("body", "position"),
    [
        (b"", 0),
        (b'{"date":', 8),
        (b"nonsense", 4),
        (b'{"date":"2026-11-21",}', 21),
        (b'{"date":"\xff"}', 9),
        (WHOLE + b" trailing", len(WHOLE) + 2),
        (b'{"date": 5, "x": }', 17),
    ],
)
def test_what_is_no_json_is_told_with_its_place(body: bytes, position: int) -> None:
    problem = refused(body)
    assert (problem.slug, problem.values) == ("malformed-json", {"position": position})


@pytest.mark.parametrize(
    ("body", "pointer", "reason"),
    [
        (b"[]", "", Reason.WRONG_TYPE),
        (b"{}", "/date", Reason.MISSING),
        (WHOLE.replace(b'"1"', b"1"), "/postings/0/amount", Reason.WRONG_TYPE),
        (WHOLE.replace(b'"1"', b"0.1"), "/postings/0/amount", Reason.WRONG_TYPE),
        (WHOLE.replace(b'"1"', b"1e999"), "/postings/0/amount", Reason.WRONG_TYPE),
        (WHOLE.replace(b'"amount":"1",', b""), "/postings/0/amount", Reason.MISSING),
        (WHOLE[:-1] + b',"colour/~":"red"}', "/colour~1~0", Reason.UNKNOWN_FIELD),
        (WHOLE[:-1] + b',"tags":["a",3]}', "/tags/1", Reason.WRONG_TYPE),
        (WHOLE.replace(b'"1"', b'"5","amount":"7"'), "/amount", Reason.NAMED_TWICE),
        (WHOLE[:-1] + b',"date":"2026-11-21"}', "/date", Reason.NAMED_TWICE),
        (b'{"x":' + b"[" * 100_000 + b"]" * 100_000 + b"}", "/x", Reason.UNKNOWN_FIELD),
    ],
)
def test_what_does_not_fit_is_told_with_its_field(body: bytes, pointer: str, reason: Reason) -> None:
    problem = refused(body)
    assert problem.slug == "invalid-body"
    assert [(fault.pointer, fault.reason) for fault in problem.faults] == [(pointer, reason)]


@given(st.binary(max_size=200))
def test_no_bytes_get_past_the_decoder_as_anything_else(body: bytes) -> None:
    with pytest.raises(ProblemError) as caught:
        decode_body(body, TransactionBody)
    assert caught.value.problem.slug in {"malformed-json", "invalid-body"}


def test_an_empty_object_says_nothing_and_is_fine() -> None:
    assert decode_body(b"{}", NoBody) == NoBody()


@pytest.mark.parametrize("key", ["a", "x" * 255, "!~/%?#"])
def test_a_key_is_visible_ascii(key: str) -> None:
    assert check_key(key) == key


@pytest.mark.parametrize("key", ["", "x" * 256, "with space", "tab\t", "키", "a\n", "\x7f"])
def test_anything_else_is_no_key(key: str) -> None:
    with pytest.raises(ProblemError):
        check_key(key)


def test_a_place_in_a_list_by_days_is_a_day_of_the_calendar() -> None:
    assert read_position(make_position("2026-11-21", 7, 0)) == ("2026-11-21", 7, 0)
    for other in ("", "2026-W47-6.7.0", "20261121.7.0", "2026-02-30.7.0", "2026-11-21.7", "2026-11-21.-1.0"):
        assert read_position(other) is None, other
