"""Reads OFX statements (1.x as SGML, 2.x as XML, and QFX, which is OFX): one row for each STMTTRN, columns named by its tags.

A reader of its own that knows tags and nothing else: in 1.x leaf tags are not closed, so no XML parser reads it, and
what an XML parser can do besides (types of documents, entities, things fetched from elsewhere) nobody wants from a
stranger's file. A document type is refused, and of entities only the five of XML, the blank and numbers are known.
Nothing nests deeper than a flag, so that no file can exhaust the reader. Not chosen: ofxtools and ofxparse; the one
is GPL, the other brings a parser of HTML.
"""

import html
import re
from collections.abc import Iterator
from typing import Final

from core.imports.reading.raw import RawTable
from core.imports.reading.table import Row, Unreadable, Why

#: The columns, in the field's own names; `CURRENCY` is the statement's, or that of the one transaction.
COLUMNS: Final = (
    "DTPOSTED",
    "TRNAMT",
    "NAME",
    "MEMO",
    "TRNTYPE",
    "CHECKNUM",
    "FITID",
    "CURRENCY",
    "ACCTID",
)
_MARK: Final = re.compile(
    r"\s*(?:OFXHEADER\s*:|(?:<\?xml[^>]*>\s*)?(?:<!--.*?-->\s*)?<\??OFX\b)", re.IGNORECASE | re.DOTALL
)
_TAG: Final = re.compile(r"<(/?)([A-Za-z][A-Za-z0-9._]*)\s*/?>([^<]*)")
_FORBIDDEN: Final = re.compile(r"<!(?:DOCTYPE|ENTITY|\[CDATA\[)", re.IGNORECASE)
_ENTITY: Final = re.compile(r"&(?:amp|lt|gt|quot|apos|nbsp|#[0-9]{1,7}|#x[0-9A-Fa-f]{1,6});")
_CHARSET: Final = re.compile(rb"^\s*CHARSET\s*:\s*([A-Za-z0-9_-]+)", re.IGNORECASE | re.MULTILINE)
_CODING: Final = re.compile(rb"<\?xml[^>]*\bencoding\s*=\s*[\"']([A-Za-z0-9_-]+)", re.IGNORECASE)
_CHARSETS: Final = {
    b"1252": "windows-1252",
    b"windows-1252": "windows-1252",
    b"iso-8859-1": "iso-8859-1",
    b"8859-1": "iso-8859-1",
    b"949": "cp949",
    b"cp949": "cp949",
    b"ks_c_5601-1987": "cp949",
    b"euc-kr": "cp949",
    b"932": "cp932",
    b"shift_jis": "cp932",
    b"utf-8": "utf-8",
}
_TRANSACTION: Final = "STMTTRN"
_STATEMENTS: Final = frozenset({"STMTRS", "CCSTMTRS", "INVSTMTRS"})
# Whose account and name stand in them is another's, or the amount is already converted.
_OTHERS: Final = frozenset({"BANKACCTTO", "CCACCTTO", "ORIGCURRENCY", "LEDGERBAL", "AVAILBAL", "STMTTRNP"})
_HEAD_BYTES: Final = 1_024
_TAIL: Final = re.compile(r"[.\[].*")
_NOUGHTS: Final = re.compile(r"(\.[0-9]{2,}?)0+$")


def is_ofx(text: str) -> bool:
    """Whether a text is an OFX file, by how it begins."""
    return _MARK.match(text) is not None


def encoding_said(data: bytes) -> str | None:
    """The encoding that the head of an OFX file names, as a key of `lettering.ENCODINGS`; None where it names none."""
    head = data[:_HEAD_BYTES]
    found = _CODING.search(head) or (_CHARSET.search(head) if b"OFXHEADER" in head.upper() else None)
    return None if found is None else _CHARSETS.get(found[1].lower())


def read_ofx(text: str) -> RawTable | Unreadable:
    """The transactions of all statements in the file, in order; a document type or an entity of its own is refused."""
    if _FORBIDDEN.search(text):
        return Unreadable(Why.UNSUPPORTED)
    rows = tuple(_transactions(text))
    return RawTable(None, (Row(1, COLUMNS), *rows)) if rows else Unreadable(Why.NO_TABLE)


def _transactions(text: str) -> Iterator[Row]:
    """Walk over the tags once: what belongs to the statement stays until the next one, the rest to its transaction."""
    statement: dict[str, str] = {}
    now: dict[str, str] | None = None
    elsewhere = ""
    line, begun, at = 1, 1, 0
    for tag in _TAG.finditer(text):
        line, at = line + text.count("\n", at, tag.start()), tag.start()
        closes, name = tag[1] == "/", tag[2].upper()
        if elsewhere:
            elsewhere = "" if closes and name == elsewhere else elsewhere
        elif name in _OTHERS and not closes:
            elsewhere = name
        elif name in _STATEMENTS:
            statement = {}
        elif name == _TRANSACTION:
            if now is not None:
                yield _row(begun, statement, now)
            now, begun = (None, 0) if closes else ({}, line)
        elif not closes and (value := _value(tag[3])):
            (statement if now is None else now).setdefault(name, value)
    if now is not None:
        yield _row(begun, statement, now)


def _row(line: int, statement: dict[str, str], now: dict[str, str]) -> Row:
    settled = {
        **now,
        "DTPOSTED": _TAIL.sub("", now.get("DTPOSTED", "")),
        "TRNAMT": _amount(now.get("TRNAMT", "")),
        # In SGML a CURRENCY is an aggregate, of which the symbol is a tag of its own.
        "CURRENCY": now.get("CURSYM") or statement.get("CURDEF", ""),
        "ACCTID": statement.get("ACCTID", ""),
    }
    return Row(line, tuple(settled.get(column, "") for column in COLUMNS))


def _amount(text: str) -> str:
    """The amount with a point: OFX knows no thousands, so a single comma is a decimal mark wherever it stands."""
    single = text.count(",") == 1 and "." not in text
    return _NOUGHTS.sub(r"\1", text.replace(",", ".") if single else text)


def _value(text: str) -> str:
    return _ENTITY.sub(lambda entity: html.unescape(entity[0]), text).strip()
