"""How names of columns and words in cells are compared, and how columns get unique names.

Banks write the same header with full-width letters, with line breaks inside, decomposed (a file that went
through macOS) or with blanks. Compared is therefore NFKC without any white space and without case. Brackets
stay: an amount in (USD) is not the amount.
"""

import re
import unicodedata
from collections.abc import Sequence
from functools import lru_cache
from typing import Final

NAME_CHARACTERS_MAX: Final = 200

_REMEMBERED_CHARACTERS_MAX: Final = 40
_TWIN: Final = re.compile(r"#\d+$")
_LETTERED: Final = re.compile(r"\[[A-Z]{1,3}\]")
# Invisible characters that turn the direction of a line around or hide in it: no bank means them.
_UNSEEN: Final = re.compile(
    "[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u00ad\u200b\u2028-\u202e\u2060-\u2069\ufeff]"
)


def canonical(text: str) -> str:
    """`text` as it is compared: NFKC, no white space, no invisible characters, no case."""
    return _remembered(text) if len(text) <= _REMEMBERED_CHARACTERS_MAX else _made_canonical(text)


def _made_canonical(text: str) -> str:
    return "".join(_UNSEEN.sub("", unicodedata.normalize("NFKC", text)).split()).casefold()


# A file says the same few words in every row; long cells are no words and are not kept.
_remembered = lru_cache(maxsize=4_096)(_made_canonical)


def tidy(text: str, characters_max: int) -> str:
    """`text` on one line, without control characters, at most `characters_max` long (cut with an ellipsis)."""
    if not text:
        return ""
    line = " ".join(_UNSEEN.sub(" ", unicodedata.normalize("NFC", text)).split())
    return line if len(line) <= characters_max else line[: characters_max - 1] + "…"


def letter(index: int) -> str:
    """The spreadsheet letter of the column at `index`, from 0: A, B … Z, AA."""
    name = ""
    index += 1
    while index:
        index, rest = divmod(index - 1, 26)
        name = chr(ord("A") + rest) + name
    return name


def unique_names(header: Sequence[str]) -> tuple[str, ...]:
    """A name for each cell of a header row: its text, its letter when empty, `#2` behind a twin."""
    names: list[str] = []
    taken: set[str] = set()
    for index, cell in enumerate(header):
        text = tidy(cell, NAME_CHARACTERS_MAX) or f"[{letter(index)}]"
        name, count = text, 1
        while name in taken:
            count += 1
            name = f"{text}#{count}"
        taken.add(name)
        names.append(name)
    return tuple(names)


def header_text(column: str) -> str:
    """The canonical header cell from which the name of a column was made; empty for a lettered one."""
    return "" if _LETTERED.fullmatch(column) else canonical(_TWIN.sub("", column))
