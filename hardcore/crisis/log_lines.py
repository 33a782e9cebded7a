"""The gateway's log: one JSON object a line, in the shape of the core's (docs/wires.md section 23).

What clients send may be told in a line, and a line break in it must not make two of one. Written to the standard error,
which is a file that the guard keeps in its bounds.
"""

import json
import logging
import sys
from datetime import UTC, datetime
from typing import Final

TEXT_CHARACTERS_MAX: Final = 16_384  # of one line


class JsonLines(logging.Formatter):
    """One record as one line: `at`, `level`, `logger`, `text` (with the traceback, if there is one)."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the line without its end."""
        at = datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds")
        line = {
            "at": at.replace("+00:00", "Z"),
            "level": record.levelname,
            "logger": record.name,
            "text": super().format(record)[:TEXT_CHARACTERS_MAX],
        }
        return json.dumps(line, ensure_ascii=False)


def begin() -> None:
    """Have everything that is logged from now on go to the standard error."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(JsonLines("%(message)s"))
    logging.basicConfig(level=logging.INFO, handlers=[handler])
