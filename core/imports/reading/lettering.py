"""Turns bytes into text: by their byte order mark, as UTF-8 if they are that, as CP949, and at last by a guess.

The order matters. UTF-8 refuses almost everything that isn't UTF-8; CP949 refuses much; Windows-1252 refuses
next to nothing and would turn every Korean file into garbage if it were asked first, so what it gives is
marked as a guess. CP949 and not EUC-KR, which lacks letters that merchants' names use. A person may name the
encoding, and then nothing else is tried.
"""

import codecs
import re
from types import MappingProxyType
from typing import Final

import msgspec

from core.imports.reading.table import Unreadable, Why

#: What a person may choose: name -> the codec that reads it.
ENCODINGS: Final = MappingProxyType(
    {
        "utf-8": "utf-8-sig",
        "utf-16": "utf-16",
        "cp949": "cp949",
        "euc-kr": "cp949",
        "cp932": "cp932",
        "shift_jis": "cp932",
        "windows-1252": "cp1252",
        "iso-8859-1": "iso-8859-1",
    }
)

_MARKS: Final = ((codecs.BOM_UTF8, "utf-8"), (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"))
_TRIED: Final = ("utf-8", "cp949")
_GUESS: Final = "windows-1252"
_WESTERN: Final = frozenset({"windows-1252", "iso-8859-1"})
# Every letter beyond ASCII is a whole syllable of Korean or its punctuation: no western text is written so.
_KOREAN: Final = re.compile(
    rb"[\x00-\x7f]*(?:(?:[\xa1-\xac][\xa1-\xfe])*[\xb0-\xc8][\xa1-\xfe](?:[\x00-\x7f]|[\xa1-\xac\xb0-\xc8][\xa1-\xfe])*)"
)
_CONTROL_BYTES: Final = re.compile(rb"[\x01-\x08\x0e-\x19\x1b-\x1f\x7f]")
_CONTROL_SHARE_MAX: Final = 0.01
_END_OF_FILE: Final = "\x1a"  # some old programs still write it behind the last line


class Decoded(msgspec.Struct, frozen=True):
    """A text, the encoding it was in, and whether that was only guessed."""

    text: str
    encoding: str
    guessed: bool = False


def decode(data: bytes, encoding: str | None, said: str | None = None) -> Decoded | Unreadable:
    """The text in `data`. `encoding` is a key of ENCODINGS that a person chose, or None to find it.

    `said`: the one that the file itself names. It is asked after UTF-8 alone, which no other text passes for, because
    some banks name one and write UTF-8; and a western one is not believed of a text in Korean.
    """
    if encoding is not None and encoding not in ENCODINGS:
        return Unreadable(Why.UNKNOWN_ENCODING)
    chosen = encoding or next((name for mark, name in _MARKS if data.startswith(mark)), None)
    if chosen is None and _is_binary(data):
        return Unreadable(Why.BINARY)
    if said in _WESTERN and _KOREAN.fullmatch(data):
        said = None
    tried = (_TRIED[0], said, *_TRIED[1:], _GUESS) if said else (*_TRIED, _GUESS)
    for name in (chosen,) if chosen else tried:
        text = _strictly(data, name)
        if text is not None:
            guessed = chosen is None and name == _GUESS and name != said
            return _checked(Decoded(text, name, guessed=guessed))
    return Unreadable(Why.WRONG_ENCODING)


def _strictly(data: bytes, name: str) -> str | None:
    try:
        return data.decode(ENCODINGS[name])
    except UnicodeError:
        return None


def _is_binary(data: bytes) -> bool:
    return b"\0" in data or len(_CONTROL_BYTES.findall(data)) > _CONTROL_SHARE_MAX * len(data)


def _checked(decoded: Decoded) -> Decoded | Unreadable:
    text = decoded.text.rstrip(_END_OF_FILE)
    if "\0" in text:
        return Unreadable(Why.BINARY)
    return Decoded(text, decoded.encoding, decoded.guessed) if text.strip() else Unreadable(Why.EMPTY)
