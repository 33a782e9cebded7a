"""`python -m core backup`, `restore`, `log export` and `log import`: what is kept, by a process of its own.

What they need is loaded when they are called, and a long proof here takes nobody's turn in a core that serves.
"""

import datetime as dt
import importlib
import os
import signal
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, NoReturn

import click
import msgspec

from core.departure import ExitCode
from core.journal.store import LEDGER_FILE, has_ledger
from core.mortality import die_with
from core.rulings import RULES, Rulings
from core.saying import say
from core.settings import Settings

TOLD_EVERY_S: Final = 0.2
POLITE: Final = 19
_DOING: Final = {
    "copying": "Copying the ledger",
    "proving": "Proving the copy",
    "taking": "Taking the log in",
    "telling": "Writing the log",
}


@click.command("backup")
@click.option("--data", type=click.Path(path_type=Path), envvar="HARDCORE_DATA", required=True)
@click.option("--to", "folder", type=click.Path(path_type=Path), help="Folder of the backups; DATA/backups.")
@click.option("--keep", type=click.IntRange(1, 10_000), default=14, show_default=True)
@click.option("--politely", is_flag=True, help="Give way to everybody else on this machine.")
@click.option("--parent", type=click.IntRange(1), hidden=True, help="End with this process, which began it.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def backup(
    data: Path, folder: Path | None, keep: int, *, politely: bool, parent: int | None, as_json: bool
) -> None:
    """Make a proven copy of the ledger, while it is at work or at rest, and remove the oldest beyond --keep."""
    if parent is not None and not die_with(parent):
        sys.exit(ExitCode.ASKED)
    if politely:
        with suppress(OSError):
            os.nice(POLITE)
    data = data.absolute()
    settings = Settings.read(os.environ, data)
    if isinstance(settings, list):
        _refuse(" ".join(settings), ExitCode.CONFIG_INVALID, as_json=as_json)
    where = settings.ledger(data)
    if not has_ledger(where, settings.fence_busy_ms):
        say(f"There is no ledger in {data}: name its folder with --data.")
        sys.exit(ExitCode.CONFIG_INVALID)
    making = importlib.import_module("core.keeping.making")
    rulings = Rulings.beside(data / RULES)
    rulings.read()
    target = (folder or data / making.FOLDER).absolute()
    made = _ended_cleanly(
        lambda: making.make(
            where,
            target,
            keep,
            rulings,
            data / RULES,
            dt.datetime.now(dt.UTC),
            _progress(),
        )
    )
    _clear()
    if isinstance(made, making.NotMade):
        code = ExitCode.DISK_FULL if made.full else ExitCode.STORE_CORRUPT
        _refuse(made.sentence, code, as_json=as_json)
    path, note = made
    if as_json:
        click.echo(msgspec.json.encode({"ok": True, "path": str(path), **msgspec.to_builtins(note)}).decode())
    else:
        click.echo(f"{path}: {note.events} events, proven, head {note.head}.")


@click.command("restore")
@click.option("--data", type=click.Path(path_type=Path), envvar="HARDCORE_DATA", required=True)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
@click.argument("file", type=click.Path(path_type=Path))
def restore(data: Path, file: Path, *, as_json: bool) -> None:
    """Go back to a backup: into a folder that holds no ledger, proven before it becomes one."""
    restoring = importlib.import_module("core.keeping.restoring")
    settings = Settings.read(os.environ, data)
    if isinstance(settings, list):
        _refuse(" ".join(settings), ExitCode.CONFIG_INVALID, as_json=as_json)
    if settings.store is not None:
        _refuse(
            "The ledger of this folder lies in a server: a backup is restored into another folder, as a file.",
            ExitCode.CONFIG_INVALID,
            as_json=as_json,
        )
    told = _progress()
    found = _ended_cleanly(
        lambda: restoring.restore(file.absolute(), data.absolute(), LEDGER_FILE, settings, told)
    )
    _clear()
    if isinstance(found, restoring.NotRestored):
        _refuse(found.sentence, ExitCode.CONFIG_INVALID, as_json=as_json)
    if as_json:
        click.echo(msgspec.json.encode({"ok": True, **msgspec.to_builtins(found)}).decode())
    else:
        click.echo(f"The ledger is back in {data}: {found.events} events, proven, head {found.head}.")


