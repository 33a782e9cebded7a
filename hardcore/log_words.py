"""`hardcore logs`: the last lines of what the parts have written, and what they write from now on.

Read from the files, so it works with everything stopped. A file that is rotated away is followed by the one that takes
its name. What stands there is others' text: whatever a terminal would obey is shown as what it is.
"""

import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import click

from frontend.catalogue_operator import operator_text
from hardcore.asked import Asked, operator
from postmortem.reports.visible import visible

PARTS = ("sentinel", "core", "gateway", "launcher", "drill", "alerts")
LINES_MAX = 10_000
#: So much of the end of a file is looked through for its last lines.
TAIL_BYTES_MAX = 4 << 20
LOOK_S = 0.25


@click.command("logs")
@click.option("--part", type=click.Choice(PARTS), default="sentinel", show_default=True, help="Whose log.")
@click.option("--lines", default=50, show_default=True, type=click.IntRange(0, LINES_MAX), help="How many.")
@click.option("--follow", "-f", is_flag=True, help="Go on showing what is added, until Ctrl-C.")
@operator
def logs(asked: Asked, part: str, lines: int, *, follow: bool) -> None:
    """Show the last lines of a part's log."""
    path = asked.folders.logs / f"{part}.log"
    shown = _tail(path, lines)
    for line in shown:
        click.echo(line)
    if not shown and not follow and not asked.json:
        click.echo(operator_text("logs_none", asked.lang, path=path), err=True)
    if follow:
        with suppress(KeyboardInterrupt):  # Ctrl-C is how following ends
            for line in _added(path):
                click.echo(line)


def _tail(path: Path, count: int) -> list[str]:
    try:
        with path.open("rb") as file:
            size = file.seek(0, 2)
            file.seek(max(0, size - TAIL_BYTES_MAX))
            data = file.read(TAIL_BYTES_MAX)
    except OSError:
        return []
    return [_line(one) for one in data.splitlines()[-count:]] if count else []


def _added(path: Path) -> Iterator[str]:
    """Give each line that is added from now on; a file that takes the name of this one is read from its beginning."""
    inode, at = _end(path)
    held = b""
    while True:
        now, size = _end(path)
        if now != inode or size < at:
            inode, at, held = now, 0, b""
        with (
            suppress(OSError),
            path.open("rb") as file,
        ):  # rotated away at this moment: the next look finds it
            file.seek(at)
            held += file.read(TAIL_BYTES_MAX)
            at = file.tell()
        *whole, held = held.split(b"\n")
        yield from map(_line, whole)
        time.sleep(LOOK_S)


def _end(path: Path) -> tuple[int, int]:
    try:
        told = path.stat()
    except OSError:
        return 0, 0
    return told.st_ino, told.st_size


def _line(data: bytes) -> str:
    return visible(data.decode("utf-8", "replace"))
