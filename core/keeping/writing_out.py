"""Writing a whole log into a file, which has its name only once it is whole; or to the standard output, as it comes."""

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import IO

from sqlalchemy.exc import DBAPIError

from core.journal.log_out import BUSY_MS, lines_of
from core.journal.store import Whereabouts, open_reading, store_error


def write_log(where: Whereabouts, out: Path, tick: Callable[[int, int], object]) -> int | str:
    """Write the log of a ledger and return how many bytes that were, or why it could not be done. Blocks.

    `out`: a file, or `-`. What is half written is removed.
    """
    readers = open_reading(where, 1, BUSY_MS)
    part = out.with_name(f"{out.name}.part")
    try:
        if str(out) == "-":
            return _pour(lines_of(readers, tick), sys.stdout.buffer)
        with os.fdopen(
            os.open(part, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o600), "wb"
        ) as file:
            written = _pour(lines_of(readers, tick), file)
            os.fsync(file.fileno())
        part.replace(out)
    except DBAPIError as error:
        return f"The ledger can't be read now ({store_error(error).text}). Run hardcore verify."
    except OSError as error:
        return f"{out} could not be written ({error.strerror}): name another file with --out."
    else:
        return written
    finally:
        readers.dispose()
        with suppress(OSError):
            part.unlink(missing_ok=True)


def _pour(lines: Iterator[bytes], file: IO[bytes]) -> int:
    written = 0
    for line in lines:
        written += file.write(line)
    file.flush()
    return written
