"""Receiving a file: a multipart body taken apart while it streams, the file straight to its place on the disk.

Everything is bounded before it is kept: the file, the fields beside it, their number. Nothing is spooled into a
temporary folder, and no field is written anywhere: one of them may be a password. The framework's own form
reader was not chosen: it bounds fields but no file, and spools where other programs look.
"""

import asyncio
import hashlib
from pathlib import Path
from typing import BinaryIO, Final

import msgspec
from python_multipart.exceptions import FormParserError
from python_multipart.multipart import MultipartParser, parse_options_header
from starlette.requests import Request

from core.web.problems import Problem, ProblemError

FIELDS_MAX: Final = 8
FIELD_BYTES_MAX: Final = 4_096
ENVELOPE_BYTES_MAX: Final = 64 << 10  # boundaries, headers and fields around a file
DISCARDED_BYTES_MAX: Final = 8 << 20  # read and thrown away, so that a sender comes to hear the answer
WRITE_BYTES: Final = 1 << 20
DIGITS_MAX: Final = 18
FILE: Final = "file"


class Upload(msgspec.Struct, frozen=True):
    """What came: the client's name of the file, its digest in hex, and the fields beside it."""

    name: str
    sha256: str
    fields: dict[str, str]


async def receive(request: Request, path: Path, file_bytes_max: int) -> Upload:
    """Write the file of a multipart body to `path`, or end the request with what is wrong with it."""
    announced = request.headers.get("content-length", "0")
    most = file_bytes_max + ENVELOPE_BYTES_MAX + DISCARDED_BYTES_MAX
    if announced.isdigit() and (len(announced) > DIGITS_MAX or int(announced) > most):
        raise _too_large(file_bytes_max, closing=True)
    form = _Form(file_bytes_max)
    parser = _parser(request, form)
    seen = 0
    with await asyncio.to_thread(path.open, "wb") as file:
        async for chunk in request.stream():
            seen += len(chunk)
            if seen > most:
                raise _too_large(file_bytes_max, closing=True)
            _feed(parser, chunk)
            if len(form.waiting) >= WRITE_BYTES:
                await asyncio.to_thread(form.flush, file)
        await asyncio.to_thread(form.flush, file)
    return _received(form, file_bytes_max)


def _parser(request: Request, form: "_Form") -> MultipartParser:
    kind, options = parse_options_header(request.headers.get("content-type"))
    boundary = options.get(b"boundary")
    if kind != b"multipart/form-data" or not boundary:
        raise _malformed()
    try:
        return MultipartParser(
            boundary,
            {
                "on_part_begin": form.begin,
                "on_header_field": form.header_name,
                "on_header_value": form.header_value,
                "on_header_end": form.header_end,
                "on_headers_finished": form.headers_finished,
                "on_part_data": form.data,
                "on_end": form.end,
            },
        )
    except FormParserError:
        raise _malformed() from None


def _feed(parser: MultipartParser, chunk: bytes) -> None:
    try:
        parser.write(chunk)
    except FormParserError:
        raise _malformed() from None


def _received(form: "_Form", file_bytes_max: int) -> Upload:
    if form.too_large:
        raise _too_large(file_bytes_max, closing=False)
    if form.name is None or not form.ended:
        raise _malformed()
    try:
        fields = {name: value.decode() for name, value in form.fields.items() if value}
    except UnicodeDecodeError:
        raise _malformed() from None
    return Upload(form.name, form.digest.hexdigest(), fields)


def _too_large(bytes_max: int, *, closing: bool) -> ProblemError:
    headers = {"Connection": "close"} if closing else {}
    megabytes = str(bytes_max >> 20 or 1)
    return ProblemError(Problem("file-too-large", values={"limit_mb": megabytes}, headers=headers))


def _malformed() -> ProblemError:
    return ProblemError(Problem("malformed-upload"))


class _Form(msgspec.Struct):
    """What the parser has said so far. `waiting` are bytes of the file that are not written yet."""

    file_bytes_max: int
    name: str | None = None
    ended: bool = False
    too_large: bool = False
    fields: dict[str, bytearray] = {}
    waiting: bytearray = msgspec.field(default_factory=bytearray)
    digest: "hashlib._Hash" = msgspec.field(default_factory=hashlib.sha256)
    _size: int = 0
    _header: bytearray = msgspec.field(default_factory=bytearray)
    _value: bytearray = msgspec.field(default_factory=bytearray)
    _disposition: bytes = b""
    _part: str = ""

    def begin(self) -> None:
        self._disposition = b""
        self._part = ""

    def header_name(self, data: bytes, start: int, end: int) -> None:
        self._header += data[start:end]

    def header_value(self, data: bytes, start: int, end: int) -> None:
        self._value += data[start:end]

    def header_end(self) -> None:
        if bytes(self._header).lower() == b"content-disposition":
            self._disposition = bytes(self._value)
        self._header.clear()
        self._value.clear()

    def headers_finished(self) -> None:
        _, options = parse_options_header(self._disposition)
        self._part = options.get(b"name", b"").decode("utf-8", "replace")
        if self._part == FILE:
            if self.name is not None:
                raise _malformed()
            self.name = options.get(b"filename", b"").decode("utf-8", "replace")
        elif self._part in self.fields or len(self.fields) >= FIELDS_MAX:
            raise _malformed()
        else:
            self.fields[self._part] = bytearray()

    def data(self, data: bytes, start: int, end: int) -> None:
        if self._part != FILE:
            value = self.fields[self._part]
            value += data[start:end]
            if len(value) > FIELD_BYTES_MAX:
                raise _malformed()
            return
        self._size += end - start
        self.too_large = self._size > self.file_bytes_max
        if not self.too_large:
            self.waiting += data[start:end]

    def end(self) -> None:
        self.ended = True

    def flush(self, file: BinaryIO) -> None:
        self.digest.update(self.waiting)
        file.write(self.waiting)
        self.waiting.clear()
