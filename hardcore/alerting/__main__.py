"""`python -m hardcore.alerting --data DIR`: sends what waits, and ends. `--test`: tries the channels and prints it."""

import argparse
import json
import os
import sys
from pathlib import Path

from hardcore.alerting.book import lock_paths
from hardcore.alerting.sender import PAUSES_S, Sender
from hardcore.alerting.trying import try_channels
from hardcore.host.files import take_lock
from hardcore.host.folders import Folders, locate


def main(argv: list[str] | None = None) -> int:
    """Send, or try; return the exit code."""
    parser = argparse.ArgumentParser(prog="hardcore.alerting", description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="the data folder of the guard")
    parser.add_argument(
        "--test", action="store_true", help="send a test to each channel and print what came of it"
    )
    parser.add_argument("--channel", type=int, help="with --test: to this one only")
    parser.add_argument("--url", default="", help="with --test: where the ledger is served")
    parser.add_argument(
        "--pauses-s",
        type=float,
        nargs="+",
        default=list(PAUSES_S),
        help="pauses after failed attempts (default: %(default)s)",
    )
    given = parser.parse_args(argv)
    folders = locate(given.data)
    if given.test:
        print(json.dumps(try_channels(folders, given.channel, given.url), ensure_ascii=False))  # noqa: T201
        return 0
    if _take_lock(folders) is None:
        return 0  # another one is at it
    Sender(folders, given.pauses_s).run()
    return 0


def _take_lock(folders: Folders) -> int | None:
    """Return the sender's lock, held until the process ends; None: somebody else has it."""
    for path in lock_paths(folders):
        try:
            return take_lock(path)
        except OSError:
            continue  # a full disk: the run folder has one as well
    return None


if __name__ == "__main__":
    code = main()
    sys.stdout.flush()
    os._exit(code)  # threads that hang with somebody else are not waited for
