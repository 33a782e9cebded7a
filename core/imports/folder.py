"""The folder of imports: what is kept of each, written so that a death leaves the old or the new, never half.

`DATA/imports/<id>/` holds the file as it came (`file`), its rows as plain text (`rows.jsonl`), and three records
beside them. A folder is made under another name and takes its own once it is whole, so an id that can be
found is an import. The process's umask makes
everything its owner's alone. A table in the ledger's database was not chosen: twenty
megabytes of a stranger's bytes have no place beside the books, and the ledger would have to be open to look.
"""

import os
import re
import shutil
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from secrets import token_hex
from typing import Final, TypeVar

import msgspec

from core.imports.records import Manifest, Progress, Survey
from core.imports.states import State

IMPORTS: Final = "imports"
UNFINISHED: Final = ".new"
FRESH_ROWS: Final = "rows-"  # rows of another look, until it is seen whether they may take the place

_ID: Final = re.compile(r"[0-9a-f-]{36}")
_MANIFEST: Final = "manifest.json"
_SURVEY: Final = "survey.json"
_PROGRESS: Final = "progress.json"

R = TypeVar("R")


def _for_ever() -> bool:
    return True


def is_import_id(text: str) -> bool:
    """Whether `text` may name an import; nothing else becomes part of a path."""
    return _ID.fullmatch(text) is not None


class ImportFolder:
    """One import's place on the disk. Every method blocks."""

    def __init__(self, path: Path) -> None:
        """Look at a folder; it need not exist yet."""
        self.path = path

    @property
    def file(self) -> Path:
        """The file as it came."""
        return self.path / "file"

    @property
    def rows(self) -> Path:
        """Its rows, as reading has left them."""
        return self.path / "rows.jsonl"

    def fresh_rows(self, name: str) -> Path:
        """A place of its own for the rows of another look."""
        return self.path / f"{FRESH_ROWS}{name}{UNFINISHED}"

    def keep_rows(self, fresh: Path) -> None:
        """Take the rows of a look in place of those before; once this returns, a power cut does not lose them."""
        _flush(fresh)
        fresh.rename(self.rows)
        _flush(self.path)

    def manifest(self) -> Manifest | None:
        """Return the wish, None where there is no import."""
        return _read(self.path / _MANIFEST, Manifest)

    def survey(self) -> Survey:
        """Return what the last look found; nothing if there was none."""
        return _read(self.path / _SURVEY, Survey) or Survey(0)

    def progress(self) -> Progress:
        """Return how far the booking is known to be."""
        return _read(self.path / _PROGRESS, Progress) or Progress()

    def keep_manifest(self, manifest: Manifest, is_wanted: Callable[[], bool] = _for_ever) -> None:
        """Keep the wish; once this returns, a power cut does not lose it.

        `is_wanted` is asked at the last moment: where it says no, nothing is kept.
        """
        _write(self.path / _MANIFEST, manifest, durable=True, is_wanted=is_wanted)

    def keep_survey(self, survey: Survey) -> None:
        """Keep what a look found."""
        _write(self.path / _SURVEY, survey, durable=False)

    def keep_progress(
        self, progress: Progress, *, durable: bool, is_wanted: Callable[[], bool] = _for_ever
    ) -> None:
        """Keep how far it is. May be lost until the end: the rows' keys in the ledger know better.

        `is_wanted` is asked at the last moment: where it says no, nothing is kept.
        """
        _write(self.path / _PROGRESS, progress, durable=durable, is_wanted=is_wanted)

    def bytes_kept(self) -> int:
        """Return how much room it takes, as far as that can be seen: another look's rows may go meanwhile."""
        total = 0
        with suppress(OSError):
            for entry in os.scandir(self.path):
                with suppress(OSError):
                    total += entry.stat().st_size if entry.is_file() else 0
        return total


