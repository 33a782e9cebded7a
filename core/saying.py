"""What a core says to its log, at once and whatever becomes of it.

The log may lie on the disk that has just failed. A line that Python keeps in a buffer is tried again at the end of the
process, and that failure would become its exit code (120), which the guard takes for an end that nobody can explain;
a sentence that is printed raises on the way to the end. So every line goes out by itself, and a refused one is lost:
the last words stand in the recorder page as well.
"""

import io
import json
import logging
import os
from contextlib import suppress
from datetime import UTC, datetime
from typing import Final

from core.guarded.pulse import Pulse

_ERRORS = 2
TEXT_CHARACTERS_MAX: Final = 16_384  # of one line
PLAIN: Final = "%(asctime)s %(levelname)s %(name)s %(message)s"


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


class JsonLines(logging.Formatter):
    """One JSON object a line (`docs/wires.md` section 23): a traceback, or somebody's text, can't make two of one."""

    def __init__(self, pulse: Pulse) -> None:
        """Prepare. `pulse` knows the epoch."""
        super().__init__("%(message)s")
        self._pulse = pulse

    def format(self, record: logging.LogRecord) -> str:
        """Return the line without its end."""
        line = {
            "at": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds")[:-6] + "Z",
            "level": record.levelname,
            "logger": record.name,
            "text": super().format(record)[:TEXT_CHARACTERS_MAX],
            "epoch": self._pulse.epoch,
        }
        return json.dumps(line, ensure_ascii=False)


class Log(logging.StreamHandler[Unkept]):
    """The core's log: lines to the standard error, and on the recorder page how many of them are warnings and errors."""

    def __init__(self) -> None:
        """Write plain lines, for a person at a terminal, and count for nobody yet."""
        super().__init__(Unkept())
        self.setFormatter(logging.Formatter(PLAIN))
        self._pulse: Pulse | None = None
        self._warnings = 0
        self._errors = 0

    def count_on(self, pulse: Pulse, *, as_json: bool) -> None:
        """Keep the counts on a page from now on. `as_json`: lines are for programs."""
        self._pulse = pulse
        if as_json:
            self.setFormatter(JsonLines(pulse))

    def emit(self, record: logging.LogRecord) -> None:
        """Write one line and count it. Called under the handler's own lock."""
        super().emit(record)
        if record.levelno < logging.WARNING:
            return
        if record.levelno < logging.ERROR:
            self._warnings += 1
        else:
            self._errors += 1
        if self._pulse is not None:
            self._pulse.log_counts(self._warnings, self._errors)
