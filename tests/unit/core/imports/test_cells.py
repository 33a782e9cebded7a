import datetime as dt

import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.imports.reading.amounts import Number, guess_decimal, parse_number, to_minor
from core.imports.reading.candidates import Refusal
from core.imports.reading.dates import guess_order, parse_date
from core.imports.reading.mapping import DateOrder, Decimal
from core.imports.reading.workbooks import text_of

YMD, MDY, DMY = DateOrder.YMD, DateOrder.MDY, DateOrder.DMY


def minor(text: str, currency: str = "KRW", decimal: Decimal = Decimal.POINT) -> int | Refusal:
    number = parse_number(text, decimal)
    return to_minor(number, currency) if isinstance(number, Number) else number


@pytest.mark.parametrize(
    ("text", "won"),
    [
        ("4500", 4500),
        ("4,500", 4500),
        ("-1,234,500", -1234500),
        ("+1250", 1250),
        ("△52000", -52000),
        ("▲1,000", -1000),
        ("(12,000)", -12000),
        ("5,000-", -5000),
        ("−7", -7),
        ("１２，０００원", 12000),
        ("₩4,500", 4500),
        ("-₩4,500", -4500),
        ("₩-4,500", -4500),
        ("(₩4,500)", -4500),
        ("KRW 4500", 4500),
        ("4500 KRW", 4500),
        ("4500.00", 4500),
        ("0", 0),
    ],
)
def test_an_amount_is_read_as_banks_write_it(text: str, won: int) -> None:
    assert minor(text) == won


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("12.5", Refusal.TOO_MANY_DIGITS),
        ("1.000", Refusal.TOO_MANY_DIGITS),
        ("6.1E+25", Refusal.EXPONENT),
        ("1E26", Refusal.EXPONENT),
        ("1,23", Refusal.BAD_AMOUNT),
        ("1,2345", Refusal.BAD_AMOUNT),
        ("1 2", Refusal.BAD_AMOUNT),
        ("--5", Refusal.BAD_AMOUNT),
        ("-5-", Refusal.BAD_AMOUNT),
        ("(5", Refusal.BAD_AMOUNT),
        ("(-5)", Refusal.BAD_AMOUNT),
        ("=1+1", Refusal.BAD_AMOUNT),
        ("열두", Refusal.BAD_AMOUNT),
        ("9" * 30, Refusal.OUT_OF_RANGE),
        ("9" * 5_000, Refusal.BAD_AMOUNT),
    ],
)
def test_what_is_no_amount_is_refused_and_never_rounded(text: str, reason: Refusal) -> None:
    assert minor(text) is reason


def test_the_decimal_mark_is_the_files_and_not_the_cells() -> None:
    assert minor("1.234,56", "EUR", Decimal.COMMA) == 123456
    assert minor("1.000", "EUR", Decimal.COMMA) == 100000
    assert minor("1,234.56", "EUR", Decimal.COMMA) is Refusal.BAD_AMOUNT
    assert minor("1.000", "EUR", Decimal.POINT) is Refusal.TOO_MANY_DIGITS
    assert guess_decimal(["-13,98", "1.446,10", "5"]) is Decimal.COMMA
    assert guess_decimal(["-13.98", "1,446.10", "5"]) is Decimal.POINT
    assert guess_decimal(["4,500", "1,234,000"]) is Decimal.POINT
    assert guess_decimal([]) is Decimal.POINT


