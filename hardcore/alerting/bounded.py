"""An answer that ends: of what somebody else sends, no more is read than an answer can have.

The standard library bounds each line and not their number: a mail server that greets for ever would fill this process's
memory, and a web server that says "100 Continue" for ever would keep it busy.
"""

from typing import Any, BinaryIO, Final

ANSWER_BYTES_MAX: Final = 256 << 10


class EndlessError(OSError):
    """More was sent than any answer has."""


class Bounded:
    """A file of a connection, from which so many bytes are read and no more; everything else is the file's own."""

    def __init__(self, file: BinaryIO) -> None:
        self.file = file
        self._left = ANSWER_BYTES_MAX

    def readline(self, size: int = -1) -> bytes:
        """Read a line. Raises EndlessError."""
        line = self.file.readline(size)
        self._left -= len(line)
        if self._left < 0:
            raise EndlessError
        return line

    def __getattr__(self, name: str) -> Any:
        return getattr(self.file, name)
