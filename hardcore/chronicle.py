"""The history of the state for people: the last changes with their reasons, kept over the lives of guards.

The manager remembers its own changes; here they get the wall's time, are joined to those of the guards before, written
to `state/history.json` and told to the investigators. Nothing waits for the disk: what it does not take is written with
the next change, and the newest are known from memory meanwhile.
"""

from collections.abc import Callable, Coroutine, Mapping, Sequence
from typing import Any, Protocol

from hardcore.host import clock, files
from hardcore.host.folders import Folders
from hardcore.recovery.reading import StateChange

CHANGES_MAX = 256
_FIELDS = ("at", "before", "after", "phase", "reason")
REASON_CHARACTERS_MAX = 300


class Hands(Protocol):
    """What is needed of the executor around it."""

    def begin(self, work: Coroutine[Any, Any, object]) -> None:
        """Start a piece of work that nobody waits for."""

    async def in_hand(self, work: Callable[..., Any], *args: Any) -> Any:
        """Run blocking work on a hand's thread."""

    def note(self, kind: str, **particulars: object) -> None:
        """Write a line to the guard's log."""


class Chronicle:
    """Keeps the history. `spool` tells the investigators of one thing: its kind, and what there is to say."""

    def __init__(
        self, folders: Folders, hands: Hands, spool: Callable[[str, Mapping[str, Any]], None]
    ) -> None:
        self._path = folders.history
        self._hands = hands
        self._spool = spool
        self._changes = read(folders)
        self._last: StateChange | None = None
        self._writing = False

    def take(self, history: Sequence[StateChange]) -> None:
        """Take in what the manager remembers; what is new of it is written down."""
        if not history or history[-1] == self._last:
            return
        known = history.index(self._last) + 1 if self._last in history else 0
        fresh = [_told(change) for change in history[known:]]
        self._last = history[-1]
        self._changes = (*self._changes, *fresh)[-CHANGES_MAX:]
        for one in fresh:
            self._spool("state", one)
        if not self._writing:
            self._writing = True
            self._hands.begin(self._write())

    def told(self) -> list[Mapping[str, object]]:
        """Return the last changes, the newest last."""
        return list(self._changes)

    async def _write(self) -> None:
        """Write until what is written is what is known: changes may come while a disk is slow."""
        try:
            written: tuple[Mapping[str, object], ...] = ()
            while written is not self._changes:
                written = self._changes
                await self._hands.in_hand(files.write_json, self._path, {"version": 1, "changes": written})
        except OSError as error:
            self._hands.note("history", failed=error.strerror)
        finally:
            self._writing = False


def read(folders: Folders) -> tuple[Mapping[str, object], ...]:
    """Return the changes that were written down; none where there is no file, or none that can be read."""
    kept = files.read_json(folders.history).get("changes")
    if not isinstance(kept, list):
        return ()
    whole = (one for one in kept if isinstance(one, dict) and all(name in one for name in _FIELDS))
    return tuple(whole)[-CHANGES_MAX:]


def _told(change: StateChange) -> dict[str, object]:
    return {
        "at": clock.wall(change.at_ns),
        "before": str(change.before),
        "after": str(change.after),
        "phase": str(change.phase),
        "reason": change.reason[:REASON_CHARACTERS_MAX],
    }
