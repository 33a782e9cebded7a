"""What a core says to its log, at once and whatever becomes of it.

The log may lie on the disk that has just failed. A line that Python keeps in a buffer is tried again at the end of the
process, and that failure would become its exit code (120), which the guard takes for an end that nobody can explain;
a sentence that is printed raises on the way to the end. So every line goes out by itself, and a refused one is lost:
the last words stand in the recorder page as well.
"""

import io
import os
from contextlib import suppress

_ERRORS = 2


class Unkept(io.TextIOBase):
    """A text stream to the standard error that keeps nothing back and never fails."""

    def write(self, text: str) -> int:
        """Write it now, or never."""
        with suppress(OSError):
            os.write(_ERRORS, text.encode("utf-8", "replace"))
        return len(text)


def say(sentence: str) -> None:
    """Say one sentence."""
    Unkept().write(f"{sentence}\n")
