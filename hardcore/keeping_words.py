"""`hardcore backup` and `hardcore restore`: kept copies of the ledger, and the way back to one.

The work is done by a process of its own (`python -m core backup`), because only the ledger's side opens a ledger; here it is
asked for, watched and told. Going back is refused while anybody could be at work in the folder.
"""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any, NoReturn

import click

from frontend.catalogue_keeping import keeping_text
from hardcore.asked import Asked, is_kept, operator

KEEP_DEFAULT = 14


@click.command()
@click.option(
    "--to", "folder", type=click.Path(path_type=Path, file_okay=False), help="Folder; DATA/backups."
)
@click.option(
    "--keep",
    type=click.IntRange(1, 10_000),
    default=KEEP_DEFAULT,
    show_default=True,
    help="How many copies stay in that folder; the oldest go.",
)
@operator
def backup(asked: Asked, folder: Path | None, keep: int) -> None:
    """Make a proven copy of the ledger, now.

    The ledger goes on working meanwhile. The copy is one file; it is proven from its first event before it counts, and a
    small file beside it says what it holds. One is made each day by itself; keep some of them on another disk (--to).

    \b
    hardcore backup --to /media/stick/ledger
    hardcore restore /media/stick/ledger/ledger-….db --data ./empty
    """  # noqa: D301  # the escape is click's own mark for a block that is not refilled
    words = ["--keep", str(keep)]
    if folder is not None:
        words += ["--to", str(folder.absolute())]
    found = _done(asked, "backup", *words)
    _say(asked, "made", file=found["path"], events=found["events"])
    if folder is None:
        _say(asked, "elsewhere")


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@operator
def restore(asked: Asked, file: Path) -> None:
    """Go back to a backup: into a data folder that holds no ledger.

    The backup is copied and proven; only then the folder has a ledger. Nothing is ever written over.

    \b
    mv var var.old
    hardcore restore var.old/backups/ledger-….db
    hardcore up
    """  # noqa: D301  # as above
    if is_kept(asked.folders):
        asked.fail(keeping_text("runs", asked.lang))
    found = _done(asked, "restore", "--", str(file.absolute()))
    _say(asked, "restored", events=found["events"], data=asked.data.absolute(), command=asked.command)


@click.group()
def log() -> None:
    """Take the whole log along, or begin with one.

    The log is everything: each event with its hash, each key with its answer, as lines of JSON that any program can read and
    prove. It is also the way from a file into a server's ledger and back (docs/leaving.md).
    """


@log.command("export")
@click.option(
    "--out", type=click.Path(path_type=Path, dir_okay=False), help="A file; else the log is printed."
)
@operator
def export_log(asked: Asked, out: Path | None) -> None:
    """Write the whole log, of this moment; the ledger goes on working meanwhile."""
    if out is None:
        argv = [sys.executable, "-I", "-m", "core", "log", "export", "--data", str(asked.folders.data)]
        sys.exit(subprocess.run(argv, check=False).returncode)
    _done(asked, "log_export", "--out", str(out.absolute()))
    _say(asked, "log_written", file=out.absolute())


@log.command("import")
@click.argument("file", type=click.Path(path_type=Path))
@operator
def import_log(asked: Asked, file: Path) -> None:
    """Make a ledger out of a log, in a data folder that holds none. Every link is proven on the way."""
    if is_kept(asked.folders):
        asked.fail(keeping_text("runs", asked.lang))
    found = _done(asked, "log_import", "--", str(file.absolute()))
    _say(asked, "log_taken", events=found["events"], data=asked.data.absolute(), command=asked.command)


def _say(asked: Asked, key: str, **values: object) -> None:
    if not asked.json:
        click.echo(keeping_text(key, asked.lang, **values))


def _done(asked: Asked, word: str, *words: str) -> dict[str, Any]:
    """Have it done by the ledger's side and return what came of it; a no ends the command."""
    argv = [sys.executable, "-I", "-m", "core", *word.split("_"), "--data", str(asked.folders.data), "--json"]
    if not asked.json:
        _say(asked, f"{word}_begun")
    try:
        # A person sees how far it is, from the one who knows.
        done = subprocess.run(
            [*argv, *words],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL if asked.json else None,
            text=True,
            check=False,
        )
    except KeyboardInterrupt:
        _stopped(asked)
    try:
        found: dict[str, Any] = json.loads(done.stdout)
    except ValueError:
        found = {"ok": False, "error": keeping_text("no_answer", asked.lang, code=done.returncode)}
    if not found.get("ok"):
        asked.fail(keeping_text("failed", asked.lang, why=found.get("error", "")))
    asked.tell(found)
    return found


def _stopped(asked: Asked) -> NoReturn:
    # The terminal has told the other process too; it removes what was half done.
    click.echo(keeping_text("stopped", asked.lang), err=True)
    sys.exit(130)
