import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.ledger.money import (
    INT64_MAX,
    INT64_MIN,
    ISO_4217_DIGITS,
    digits_of,
    format_amount,
    is_currency,
    parse_amount,
)
from core.ledger.reasons import Reason

CODES = st.sampled_from(["KRW", "USD", "KWD", "CLF", "VBMPX", "VACHR"])


@given(st.integers(INT64_MIN, INT64_MAX), CODES)
def test_every_stored_amount_is_written_and_read_as_itself(minor: int, code: str) -> None:
    assert parse_amount(format_amount(minor, code), code) == minor


@pytest.mark.parametrize(
    ("text", "code", "minor"),
    [
        ("12000", "KRW", 12_000),
        ("-12.3", "USD", -1_230),
        ("12", "USD", 1_200),
        ("1.005", "KWD", 1_005),
        ("0.25", "VBMPX", 250_000),
        ("-0", "KRW", 0),
    ],
)
def test_an_amount_is_read_in_the_minor_units_of_its_currency(text: str, code: str, minor: int) -> None:
    assert parse_amount(text, code) == minor


@pytest.mark.parametrize(
    ("text", "code", "reason"),
    [
        ("1.5", "KRW", Reason.TOO_MANY_DIGITS),
        ("1.005", "USD", Reason.TOO_MANY_DIGITS),
        ("1.000", "USD", Reason.TOO_MANY_DIGITS),
        ("9223372036854775808", "KRW", Reason.OUT_OF_RANGE),
        ("92233720368547758.08", "USD", Reason.OUT_OF_RANGE),
        ("9" * 41, "KRW", Reason.TOO_LONG),
        *[
            (text, "USD", Reason.MALFORMED)
            for text in ("", "+1", "1,000", "1e3", "NaN", ".5", "5.", "01", " 1", "1 ", "１", "--1", "1\n")
        ],
    ],
)
def test_what_is_no_amount_of_the_currency_is_refused_with_its_reason(
    text: str, code: str, reason: Reason
) -> None:
    assert parse_amount(text, code) is reason


def test_an_amount_is_shown_with_all_digits_of_its_currency() -> None:
    assert [format_amount(-5, code) for code in ("KRW", "USD", "KWD", "VBMPX")] == [
        "-5",
        "-0.05",
        "-0.005",
        "-0.000005",
    ]


def test_codes_outside_iso_4217_are_currencies_with_six_digits() -> None:
    assert is_currency("VBMPX")
    assert "VBMPX" not in ISO_4217_DIGITS
    assert digits_of("VBMPX") == 6


@pytest.mark.parametrize("code", ["", "krw", "1KR", "K" * 25, "K W", "KRW\n", "원"])
def test_what_can_be_no_code_is_no_currency(code: str) -> None:
    assert not is_currency(code)
