"""The one message to the reading child, and the answer it gives: null when the table was written."""

import msgspec

from core.imports.reading.limits import ReadingLimits
from core.imports.reading.table import Unreadable


class Request(msgspec.Struct, frozen=True):
    """What to read and where to write it. `parent` is the process without which the child has no business."""

    path: str
    out: str
    encoding: str | None
    password: str | None
    limits: ReadingLimits
    parent: int
    formats: str | None = None  # the folder of layouts that the household has added


Answer = Unreadable | None
