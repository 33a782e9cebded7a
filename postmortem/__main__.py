"""`python -m postmortem report FOLDER [--lang ko|en]`: the guard starts it when an incident is closed.

A process of its own, so that a fault in understanding an incident can't hurt the guard that outlived it.
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
    asked = parser.parse_args(arguments)
    fault = write_report(asked.folder.absolute(), asked.lang)
    if isinstance(fault, BundleFailed):
        sys.stderr.write(f"The report was not written: {fault.reason}\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
