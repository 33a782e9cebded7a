"""Tells from the bytes what a file is. The name it came with is not asked: banks call HTML tables `.xls`."""

import re
from enum import Enum, auto
from typing import Final

from core.imports.reading.ofx import is_ofx
from core.imports.reading.qif import is_qif

_ZIP: Final = (b"PK\x03\x04", b"PK\x05\x06")
_OLE: Final = b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"
# Pictures, papers and archives that people pick by mistake; each deserves a clearer word than "binary".
_OTHERS: Final = (
    b"%PDF-",
    b"\x89PNG",
    b"\xff\xd8\xff",
    b"GIF8",
    b"\x1f\x8b",
    b"7z\xbc\xaf",
    b"Rar!",
    b"BZh",
    b"\x28\xb5\x2f\xfd",
    b"SQLite format 3",
    b"\x7fELF",
)
_MARKUP: Final = re.compile(
    r"\s*(<\?xml[^>]*>\s*)?(<!--.*?-->\s*)?<(!doctype|html|head|meta|body|title|style|script|table|div|form|center)\b",
    re.IGNORECASE | re.DOTALL,
)
_TABLE: Final = re.compile(r"<table\b", re.IGNORECASE)
_XML: Final = re.compile(r"\s*<\?xml\b|\s*<workbook\b", re.IGNORECASE)
_MARKUP_SEEN_CHARACTERS: Final = 4_096


class Packing(Enum):
    """What the first bytes say."""

    ZIP = auto()
    OLE = auto()
    TEXT = auto()
    OTHER = auto()


class Writing(Enum):
    """What a text is."""

    HTML = auto()
    XML = auto()
    OFX = auto()
    QIF = auto()
    DELIMITED = auto()


def packing_of(data: bytes) -> Packing:
    """What kind of file these bytes begin. Anything unknown is taken for text and may turn out to be none."""
    if data.startswith(_ZIP):
        return Packing.ZIP
    if data.startswith(_OLE):
        return Packing.OLE
    return Packing.OTHER if data.startswith(_OTHERS) else Packing.TEXT


def writing_of(text: str) -> Writing:
    """What kind of text this is, by how it begins."""
    top = text[:_MARKUP_SEEN_CHARACTERS]
    if is_ofx(top):
        return Writing.OFX
    if is_qif(top):
        return Writing.QIF
    if _MARKUP.match(top) and _TABLE.search(text):
        return Writing.HTML
    return Writing.XML if _XML.match(top) else Writing.DELIMITED