@pytest.mark.parametrize(
    ("text", "order", "day"),
    [
        ("2026.05.06 11:40:59", YMD, "2026-05-06"),
        ("2026-05-06T11:40:59+09:00", YMD, "2026-05-06"),
        ("2026/5/6", YMD, "2026-05-06"),
        ("2026. 05. 06.", YMD, "2026-05-06"),
        ("2026년 5월 6일", YMD, "2026-05-06"),
        ("2026.05.06 (수) 오전 9:05", YMD, "2026-05-06"),
        ("2026-05-06 오후 12:30", YMD, "2026-05-06"),
        ("20260506", YMD, "2026-05-06"),
        ("20260506114059", YMD, "2026-05-06"),
        ("26.05.06", YMD, "2026-05-06"),
        ("05/06/2026", MDY, "2026-05-06"),
        ("5/6/2026 3:04 PM", MDY, "2026-05-06"),
        ("06.05.2026", DMY, "2026-05-06"),
        ("06.05.26", DMY, "2026-05-06"),
        ("20260506", DMY, "2026-05-06"),
        ("46148", YMD, "2026-05-06"),
        ("46148.4867", MDY, "2026-05-06"),
    ],
)
def test_a_date_is_read_as_banks_write_it(text: str, order: DateOrder, day: str) -> None:
    assert parse_date(text, order) == day


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("2026-02-30", Refusal.NO_SUCH_DATE),
        ("2025.02.29", Refusal.NO_SUCH_DATE),
        ("20261301", Refusal.NO_SUCH_DATE),
        ("0001-01-01", Refusal.NO_SUCH_DATE),
        ("05/06", Refusal.NO_YEAR),
        ("5월 6일", Refusal.NO_YEAR),
        ("합계", Refusal.BAD_DATE),
        ("2026-05-06 and more", Refusal.BAD_DATE),
        ("1.000", Refusal.BAD_DATE),
        ("", Refusal.NO_DATE),
        ("2026-05-06" * 50, Refusal.BAD_DATE),
    ],
)
def test_a_date_that_is_none_is_refused(text: str, reason: Refusal) -> None:
    assert parse_date(text, YMD) is reason


def test_a_value_over_twelve_decides_between_day_and_month_and_nothing_else_does() -> None:
    assert guess_order(["05/06/2026", "05/13/2026"]) is MDY
    assert guess_order(["05/06/2026", "13/05/2026"]) is DMY
    assert guess_order(["05/06/2026", "07/08/2026"]) is None
    assert guess_order(["13/05/2026", "05/13/2026"]) is None
    assert guess_order(["01.02.03"]) is None
    assert guess_order(["99.12.25"]) is YMD
    assert guess_order(["2026-05-06", "합계"]) is YMD
    assert guess_order(["20260506", "46148"]) is YMD
    assert guess_order([]) is None


def test_a_date_that_does_not_exist_does_not_hide_the_order_of_the_others() -> None:
    assert guess_order(["2026-02-30", "2026-05-06"]) is YMD


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (12000.0, "12000"),
        (-3.46, "-3.46"),
        (0.1 + 0.2, "0.3"),
        (123456789012345.0, "123456789012345"),
        (6.1e25, "6.1e+25"),
        (True, "TRUE"),
        ("=cmd|' /C calc'!A0", "=cmd|' /C calc'!A0"),
        (dt.datetime.fromisoformat("2026-05-06T11:40:58.999997"), "2026-05-06 11:40:59"),
        (dt.date(2026, 5, 6), "2026-05-06"),
        (dt.time(16, 8), "16:08:00"),
        (dt.timedelta(hours=16, minutes=8), "16:08:00"),
    ],
)
def test_a_cell_of_a_workbook_becomes_the_text_a_person_saw(value: object, text: str) -> None:
    assert text_of(value) == text  # type: ignore[arg-type]


@given(st.text(max_size=80), st.sampled_from(Decimal), st.sampled_from(["KRW", "USD", "BHD", "POINTS"]))
def test_no_text_makes_the_reading_of_amounts_stumble(text: str, decimal: Decimal, currency: str) -> None:
    assert isinstance(minor(text, currency, decimal), int | Refusal)


@given(st.text(alphabet="0123456789./-: 년월일오전후TZ+", max_size=70), st.sampled_from(DateOrder))
def test_no_text_makes_the_reading_of_dates_stumble(text: str, order: DateOrder) -> None:
    assert isinstance(parse_date(text, order), str | Refusal)
    guess_order([text])


@given(st.integers(-(10**15), 10**15))
def test_every_amount_comes_back_as_it_was_written(won: int) -> None:
    assert minor(f"{won:,}") == won
    assert minor(f"{won // 100}.{won % 100:02d}" if won >= 0 else str(won), "USD") == (
        won if won >= 0 else won * 100
    )
