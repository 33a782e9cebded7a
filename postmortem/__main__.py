"""The investigators' own words: `report FOLDER`, which the guard starts when an incident is closed, and `serve`.

Processes of their own, so that a fault in understanding an incident can't hurt the guard that outlived it.
"""

import argparse
import sys
from pathlib import Path

from postmortem.bundle import BundleFailed
from postmortem.cli import write_report
from postmortem.reports.report import LANGUAGES


def main(arguments: list[str] | None = None) -> int:
    """Write the report; return 0, or 1 after one sentence on standard error."""
    parser = argparse.ArgumentParser(prog="python -m postmortem", description="Reports of incidents.")
    commands = parser.add_subparsers(required=True)
    report = commands.add_parser("report", help="write report.json and report.md into an incident's folder")
    report.add_argument("folder", type=Path)
    report.add_argument("--lang", choices=LANGUAGES, default="en")
    serve = commands.add_parser("serve", help="answer the dashboard and `hardcore dlq` on a Unix socket")
    for name in ("--data", "--socket", "--control"):
        serve.add_argument(name, type=Path, required=True)
    serve.add_argument("--idle-s", type=float, default=600.0, help="end after so long without a question")
    serve.add_argument("--pace-s", type=float, default=1.0, help="pause between two letters of a bulk")
    serve.add_argument("--dry-run-ms", type=int, default=15_000, help="how long a letter may take on trial")
    asked = parser.parse_args(arguments)
    if "socket" in asked:
        return _serve(asked)
    fault = write_report(asked.folder.absolute(), asked.lang)
    if isinstance(fault, BundleFailed):
        sys.stderr.write(f"The report was not written: {fault.reason}\n")
        return 1
    return 0


def _serve(asked: argparse.Namespace) -> int:
    # Here, because the report's process would pay for a database and a server that it never uses.
    from postmortem.courts import Limits
    from postmortem.serve import Wishes, serve

    limits = Limits(limit_ms=asked.dry_run_ms)
    data, listens, control = (one.absolute() for one in (asked.data, asked.socket, asked.control))
    return serve(Wishes(data, listens, control, asked.idle_s, asked.pace_s, limits))


if __name__ == "__main__":
    sys.exit(main())
