"""The command line of throw-away cores. What it needs is loaded when it is called: no core that serves has any use for it."""

import importlib
import os
import sys
from pathlib import Path

import click

from core.departure import ExitCode
from core.saying import say
from core.settings import Settings


@click.command("try")
@click.option("--data", type=click.Path(path_type=Path), envvar="HARDCORE_DATA", required=True)
@click.option("--docket", type=click.Path(path_type=Path), required=True, help="The file with the cases.")
def try_cases(data: Path, docket: Path) -> None:
    """Try commands on a copy of the ledger, in cores that are thrown away; one JSON line for each."""
    sitting = importlib.import_module("core.trying.sitting")
    sys.exit(sitting.sit(data.absolute(), docket, _settings(data)))


@click.command("rehearse-restore")
@click.option("--data", type=click.Path(path_type=Path), envvar="HARDCORE_DATA", required=True)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def rehearse_restore(data: Path, *, as_json: bool) -> None:
    """Restore a fresh copy of the ledger, and the newest backup, into a folder that is thrown away, and prove both."""
    restoring = importlib.import_module("core.trying.restoring")
    sys.exit(restoring.rehearse(data.absolute(), _settings(data), as_json=as_json))


def _settings(data: Path) -> Settings:
    settings = Settings.read(os.environ, data)
    if isinstance(settings, list):
        say(" ".join(settings))
        sys.exit(ExitCode.CONFIG_INVALID)
    return settings
