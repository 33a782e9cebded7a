"""Files as banks give them, made by code: nothing here was ever anybody's account."""

import asyncio
import io
import struct
import zipfile
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Final

import msgspec
import msoffcrypto.format.ooxml  # type: ignore[import-untyped]  # it has no types
import openpyxl

from core.imports.reading.balance import BalanceCheck, BalanceVerdict
from core.imports.reading.candidates import Result
from core.imports.reading.child import read_in_child
from core.imports.reading.formats import builtin_formats
from core.imports.reading.kept import ReadTable
from core.imports.reading.limits import ReadingLimits
from core.imports.reading.proposal import propose
from core.imports.reading.readout import Readout, read
from core.imports.reading.rows import parse_rows
from core.imports.reading.table import Table, Unreadable

CHASE: Final = "Transaction Date,Post Date,Description,Category,Type,Amount,Memo\n"
LIMITS: Final = ReadingLimits()


def seen(data: bytes | str, encoding: str | None = None, password: str | None = None) -> Readout | Unreadable:
    """Read in this process, as the child does."""
    raw = data.encode() if isinstance(data, str) else data
    return read(raw, builtin_formats().values(), LIMITS, encoding=encoding, password=password)


def table(data: bytes | str, encoding: str | None = None, password: str | None = None) -> Readout:
    made = seen(data, encoding, password)
    assert isinstance(made, Readout), made
    return made


def results(data: bytes | str | Table, currency: str | None = None, **changes: Any) -> list[Result]:
    """What the rows become with the proposed mapping, changed where `changes` says so."""
    held = table(data) if isinstance(data, bytes | str) else data
    proposal = propose(held, builtin_formats())
    mapping = msgspec.structs.replace(proposal.mapping, **changes)
    format_ = builtin_formats()[proposal.format] if proposal.format else None
    return list(parse_rows(held, mapping, format_, currency, format_))


def in_child(
    folder: Path,
    data: bytes,
    *,
    encoding: str | None = None,
    password: str | None = None,
    limits: ReadingLimits = LIMITS,
) -> ReadTable | Unreadable:
    file = folder / "given"
    file.write_bytes(data)
    out = folder / "rows"
    return asyncio.run(read_in_child(file, encoding=encoding, password=password, out=out, limits=limits))


def workbook(*sheets: Sequence[Any], names: Sequence[str] = (), hidden: str | None = None) -> bytes:
    book = openpyxl.Workbook()
    first = book.active
    assert first is not None
    book.remove(first)
    for number, rows in enumerate(sheets):
        sheet = book.create_sheet(names[number] if names else f"Sheet{number + 1}")
        if sheet.title == hidden:
            sheet.sheet_state = "hidden"
        for row in rows:
            sheet.append(list(row))
    made = io.BytesIO()
    book.save(made)
    return made.getvalue()


def locked(data: bytes, password: str) -> bytes:
    made = io.BytesIO()
    msoffcrypto.format.ooxml.OOXMLFile(io.BytesIO(data)).encrypt(password, made)
    return made.getvalue()


def bomb(unpacked_bytes: int) -> bytes:
    """A workbook of a few kilobytes that unpacks to far more, and says so."""
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("[Content_Types].xml", "<Types/>")
        archive.writestr("xl/workbook.xml", "<workbook/>")
        with archive.open("xl/worksheets/sheet1.xml", "w") as sheet:
            for _ in range(unpacked_bytes >> 20):
                sheet.write(b" " * (1 << 20))
    return made.getvalue()


def far_corner() -> bytes:
    """A workbook of two cells, one of them in the last row and the last column there is."""
    data = workbook([["거래일시", "금액"]])
    made = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(made, "w") as new:
        for name in old.namelist():
            text = old.read(name)
            if name == "xl/worksheets/sheet1.xml":
                corner = b'<row r="1048576"><c r="XFD1048576"><v>1</v></c></row></sheetData>'
                text = text.replace(b"</sheetData>", corner)
            new.writestr(name, text)
    return made.getvalue()


def old_workbook(rows: Iterable[Sequence[str | float]]) -> bytes:
    """A workbook of before 2007 (BIFF8 in an OLE file), small enough for one table of sectors."""
    cells = b"".join(
        _cell(row, column, value) for row, values in enumerate(rows) for column, value in enumerate(values)
    )
    bound = struct.pack("<IBBBB", 0, 0, 0, 1, 0) + b"S"
    start = _record(0x0809, struct.pack("<HHHHII", 0x0600, 5, 0, 0, 0, 0))
    position = len(start) + 4 + len(bound) + 4
    bound = struct.pack("<I", position) + bound[4:]
    sheet = _record(0x0809, struct.pack("<HHHHII", 0x0600, 0x10, 0, 0, 0, 0)) + cells + _record(0x0A, b"")
    return _ole(start + _record(0x85, bound) + _record(0x0A, b"") + sheet)


def _record(kind: int, body: bytes) -> bytes:
    return struct.pack("<HH", kind, len(body)) + body


def _cell(row: int, column: int, value: str | float) -> bytes:
    place = struct.pack("<HHH", row, column, 0)
    if isinstance(value, str):
        return _record(0x0204, place + struct.pack("<HB", len(value), 1) + value.encode("utf-16-le"))
    return _record(0x0203, place + struct.pack("<d", value))


def _ole(stream: bytes) -> bytes:
    """An OLE file with the stream `Workbook`: header, a sector of the FAT, one of the directory, the stream."""
    sectors = max(8, -(-len(stream) // 512))  # at least 4,096 bytes, or it would belong into the mini stream
    assert sectors <= 126
    end, free = 0xFFFFFFFE, 0xFFFFFFFF
    header = b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(16)
    header += struct.pack("<HHHHH6xIIIIIIIIII", 0x3E, 3, 0xFFFE, 9, 6, 0, 1, 1, 0, 4096, end, 0, end, 0, 0)
    header += struct.pack("<108I", *[free] * 108)
    chain = [0xFFFFFFFD, end, *range(3, 2 + sectors), end]
    fat = struct.pack("<128I", *chain, *[free] * (128 - len(chain)))
    directory = _entry("Root Entry", 5, end, 0, child=1) + _entry("Workbook", 2, 2, sectors * 512)
    directory += (_entry("", 0, 0, 0) * 2)[:256]
    return header + fat + directory + stream.ljust(sectors * 512, b"\0")


def balance_of(made: Iterable[Result]) -> BalanceVerdict:
    check = BalanceCheck()
    for result in made:
        check.see(result)
    return check.verdict


def _entry(name: str, kind: int, start: int, size: int, child: int = 0xFFFFFFFF) -> bytes:
    spelled = (name + "\0").encode("utf-16-le") if name else b""
    none = 0xFFFFFFFF
    head = spelled.ljust(64, b"\0") + struct.pack("<HBBIII", len(spelled), kind, 1, none, none, child)
    return (head + bytes(36) + struct.pack("<IQ", start, size)).ljust(128, b"\0")
