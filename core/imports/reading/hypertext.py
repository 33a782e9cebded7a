"""Reads tables out of HTML, which Korean banks like to call `.xls`.

Every `<table>` is a table of its own; one inside another belongs to itself and not to the cell around it.
Cells that span are spread out first, because `colspan` shifts every column behind it: the text stands in the
first place and the others stay blank, downwards (`rowspan`) it is repeated. Nothing is fetched, nothing is
run; scripts and styles are dropped, and a script that is written as text stays text.
"""

from collections.abc import Iterator
from typing import Final

from lxml import etree, html

from core.imports.reading.formats import SCAN_ROWS_MAX
from core.imports.reading.raw import RawTable
from core.imports.reading.table import COLUMNS_MAX, ROWS_MAX, Row, Unreadable, Why

TABLES_MAX: Final = 200
_CELLS: Final = ("td", "th")
_UNSEEN: Final = frozenset({"script", "style", "template", "noscript", "table"})
_BREAKING: Final = frozenset({"br", "p", "div", "li"})


def read_hypertext(text: str) -> list[RawTable] | Unreadable:
    """The tables of a page that hold anything, in order."""
    # As bytes: lxml refuses a str that carries an encoding declaration, which by now is wrong anyway.
    parser = html.HTMLParser(encoding="utf-8", no_network=True, huge_tree=False, remove_comments=True)
    try:
        page = html.document_fromstring(text.encode("utf-8", "replace"), parser=parser)
    except (etree.LxmlError, ValueError):
        return Unreadable(Why.NO_TABLE)
    # Where the parser gives up (nested too deep) it keeps what it has and is silent: rows would be missing.
    given_up = parser.error_log.filter_from_fatals()
    if len(given_up):
        return Unreadable(Why.UNREADABLE, given_up[0].line)
    found = page.findall(".//table")
    if len(found) > TABLES_MAX:
        return Unreadable(Why.NO_TABLE)
    tables: list[RawTable] = []
    for number, element in enumerate(found, 1):
        rows = tuple(_rows(element))
        if len(rows) > ROWS_MAX + SCAN_ROWS_MAX:
            return Unreadable(Why.TOO_MANY_ROWS)
        if rows:
            tables.append(RawTable(str(number) if len(found) > 1 else None, rows))
    return tables


def _rows(table: html.HtmlElement) -> Iterator[Row]:
    """The rows of this table alone, spans spread out, blank ones left out but counted."""
    # Column -> how many rows below still show a text of above, and that text.
    hanging: dict[int, tuple[int, str]] = {}
    own = (row for row in table.iter("tr") if next(row.iterancestors("table"), None) is table)
    for number, element in enumerate(own, 1):
        cells = _spread(element, hanging)
        if any(cell.strip() for cell in cells):
            yield Row(number, tuple(cells))


def _spread(row: html.HtmlElement, hanging: dict[int, tuple[int, str]]) -> list[str]:
    cells: list[str] = []
    for element in row.iterchildren(*_CELLS):
        _take_hanging(cells, hanging)
        text = _text(element)
        down = _span(element, "rowspan", ROWS_MAX)
        for offset in range(_span(element, "colspan", COLUMNS_MAX)):
            shown = text if offset == 0 else ""
            if down > 1:
                hanging[len(cells)] = (down - 1, shown)
            cells.append(shown)
        if len(cells) > COLUMNS_MAX:
            return cells
    _take_hanging(cells, hanging)
    return cells


def _take_hanging(cells: list[str], hanging: dict[int, tuple[int, str]]) -> None:
    while len(cells) in hanging:
        left, text = hanging.pop(len(cells))
        if left > 1:
            hanging[len(cells)] = (left - 1, text)
        cells.append(text)


def _span(cell: html.HtmlElement, name: str, most: int) -> int:
    text = (cell.get(name) or "1").strip()
    digits = text.isascii() and text.isdigit() and len(text) < 10
    return max(1, min(int(text), most)) if digits else 1


def _text(cell: html.HtmlElement) -> str:
    """What a reader sees in the cell. A walk and not a recursion: nesting is the stranger's to choose."""
    parts: list[str] = [cell.text or ""]
    hidden = 0
    for event, element in etree.iterwalk(cell, events=("start", "end")):
        if element is cell:
            continue
        unseen = element.tag in _UNSEEN
        if event == "start":
            hidden += unseen
            parts.append("" if hidden else _opening(element))
        else:
            hidden -= unseen
            parts.append("" if hidden else element.tail or "")
    return "".join(parts).replace("\xa0", " ").strip()


def _opening(element: html.HtmlElement) -> str:
    return ("\n" if element.tag in _BREAKING else "") + (element.text or "")
