"""Troubles: the ways in which the desk says no, as values without a language."""

import msgspec

from core.imports.reading.mapping import MappingFault


class Trouble(msgspec.Struct, frozen=True):
    """A no: the slug of its problem and the values its sentence names.

    `reason` says for a file why it gave no rows, `faults` for a mapping what is wrong with it. `done_before`: an
    earlier request of this name was carried out, so nobody may be told that nothing was done.
    """

    slug: str
    values: dict[str, str] = {}
    reason: str | None = None
    faults: tuple[MappingFault, ...] = ()
    done_before: bool = False


def unreadable(reason: str, line: int | None = None) -> Trouble:
    """The file gives no rows."""
    return Trouble("file-unreadable", {} if line is None else {"line": str(line)}, reason)


def reading_only(safe: str, *, done_before: bool = False) -> Trouble:
    """The core serves reads only, because of the diagnosis `safe`."""
    return Trouble("safe-mode", {"why": safe}, done_before=done_before)
