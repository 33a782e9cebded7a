"""Layouts that a household adds: `DATA/formats/*.toml`, in the language of those that come with the program.

They are read at each look at a file, so a new one counts at once. A broken one is told by its name and its fault and
stops no other; one with the id of a layout of ours takes its place. What is too large, too many or no plain file is not
opened. Not chosen: to keep them in the ledger; a text file is what a person can write, send and put right.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

import msgspec

from core.imports.reading.formats import Format, builtin_formats, read_format

FOLDER: Final = "formats"  # in the data folder
FILES_MAX: Final = 200
FILE_BYTES_MAX: Final = 64 << 10
_FAULT_CHARACTERS_MAX: Final = 200


class Broken(msgspec.Struct, frozen=True):
    """A file that is no layout, and why: in the words of whoever reads such files, which are English."""

    file: str
    why: str


class Known(msgspec.Struct, frozen=True):
    """All layouts by id, which of them are the household's own, and what could not be read."""

    formats: Mapping[str, Format]
    own: Mapping[str, Format] = {}
    broken: tuple[Broken, ...] = ()


def known_formats(folder: Path | None) -> Known:
    """The layouts that come with the program, and over them those in `folder`. Blocks."""
    if folder is None:
        return Known(builtin_formats())
    own: dict[str, Format] = {}
    broken: list[Broken] = []
    for path in _files(folder):
        read = _read(path)
        if isinstance(read, Format):
            own[read.id] = read
        else:
            broken.append(read)
    return Known({**builtin_formats(), **own}, own, tuple(broken))


def with_own(own: tuple[Format, ...]) -> Mapping[str, Format]:
    """The layouts that come with the program, and over them those that an import has kept."""
    return {**builtin_formats(), **{one.id: one for one in own}} if own else builtin_formats()


def _files(folder: Path) -> Iterator[Path]:
    try:
        found = sorted(path for path in folder.glob("*.toml") if not path.name.startswith("."))
    except OSError:
        return
    yield from found[:FILES_MAX]


def _read(path: Path) -> Format | Broken:
    try:
        if not path.is_file():  # a pipe would be waited for without end
            return Broken(path.name, "it is no plain file")
        with path.open("rb") as file:
            data = file.read(FILE_BYTES_MAX + 1)
        if len(data) > FILE_BYTES_MAX:
            return Broken(path.name, f"it is larger than {FILE_BYTES_MAX} bytes")
        read = read_format(data.decode("utf-8-sig"), path.stem)
    except OSError as error:
        return Broken(path.name, error.strerror or "it can't be read")
    except UnicodeDecodeError:
        return Broken(path.name, "it is not UTF-8")
    if isinstance(read, Format):
        return read
    why = " ".join(fault.removeprefix(f"{path.stem}: ") for fault in read).rstrip(".")
    return Broken(path.name, why[:_FAULT_CHARACTERS_MAX])
