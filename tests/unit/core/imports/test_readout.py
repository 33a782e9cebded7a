import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.imports.reading.candidates import Candidate
from core.imports.reading.limits import ReadingLimits
from core.imports.reading.readout import Readout, read
from core.imports.reading.table import CELL_CHARACTERS_MAX, Container, Note, Unreadable, Why
from tests.unit.core.imports.files import (
    CHASE,
    bomb,
    locked,
    old_workbook,
    results,
    seen,
    table,
    workbook,
)

ROWS = "거래일자,내용,금액\n2026-01-02,가상똠방,-4500\n"
SHEET = [["거래일자", "내용", "금액"], ["2026-01-02", "가상", -4500]]


def why(data: bytes | str, encoding: str | None = None, password: str | None = None) -> Why:
    made = seen(data, encoding, password)
    assert isinstance(made, Unreadable), made
    return made.reason


@pytest.mark.parametrize(
    ("codec", "told"),
    [
        ("utf-8", "utf-8"),
        ("utf-8-sig", "utf-8"),
        ("utf-16", "utf-16"),
        ("cp949", "cp949"),
    ],
)
def test_an_encoding_is_found_from_the_bytes(codec: str, told: str) -> None:
    held = table(ROWS.encode(codec))
    assert held.head.encoding == told
    assert held.columns == ("거래일자", "내용", "금액")
    assert next(iter(held.rows())).cells[1] == "가상똠방"
    assert held.head.notes == ()


def test_an_encoding_that_was_only_guessed_is_said_to_be_a_guess() -> None:
    held = table("Date,Description,Amount\n2026-01-02,Café,-4.50\n".encode("cp1252"))
    assert held.head.encoding == "windows-1252"
    assert held.head.notes == (Note.ENCODING_GUESSED,)


def test_a_person_may_name_the_encoding_and_is_told_when_it_is_wrong() -> None:
    assert table(ROWS.encode("cp949"), "euc-kr").columns[0] == "거래일자"
    assert why(ROWS.encode("cp949"), "utf-8") is Why.WRONG_ENCODING
    assert why(ROWS.encode(), "klingon") is Why.UNKNOWN_ENCODING


@pytest.mark.parametrize("mark", [",", ";", "\t", "|"])
def test_the_delimiter_is_the_one_that_gives_the_best_header(mark: str) -> None:
    held = table("은행, 지점; 이름\n\n" + 'Date|Payee|Amount\n2026-01-02|"a, b; c"|1\n'.replace("|", mark))
    assert held.columns == ("Date", "Payee", "Amount")
    assert held.head.header_line == 3
    assert next(iter(held.rows())).cells[1] == "a, b; c"


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r", "\r\r\n"])
def test_every_line_end_ends_a_line(end: str) -> None:
    held = table(ROWS.replace("\n", end))
    assert [row.line for row in held.rows()] == [2]


def test_a_line_break_inside_quotes_stays_in_its_cell_and_lines_are_counted_on() -> None:
    held = table('Date,Payee,Amount\r\n2026-01-02,"a\r\nb",1\r\n2026-01-03,c,2\r\n')
    assert [(row.line, row.cells[1]) for row in held.rows()] == [(2, "a\nb"), (4, "c")]


def test_a_delimiter_too_many_and_cells_too_few_do_no_harm() -> None:
    held = table("Date,Payee,Amount\n2026-01-02,a,1,\n2026-01-03,b\n")
    assert [row.cells for row in held.rows()] == [("2026-01-02", "a", "1"), ("2026-01-03", "b", "")]


