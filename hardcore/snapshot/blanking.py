"""A copy of the recorder page without what a person typed: the box keeps the page's bytes, not its secrets.

The free texts on a page are the bodies of commands, the texts of events and the last words. Each is passed
through the sieves of `masking` in its place, also in slots that are free again (their old bytes stay), and the
entry's CRC is made right again, so that the copy still reads as a page. What was torn stays torn: a wrong CRC
gets another wrong one. To leave the raw page out was not chosen: it is what a new reader of old pages needs.
"""

import zlib
from collections.abc import Callable
from struct import Struct

from hardcore.host import page
from hardcore.snapshot.masking import mask_line, mask_payload

_WORD = Struct("<Q")
#: Where an entry keeps its free text, and the function that masks the bytes of the entry in place.
_PAYLOAD_AT, _PAYLOAD_LENGTH_AT = 512, 32
_EVENT_TEXT = slice(64, 128)
_LAST_WORDS_TEXT = slice(64, 1024)


def blanked(raw: bytes) -> bytes:
    """Return the page in `raw` with its free texts masked; what is no whole page becomes an empty text.

    Of a page that was cut nobody knows where its texts stand, so none of it is kept.
    """
    if len(raw) != page.FILE_BYTES:
        return b""
    told = bytearray(raw)
    _each(told, page.SLOTS, _blank_slot)
    _each(told, page.EVENTS, lambda entry: _blank_text(entry, _EVENT_TEXT))
    _each(told, page.LAST_WORDS, lambda entry: _blank_text(entry, _LAST_WORDS_TEXT))
    return bytes(told)


def _each(raw: bytearray, shape: page.Shape, blank: Callable[[bytearray], None]) -> None:
    for at in page.used_entries(shape, raw):
        entry = raw[at : at + shape.size_bytes]
        intact = _crc(shape, entry) == _WORD.unpack_from(entry, shape.crc_at)[0]
        blank(entry)
        _WORD.pack_into(entry, shape.crc_at, _crc(shape, entry) ^ (not intact))
        raw[at : at + shape.size_bytes] = entry


def _blank_slot(entry: bytearray) -> None:
    if page.slot_in_use(bytes(entry)):
        length = min(_WORD.unpack_from(entry, _PAYLOAD_LENGTH_AT)[0], page.PAYLOAD_BYTES_MAX)
    else:
        length = 0  # what is left of an earlier command
    kept = mask_payload(bytes(entry[_PAYLOAD_AT : _PAYLOAD_AT + length]))
    entry[_PAYLOAD_AT:] = kept.ljust(len(entry) - _PAYLOAD_AT, b"\0")


def _blank_text(entry: bytearray, where: slice) -> None:
    width = where.stop - where.start
    text = bytes(entry[where]).rstrip(b"\0").decode("utf-8", "replace")
    # Cut on a character's boundary, as the writer of the page does.
    cut = mask_line(text).encode("utf-8", "replace")[:width].decode("utf-8", "ignore").encode()
    entry[where] = cut.ljust(width, b"\0")


def _crc(shape: page.Shape, entry: bytearray) -> int:
    crc = 0
    for span in shape.covered:
        crc = zlib.crc32(entry[span], crc)
    return crc
