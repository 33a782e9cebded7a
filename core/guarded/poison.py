"""The poison of a drill: a command, or an event of the log, that kills whoever carries it out.

The guard arms it in a file (`docs/wires.md` section 13) and from then on it is a real fault in a real place: the process
raises a fatal signal on itself while the command is decided, while its batch is written, a moment after its answer, or
whenever the event is rebuilt; in the core, in a spare that walks ahead, in a trial. Nothing in the recovery can tell it
from an accident. Not chosen: a command that carries its own poison; whoever may write to the ledger could then kill it.
"""

import json
import re
import signal
import threading
from collections.abc import Iterable
from enum import StrEnum
from hashlib import sha256
from pathlib import Path
from typing import Final

import msgspec

from core.guarded.quarantine import Unreadable, read_small

FILE: Final = "drill.json"  # beside the rules
FILE_BYTES_MAX: Final = 4096
LATER_S: Final = 0.15
FAULT: Final = "poison"
NAME_CHARACTERS: Final = 32
NAMES_MAX: Final = 64  # poisons of one drill

_NAME: Final = re.compile(r"[0-9a-f]{32}")


class At(StrEnum):
    """When it strikes."""

    DECIDE = "decide"
    WRITE = "write"
    LATER = "later"
    LOG = "log"


class Poison(msgspec.Struct, frozen=True):
    """What is armed. `names`: of the commands that kill; `seq`: of the event, where the log does."""

    names: frozenset[str]
    at: At
    seq: int | None = None


def name_of(key: str) -> str:
    """Return the name under which a key's command stands on the recorder, in a letter and here."""
    return sha256(key.encode("utf-8", "replace")).hexdigest()[:NAME_CHARACTERS]


def is_name(text: str) -> bool:
    """Whether `text` may be the name of a command."""
    return _NAME.fullmatch(text) is not None


def read_poison(raw: bytes) -> Poison | None:
    """Return what the bytes of a file arm; None: nothing. Never raises."""
    try:
        said = json.loads(raw)
    except (ValueError, RecursionError):
        return None
    if not isinstance(said, dict) or said.get("version") != 1 or said.get("fault") != FAULT:
        return None
    names, at, seq = _names(said), said.get("at"), said.get("seq")
    if not names or not isinstance(at, str) or at not in set(At):
        return None
    if seq is not None and (not isinstance(seq, int) or isinstance(seq, bool) or seq < 1):
        return None
    return Poison(names, At(at), seq)


def _names(said: dict[str, object]) -> frozenset[str]:
    """Return all names of a drill: one, or several; none if one of them is no name."""
    names = said.get("names", [said.get("name")])
    if not isinstance(names, list) or len(names) > NAMES_MAX:
        return frozenset()
    told = frozenset(name for name in names if isinstance(name, str) and is_name(name))
    return told if len(told) == len(names) else frozenset()


class Armoury:
    """The poison of one process. `armed` is one value, so any thread may look at it."""

    def __init__(self, path: Path | None = None) -> None:
        """Begin unarmed. `path`: the guard's file; None: nobody drills this process."""
        self._path = path
        self.armed: Poison | None = None

    def read(self) -> None:
        """Take what the file arms; where there is none, or none that can be understood, nothing is. Blocks."""
        raw = None if self._path is None else read_small(self._path, FILE_BYTES_MAX)
        self.armed = None if raw is None or isinstance(raw, Unreadable) else read_poison(raw)

    def strike(self, at: At, names: Iterable[str]) -> None:
        """End this process if one of the commands of these names is the armed one, and this its moment."""
        armed = self.armed
        if armed is None or armed.at is not at or armed.names.isdisjoint(names):
            return
        if at is At.LATER:
            timer = threading.Timer(LATER_S, _die)
            timer.daemon = True  # it must not keep a process from leaving
            timer.start()
        else:
            _die()

    def rebuild(self, seq: int) -> None:
        """End this process if the event of this number is the armed one."""
        armed = self.armed
        if armed is not None and armed.at is At.LOG and armed.seq == seq:
            _die()


def _die() -> None:
    signal.raise_signal(signal.SIGSEGV)  # on this very thread: it is the one that the stacks will name