def test_a_quotation_mark_that_never_closes_is_told_with_its_line() -> None:
    data = 'Date,Payee,Amount\n2026-01-02,a,1\n2026-01-03,"b,1\n' + "2026-01-04,c,1\n" * 1_000
    assert seen(data) == Unreadable(Why.CELL_TOO_LONG, 3)


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", Why.EMPTY),
        (b"\n \r\n", Why.EMPTY),
        (b"\xef\xbb\xbf", Why.EMPTY),
        (b"abc", Why.NO_TABLE),
        (b"\x00\x01\x02", Why.BINARY),
        (b"hello\x00world,1,2\n", Why.BINARY),
        (random.Random(7).randbytes(5_000), Why.BINARY),
        (b"%PDF-1.7 ...", Why.UNSUPPORTED),
        (b"\x89PNG\r\n\x1a\n....", Why.UNSUPPORTED),
        (b"\x1f\x8b\x08....", Why.UNSUPPORTED),
        (b"PK\x03\x04 this is no zip", Why.UNREADABLE),
        (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1 this is no workbook", Why.UNREADABLE),
        (b"<?xml version='1.0'?><Workbook><Table/></Workbook>", Why.UNSUPPORTED),
        (b"<html><body>Please log in</body></html>", Why.NO_TABLE),
        (b"<html><table></table></html>", Why.NO_TABLE),
        ("거래일자".encode("utf-16")[:-1], Why.WRONG_ENCODING),
        (b",".join([b"a"] * 101) + b"\n", Why.TOO_MANY_COLUMNS),
    ],
)
def test_a_file_that_holds_no_table_is_told_why(data: bytes, reason: Why) -> None:
    assert why(data) is reason


def test_a_file_over_the_limit_is_not_opened() -> None:
    assert read(b"x" * 11, (), ReadingLimits(file_bytes_max=10)) == Unreadable(Why.TOO_LARGE)


def test_too_many_rows_are_told_and_not_cut_off() -> None:
    assert why("Date,Amount\n" + "2026-01-02,1\n" * 200_100) is Why.TOO_MANY_ROWS


def test_a_table_without_a_header_gets_letters_and_can_be_mapped_by_hand() -> None:
    data = "2026-01-02,가상서점,1200\n2026-01-03,가상다방,4500\n"
    held = table(data)
    assert held.head.header_line is None
    assert held.columns == ("[A]", "[B]", "[C]")
    assert Note.NO_HEADER in held.head.notes
    made = results(data, "KRW", description="[B]", amount="[C]")
    assert [result.amount for result in made if isinstance(result, Candidate)] == ["1200", "4500"]


def test_a_header_in_words_nobody_knows_is_found_by_its_shape() -> None:
    held = table("Konto 7\n\nPvm,Saaja,Määrä\n2026-01-02,Kauppa,1\n")
    assert held.columns == ("Pvm", "Saaja", "Määrä")


def test_a_number_that_lost_its_digits_is_pointed_out() -> None:
    assert Note.EXPONENT in table("Date,Payee,Amount,Ref\n2026-01-02,a,1,6.1E+25\n").head.notes


HTML = """<html><head><meta charset="euc-kr"><script>var a = "<table>";</script></head><body>
<table><tr><td>메뉴</td><td>도움말</td></tr></table>
<table><tr><td><table>
<tr><th rowspan="1">거래일시</th><th>적요</th><th colspan="2">보낸분/받는분</th><th>출금액</th><th>입금액</th></tr>
<tr><td rowspan="2">2026.06.02</td><td>체크<br>카드</td><td>가상분식<script>alert(1)</script></td><td>비고</td>
<td>4,500</td><td>0</td></tr>
<tr><td>이체</td><td>&lt;script&gt;alert(1)&lt;/script&gt;</td><td></td><td>0</td><td>1,000</td></tr>
</table></td></tr></table></body></html>"""


def test_an_html_table_named_xls_is_read_from_the_table_with_the_best_header() -> None:
    held = table(HTML.encode("cp949"))
    assert held.head.container is Container.HTML
    assert held.head.encoding == "cp949"
    assert held.head.sheet == "3"
    assert held.columns == ("거래일시", "적요", "보낸분/받는분", "[D]", "출금액", "입금액")
    assert [row.cells for row in held.rows()] == [
        ("2026.06.02", "체크\n카드", "가상분식", "비고", "4,500", "0"),
        ("2026.06.02", "이체", "<script>alert(1)</script>", "", "0", "1,000"),
    ]


