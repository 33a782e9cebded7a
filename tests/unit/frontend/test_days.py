import datetime as dt

from frontend.days import month_beside, show_day, show_month

TODAY = dt.date(2026, 11, 22)


def test_a_day_leaves_out_the_year_that_it_is() -> None:
    assert show_day("2026-11-21", "ko", TODAY) == "11월 21일 토요일"
    assert show_day("2026-11-21", "en", TODAY) == "Sat, Nov 21"
    assert show_day("2025-01-05", "ko", TODAY) == "2025년 1월 5일 일요일"
    assert show_day("2025-01-05", "en", TODAY) == "Sun, Jan 5 2025"


def test_a_month_has_its_year() -> None:
    assert show_month("2026-03", "ko") == "2026년 3월"
    assert show_month("2026-03", "en") == "March 2026"


def test_the_month_beside_crosses_years_and_stays_in_the_calendar() -> None:
    assert month_beside("2026-01", -1) == "2025-12"
    assert month_beside("2026-12", 1) == "2027-01"
    assert month_beside("0001-01", -1) == "0001-01"
    assert month_beside("9999-12", 1) == "9999-12"
