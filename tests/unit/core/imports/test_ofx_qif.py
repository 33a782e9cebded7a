"""OFX and QIF become the same kind of table as everything else, and what could harm the reader is refused."""

from typing import Any

import pytest

from core.imports.reading.candidates import Candidate, Refusal, RefusedRow
from core.imports.reading.fingerprints import fingerprint
from core.imports.reading.formats import builtin_formats
from core.imports.reading.mapping import DateOrder
from core.imports.reading.proposal import propose
from core.imports.reading.table import Container, Unreadable, Why
from tests.unit.core.imports.files import results, seen, table

HEAD = "OFXHEADER:100\nDATA:OFXSGML\nENCODING:USASCII\nCHARSET:{charset}\n\n"
STATEMENT = (
    "<OFX><BANKMSGSRSV1><STMTTRNRS><STMTRS><CURDEF>EUR<BANKACCTFROM><ACCTID>0001234</BANKACCTFROM>"
    "<BANKTRANLIST>{rows}</BANKTRANLIST></STMTRS></STMTTRNRS></BANKMSGSRSV1></OFX>"
)
ROW = "<STMTTRN><TRNTYPE>DEBIT<DTPOSTED>20260405120000<TRNAMT>{amount}<FITID>{id}<NAME>{name}</STMTTRN>\n"


def ofx(*rows: str, charset: str = "1252") -> str:
    return HEAD.format(charset=charset) + STATEMENT.format(rows="".join(rows))


def row(name: str = "SAMPLE", amount: str = "-1.00", fitid: str = "7") -> str:
    return ROW.format(name=name, amount=amount, id=fitid)


def candidates(data: bytes | str, **changes: Any) -> list[Candidate]:
    return [one for one in results(data, **changes) if isinstance(one, Candidate)]


def qif(*records: str, kind: str = "Bank") -> str:
    return "\n".join([f"!Type:{kind}", *(f"{record}\n^" for record in records)]) + "\n"


def test_an_xml_statement_reads_as_a_tagged_one_does() -> None:
    closed = (
        '<?xml version="1.0" encoding="UTF-8"?>\n<?OFX OFXHEADER="200" VERSION="211"?>\n<OFX><STMTRS><CURDEF>EUR</CURDEF>'
        "<BANKACCTFROM><ACCTID>0001234</ACCTID></BANKACCTFROM><BANKTRANLIST><STMTTRN><TRNTYPE>DEBIT</TRNTYPE>"
        "<DTPOSTED>20260405120000</DTPOSTED><TRNAMT>-1.00</TRNAMT><FITID>7</FITID><NAME>SAMPLE</NAME></STMTTRN>"
        "</BANKTRANLIST></STMTRS></OFX>"
    )
    held = table(closed)
    assert held.head.container is Container.OFX
    [one], [other] = candidates(closed), candidates(ofx(row()))
    assert (one.date, one.amount, one.identity) == (other.date, other.amount, other.identity)


@pytest.mark.parametrize(
    ("charset", "written"), [("949", "cp949"), ("1252", "cp949"), ("1252", "utf-8"), ("NONE", "cp949")]
)
def test_an_encoding_that_is_said_or_found_gives_korean_names(charset: str, written: str) -> None:
    [one] = candidates(ofx(row("가상다방"), charset=charset).encode(written))
    assert one.description == "가상다방"


def test_a_file_that_names_its_encoding_is_no_guess() -> None:
    held = table(ofx(row("CAFÉ"), charset="1252").encode("cp1252"))
    assert held.head.encoding == "windows-1252"
    assert held.head.notes == ()


def test_the_bank_s_own_id_makes_a_row_known_again_although_its_text_has_changed() -> None:
    [before], [after] = candidates(ofx(row("PENDING SAMPLE"))), candidates(ofx(row("SAMPLE SHOP")))
    assert fingerprint("bank", before) == fingerprint("bank", after)


def test_two_rows_under_one_bank_id_are_two_rows() -> None:
    first, second = candidates(ofx(row(amount="-1.00"), row(amount="-2.00")))
    twin, other = candidates(ofx(row(), row()))
    assert fingerprint("bank", first) != fingerprint("bank", second)
    assert fingerprint("bank", twin) != fingerprint("bank", other)


def test_the_other_side_s_account_is_not_the_statement_s() -> None:
    held = table(ofx(row().replace("</STMTTRN>", "<BANKACCTTO><ACCTID>9999</BANKACCTTO></STMTTRN>")))
    assert [one.cells[held.columns.index("ACCTID")] for one in held.rows()] == ["0001234"]


@pytest.mark.parametrize("top", ['<!DOCTYPE x [<!ENTITY a "b">]>', '<!ENTITY a SYSTEM "file:///etc/passwd">'])
def test_a_document_type_is_refused(top: str) -> None:
    assert seen(f'<?xml version="1.0"?><OFX>{top}</OFX>' + ofx(row())) == Unreadable(Why.UNSUPPORTED)


def test_entities_nobody_knows_stay_as_they_are_written() -> None:
    [one] = candidates(ofx(row("A &amp; B &lt;c&gt; &#233; &bomb;")))
    assert one.description == "A & B <c> é &bomb;"


def test_a_statement_without_transactions_says_so() -> None:
    assert seen(ofx()) == Unreadable(Why.NO_TABLE)


def test_a_list_of_records_becomes_rows_with_its_own_words() -> None:
    made = qif("D01/23/2026\nPSample Payee\nT-1,010.00\nMlunch\nLFood:Coffee", "D1/ 3'26\nT5.00\nL[Savings]")
    first, second = candidates(made, currency_code="USD")
    assert (first.date, first.amount, first.category) == ("2026-01-23", "-1010.00", "Food:Coffee")
    assert first.description == "Sample Payee"
    assert (second.date, second.amount, second.category) == ("2026-01-03", "5.00", None)


def test_an_order_of_dates_that_a_list_leaves_open_is_asked_for() -> None:
    held = table(qif("D01/02/2026\nT1.00", "D03/04/2026\nT1.00", kind="CCard"))
    assert propose(held, builtin_formats()).mapping.date_format is None
    made = results(held, currency_code="USD", date_format=DateOrder.DMY)
    assert [one.date for one in made if isinstance(one, Candidate)] == ["2026-02-01", "2026-04-03"]


def test_lists_that_move_no_money_are_passed_over() -> None:
    made = "!Type:Cat\nNFood\nE\n^\n!Account\nNChecking\nTBank\n^\n" + qif("D23/01/2026\nT-1.00", kind="Cash")
    assert table(made).head.row_count == 1
    assert seen("!Type:Invst\nD01/01/2026\nNBuy\n^\n") == Unreadable(Why.NO_TABLE)


def test_parts_of_a_split_stay_readable_and_are_no_category() -> None:
    held = table(qif("D23/01/2026\nT-3.00\nLFood\nSFood\n$-1.00\nSHome\nEsoap\n$-2.00"))
    [line] = held.rows()
    assert line.cells[held.columns.index("Split")] == "Food -1.00; Home soap -2.00"
    assert "Food" not in line.cells


def test_a_row_of_either_that_can_not_be_meant_is_refused_with_its_line() -> None:
    made = results(qif("D30/02/2026\nT-1.00", "D28/02/2026\nTmuch", "D28/02/2026\nT1"), currency_code="USD")
    refused = [(one.line, one.reason) for one in made if isinstance(one, RefusedRow)]
    assert refused == [(2, Refusal.NO_SUCH_DATE), (5, Refusal.BAD_AMOUNT)]
