"""Where it is kept who may come in: three small files of the owner's alone, in the data's state folder.

`access.json` is written by `hardcore passwd` and `token`, and by the gateway when an invitation is used; `doorway.json` by
`hardcore up`; `sessions.json` by the gateway. Each is replaced whole. One that can't be read is told as such: a file of
people that is damaged must not open the door.
"""

import fcntl
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import msgspec

from hardcore.access.doorway import Doorway
from hardcore.access.people import People
from hardcore.access.sessions import Session
from hardcore.host import files

PEOPLE: Final = "access.json"
DOORWAY: Final = "doorway.json"
SESSIONS: Final = "sessions.json"
_LOCK: Final = "access.lock"


class Unreadable(msgspec.Struct, frozen=True):
    """Why a file says nothing."""

    why: str


#: Why the bytes of a file are none of ours. A letter that is damaged raises what msgspec does not count among its own.
_DAMAGED: Final = (OSError, msgspec.DecodeError, UnicodeDecodeError, RecursionError)


class _Kept(msgspec.Struct, frozen=True):
    boot: str
    sessions: tuple[Session, ...]


def read_people(state: Path) -> People | Unreadable:
    """Who may come in; nobody, where nothing was set."""
    try:
        return msgspec.json.decode(files.read_small(state / PEOPLE), type=People)
    except FileNotFoundError:
        return People()
    except _DAMAGED as error:
        return Unreadable(str(error))


def write_people(state: Path, people: People) -> None:
    """Keep who may come in, whatever was kept before. OSError where the disk refuses it."""
    files.write_whole(state / PEOPLE, msgspec.json.encode(people))


def change_people(state: Path, change: Callable[[People], People | None]) -> People | Unreadable | None:
    """Change who may come in: the command line and the gateway may do so at the same moment, and neither's is lost.

    `change` gives what is kept from now on; None: nothing is changed, and None comes back. OSError where the disk refuses it.
    """
    with _alone(state):
        people = read_people(state)
        changed = change(people) if isinstance(people, People) else people
        if isinstance(changed, People):
            write_people(state, changed)
        return changed


@contextmanager
def _alone(state: Path) -> Iterator[None]:
    lock = os.open(state / _LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX)  # held for a moment only: nobody waits for a person
        yield
    finally:
        os.close(lock)


def read_doorway(state: Path) -> Doorway:
    """What `up` was told; nothing where it is not known: then only this machine is served."""
    try:
        return msgspec.json.decode(files.read_small(state / DOORWAY), type=Doorway)
    except _DAMAGED:
        return Doorway()


def write_doorway(state: Path, doorway: Doorway) -> None:
    """Keep what `up` was told."""
    files.write_whole(state / DOORWAY, msgspec.json.encode(doorway))


def read_sessions(state: Path, boot: str) -> tuple[Session, ...]:
    """Who was signed in when the last gateway ended, in this boot of the machine."""
    try:
        kept = msgspec.json.decode(files.read_small(state / SESSIONS), type=_Kept)
    except _DAMAGED:
        return ()
    return kept.sessions if kept.boot == boot else ()


def write_sessions(state: Path, boot: str, sessions: tuple[Session, ...]) -> None:
    """Keep who is signed in."""
    files.write_whole(state / SESSIONS, msgspec.json.encode(_Kept(boot, sessions)))