def test_a_page_that_the_parser_gives_up_on_is_refused_and_not_read_in_part() -> None:
    rows = "<tr><td>2026-01-02</td><td>1</td></tr>"
    page = f"<table>{rows}<tr><td>{'<div>' * 400}x</td></tr>{rows}</table>"
    assert why(page) is Why.UNREADABLE


def test_spans_without_measure_do_no_harm() -> None:
    wide = table(
        '<table><tr><td rowspan="999999999">Date</td><td colspan="99999999">Amount</td></tr></table>'
    )
    assert wide.columns == ("Date", "Amount")
    assert isinstance(seen("<table>" + "<tr><td>" * 5_000), Readout | Unreadable)


def test_a_workbook_is_read_from_the_sheet_with_the_best_header() -> None:
    cover = [["뱅샐현황", "2026"], ["총자산", 1]]
    data = workbook(cover, SHEET, names=["뱅샐현황", "가계부 내역"])
    held = table(data)
    assert held.head.container is Container.XLSX
    assert held.head.sheet == "가계부 내역"
    assert held.head.encoding is None
    assert [row.cells for row in held.rows()] == [("2026-01-02", "가상", "-4500")]


def test_a_hidden_sheet_is_not_read() -> None:
    assert why(workbook(SHEET, [["a"]], names=["숨김", "보임"], hidden="숨김")) is Why.NO_TABLE


def test_columns_that_are_empty_are_left_out_and_the_others_keep_their_letter() -> None:
    rows: list[list[object]] = [[None, None, "거래일자", None, "금액"], [None, 7, "2026-01-02", None, -1]]
    assert table(workbook(rows)).columns == ("[B]", "거래일자", "금액")


def test_an_old_workbook_is_read_whatever_it_is_called() -> None:
    held = table(old_workbook([["거래일자", "내용", "금액"], ["2026-01-02", "가상", -4500.0]]))
    assert held.head.container is Container.XLS
    assert [row.cells for row in held.rows()] == [("2026-01-02", "가상", "-4500")]


def test_a_locked_workbook_asks_for_its_password_and_knows_the_wrong_one() -> None:
    data = locked(workbook(SHEET), "900101")
    assert why(data) is Why.LOCKED
    assert why(data, password="") is Why.LOCKED
    assert why(data, password="900102") is Why.WRONG_PASSWORD
    assert why(data, password="9" * 10_000) is Why.WRONG_PASSWORD
    held = table(data, password="900101")
    assert held.head.container is Container.XLSX
    assert held.head.row_count == 1


def test_a_zip_that_declares_to_be_a_bomb_is_not_unpacked() -> None:
    data = bomb(64 << 20)
    assert len(data) < 200_000
    assert why(data) is Why.ZIP_BOMB


def test_a_zip_that_holds_no_workbook_is_told() -> None:
    assert why(workbook(SHEET).replace(b"xl/workbook.xml", b"xl/workbooK.xml")) is Why.UNSUPPORTED


def test_a_cell_of_a_workbook_that_is_too_long_is_cut_and_pointed_out() -> None:
    held = table(workbook([["거래일자", "내용", "금액"], ["2026-01-02", "가" * 9_000, 1]]))
    assert len(next(iter(held.rows())).cells[1]) == CELL_CHARACTERS_MAX
    assert held.head.notes == (Note.CELL_CUT,)


@given(st.binary(max_size=300))
def test_no_bytes_make_the_reading_stumble(data: bytes) -> None:
    assert isinstance(seen(data), Readout | Unreadable)


@given(st.text(alphabet='",;\t\n\r\x00a1.-2026/거래일금액<>&', max_size=200))
def test_no_text_makes_the_reading_stumble(text: str) -> None:
    made = seen(CHASE + text)
    if isinstance(made, Readout):
        assert len(list(results(made))) == made.head.row_count


@given(st.text(alphabet="<>/tablerdhspnco=\"'12 ", max_size=200))
def test_no_markup_makes_the_reading_stumble(text: str) -> None:
    assert isinstance(seen("<table><tr><td>a</td><td>b</td></tr>" + text), Readout | Unreadable)