@click.group("log")
def log() -> None:
    """The whole log out and in, as lines of JSON."""


@log.command("export")
@click.option("--data", type=click.Path(path_type=Path), envvar="HARDCORE_DATA", required=True)
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False, allow_dash=True), default="-")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object; needs --out.")
def export_log(data: Path, out: Path, *, as_json: bool) -> None:
    """Write the whole log of a ledger, at work or at rest: each event with its hash, and each key."""
    data = data.absolute()
    settings = Settings.read(os.environ, data)
    if isinstance(settings, list):
        _refuse(" ".join(settings), ExitCode.CONFIG_INVALID, as_json=as_json)
    where = settings.ledger(data)
    if not has_ledger(where, settings.fence_busy_ms):
        _refuse(
            f"There is no ledger in {data}: name its folder with --data.",
            ExitCode.CONFIG_INVALID,
            as_json=as_json,
        )
    writing = importlib.import_module("core.keeping.writing_out")
    told = _progress()
    written = _ended_cleanly(
        lambda: writing.write_log(where, out, lambda seq, of: told("telling", 100 * seq // max(1, of)))
    )
    _clear()
    if isinstance(written, str):
        _refuse(written, ExitCode.CONFIG_INVALID, as_json=as_json)
    if as_json:
        click.echo(msgspec.json.encode({"ok": True, "path": str(out), "bytes": written}).decode())


@log.command("import")
@click.option("--data", type=click.Path(path_type=Path), envvar="HARDCORE_DATA", required=True)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
@click.argument("file", type=click.Path(path_type=Path))
def import_log(data: Path, file: Path, *, as_json: bool) -> None:
    """Make a ledger out of a whole log, in a folder that holds none; every link is proven on the way."""
    restoring = importlib.import_module("core.keeping.restoring")
    told = _progress()
    found = _ended_cleanly(lambda: restoring.restore_log(file.absolute(), data.absolute(), LEDGER_FILE, told))
    _clear()
    if isinstance(found, restoring.NotRestored):
        _refuse(found.sentence, ExitCode.CONFIG_INVALID, as_json=as_json)
    if as_json:
        click.echo(msgspec.json.encode({"ok": True, **msgspec.to_builtins(found)}).decode())
    else:
        click.echo(
            f"The ledger of {data} holds what the log says: {found.events} events, proven, head {found.head}."
        )


def _ended_cleanly(work: Callable[[], Any]) -> Any:
    """Do it; Ctrl-C and TERM end it with everything that was half done removed."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        return work()
    except KeyboardInterrupt:
        say("Stopped; nothing of it is left.")
        sys.exit(130)


def _refuse(sentence: str, code: ExitCode, *, as_json: bool) -> NoReturn:
    if as_json:
        click.echo(msgspec.json.encode({"ok": False, "error": sentence}).decode())
    else:
        say(sentence)
    sys.exit(code)


def _progress() -> Callable[[str, int | None], None]:
    """Return what shows a person how far it is."""
    last = 0.0

    def told(doing: str, percent: int | None) -> None:
        nonlocal last
        now = time.monotonic()
        if not sys.stderr.isatty() or now - last < TOLD_EVERY_S:
            return
        last = now
        far = "" if percent is None else f" {percent} %"
        sys.stderr.write(f"\r\x1b[K{_DOING[doing]} …{far}")
        sys.stderr.flush()

    return told


def _clear() -> None:
    if sys.stderr.isatty():
        sys.stderr.write("\r\x1b[K")