class Imports:
    """All imports of a data folder. Every method blocks."""

    def __init__(self, data: Path) -> None:
        """Take the data folder; it exists."""
        self._path = data / IMPORTS

    def open(self, import_id: str) -> ImportFolder:
        """Return the place of an import, which need not exist."""
        assert is_import_id(import_id), "an id is looked at before it becomes a path"
        return ImportFolder(self._path / import_id)

    def unfinished(self, import_id: str) -> ImportFolder:
        """Return the place in which an import is put together."""
        assert is_import_id(import_id), "as above"
        return ImportFolder(self._path / (import_id + UNFINISHED))

    def begin(self, import_id: str) -> ImportFolder:
        """Make that place, empty."""
        self.abandon(import_id)
        folder = self.unfinished(import_id)
        folder.path.mkdir(parents=True)
        return folder

    def finish(self, import_id: str) -> ImportFolder:
        """Give what was put together its name; once this returns, a power cut loses nothing of it."""
        final = self._path / import_id
        made = self.unfinished(import_id).path
        for path in (*made.iterdir(), made):
            _flush(path)
        made.rename(final)
        _flush(self._path)
        return ImportFolder(final)

    def abandon(self, import_id: str) -> None:
        """Throw away what was begun."""
        shutil.rmtree(self.unfinished(import_id).path, ignore_errors=True)

    def newest_first(self) -> list[Manifest]:
        """Return all imports, newest first."""
        found = [manifest for _, manifest in self._all()]
        return sorted(found, key=lambda one: (one.made_ns, one.id), reverse=True)

    def clear_unfinished(self) -> None:
        """Remove what a death left half put together. Only while nothing is being put together.

        What can't be removed stays, and takes room.
        """
        for left in self._path.glob("*" + UNFINISHED):
            shutil.rmtree(left, ignore_errors=True)
        for wanted in (f"*/{FRESH_ROWS}*", f"*/*{UNFINISHED}"):
            for left in self._path.glob(wanted):
                with suppress(OSError):
                    left.unlink()

    def tidy(self, previews_before_ns: int, bytes_max: int, imports_max: int) -> None:
        """Remove old previews, and the oldest imports where it is too much.

        `previews_before_ns` is wall time. One that is being committed is never removed.
        """
        kept = []
        for folder, manifest in self._all():
            if manifest.state is State.PREVIEW and manifest.made_ns < previews_before_ns:
                self._remove(manifest.id)
            elif manifest.state is not State.COMMITTING:
                kept.append((manifest.made_ns, manifest.id, folder.bytes_kept()))
        kept.sort(reverse=True)
        total = 0
        for count, (_, import_id, size) in enumerate(kept, 1):
            total += size
            if total > bytes_max or count > imports_max:
                self._remove(import_id)

    def _all(self) -> Iterator[tuple[ImportFolder, Manifest]]:
        if not self._path.is_dir():
            return
        for path in self._path.iterdir():
            folder = ImportFolder(path)
            manifest = folder.manifest() if is_import_id(path.name) else None
            if manifest is not None:
                yield folder, manifest

    def _remove(self, import_id: str) -> None:
        shutil.rmtree(self._path / import_id, ignore_errors=True)


def _read(path: Path, shape: type[R]) -> R | None:
    try:
        return msgspec.json.decode(path.read_bytes(), type=shape)
    except (OSError, msgspec.DecodeError):
        return None  # not there, or of another version: as if it had not been written


def _write(
    path: Path, record: msgspec.Struct, *, durable: bool, is_wanted: Callable[[], bool] = _for_ever
) -> None:
    # A name of its own: a writer that was left behind and the one after it may both be at work on this record.
    fresh = path.with_name(f"{path.name}-{token_hex(4)}{UNFINISHED}")
    try:
        with fresh.open("wb") as file:
            file.write(msgspec.json.encode(record))
            if durable:
                file.flush()
                os.fsync(file.fileno())
        if not is_wanted():
            return
        fresh.rename(path)
    finally:
        fresh.unlink(missing_ok=True)
    if durable:
        _flush(path.parent)


def _flush(path: Path) -> None:
    """Have a file or a folder on the disk."""
    fd = os.open(path, os.O_RDONLY)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)
