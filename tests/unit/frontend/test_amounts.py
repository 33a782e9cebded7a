import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from frontend.amounts import MINUS, group_digits, read_amount, show_amount
from frontend.render import Language

CASES = json.loads((Path(__file__).parent / "amount_cases.json").read_text())


@pytest.mark.parametrize(("typed", "meant"), CASES["read"])
def test_what_somebody_types_is_read_as_they_mean_it_or_not_at_all(typed: str, meant: str | None) -> None:
    assert read_amount(typed) == meant


@pytest.mark.parametrize(("plain", "grouped"), CASES["group"])
def test_digits_are_grouped_by_three(plain: str, grouped: str) -> None:
    assert group_digits(plain) == grouped


@pytest.mark.parametrize(
    ("amount", "currency", "lang", "shown"),
    [
        ("12000", "KRW", "ko", "12,000원"),
        ("12000", "KRW", "en", "₩12,000"),
        ("1234.50", "USD", "ko", "$1,234.50"),
        ("1234.50", "USD", "en", "$1,234.50"),
        ("-1234.50", "USD", "en", f"{MINUS}$1,234.50"),
        ("-500", "KRW", "ko", f"{MINUS}500원"),
        ("1200", "JPY", "ko", "1,200엔"),
        ("99.90", "CHF", "en", "99.90\N{NO-BREAK SPACE}CHF"),
        ("12.500000", "VTI", "en", "12.5\N{NO-BREAK SPACE}VTI"),
        ("1.000", "KWD", "en", "1.000\N{NO-BREAK SPACE}KWD"),
        ("9223372036854775807", "KRW", "ko", "9,223,372,036,854,775,807원"),
    ],
)
def test_an_amount_is_shown_in_the_way_of_its_currency(
    amount: str, currency: str, lang: Language, shown: str
) -> None:
    assert show_amount(amount, currency, lang) == shown


def test_a_plus_stands_before_what_came_in_and_not_before_nothing() -> None:
    assert show_amount("5", "KRW", "ko", signed=True) == "+5원"
    assert show_amount("0", "KRW", "ko", signed=True) == "0원"
    assert show_amount("0.00", "USD", "en", signed=True) == "$0.00"
    assert show_amount("-5", "KRW", "ko", signed=True) == f"{MINUS}5원"


@given(st.integers(0, 2**63 - 1), st.integers(0, 99))
def test_what_is_shown_is_read_back_digit_by_digit(whole: int, cents: int) -> None:
    amount = f"{whole}.{cents:02d}"
    assert read_amount(show_amount(amount, "USD", "en")) == amount


@given(st.text(max_size=80))
def test_any_text_is_read_without_a_fault(typed: str) -> None:
    meant = read_amount(typed)
    assert meant is None or meant.replace(".", "", 1).isdigit()
