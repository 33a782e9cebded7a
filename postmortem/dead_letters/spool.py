"""The spool: what the guard has to say to the investigators, one file a message, in the order of their names.

A message is written whole (temporary name, synced, renamed) and removed by the reader alone, after it has committed
what it says; so each is taken in once, whoever dies between. A socket was not chosen: the investigators are often
not running, and the guard never waits for them. The guard's own process writes here: standard library and msgspec only. What goes
wrong on the disk is the value `SpoolFailed`.
"""

import errno
import json
import os
import re
import stat
import time
import uuid
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import msgspec

from postmortem import placing

VERSION: Final = 1

#: One message: a request of 1 MiB in base64, and the words around it.
MESSAGE_BYTES_MAX: Final = 4 << 20
#: Messages that may wait; beyond, a new one is refused, so that a guard whose investigators never come fills no disk.
MESSAGES_MAX: Final = 10_000

_NAME = re.compile(r"[0-9a-f]{8}-[0-9a-f]{4}-7[0-9a-f]{3}-[89ab][0-9a-f]{3}-[0-9a-f]{12}\.json")
_KIND = re.compile(r"[a-z][a-z-]{0,31}")


class SpoolFailed(msgspec.Struct, frozen=True):
    """A message could not be written; `reason` is one sentence for people."""

    reason: str


class Message(msgspec.Struct, frozen=True):
    """One message of the guard. `kind`: letter, drill, act. `fields`: as they came, `at` among them."""

    path: Path
    kind: str
    fields: Mapping[str, Any]


class Unreadable(msgspec.Struct, frozen=True):
    """A file of the spool that says nothing to us; `reason` in a few words."""

    path: Path
    reason: str


def write(spool: Path, kind: str, fields: Mapping[str, Any]) -> Path | SpoolFailed:
    """Write one message and return its file: when this returns a path, the message outlives a power failure.

    `fields` has no need of `version` and `type`; without an `at` it gets the wall clock's time.
    """
    assert _KIND.fullmatch(kind), kind
    told = {"at": placing.now(), **fields, "version": VERSION, "type": kind}
    data = json.dumps(told, ensure_ascii=False, separators=(",", ":")).encode("utf-8", "backslashreplace")
    if len(data) > MESSAGE_BYTES_MAX:
        return SpoolFailed(f"the message has {len(data)} bytes, {MESSAGE_BYTES_MAX} are allowed")
    try:
        spool.mkdir(mode=0o700, parents=True, exist_ok=True)
        if len(_names(spool)) >= MESSAGES_MAX:
            return SpoolFailed(f"{MESSAGES_MAX} messages wait for the investigators already")
        path = spool / f"{new_id()}.json"
        placing.replace(spool, path.name, data)
        placing.sync_folder(spool)
    except OSError as error:
        return SpoolFailed(placing.why(error, "the message could not be written"))
    return path


def read_all(spool: Path) -> Iterator[Message | Unreadable]:
    """Give the messages that wait, the oldest first, one at a time. An absent spool has none.

    What can't be looked at now (no descriptor is left, a disk stutters) is passed over: it waits for the next look.
    """
    try:
        names = _names(spool)
    except OSError:
        return
    for name in sorted(names)[:MESSAGES_MAX]:
        found = read(spool / name)
        if found is not None:
            yield found


def read(path: Path) -> Message | Unreadable | None:
    """Read one message; None: not now. No link is followed, and nothing larger than the maximum is read."""
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
        try:
            about = os.fstat(handle)
            if not stat.S_ISREG(about.st_mode) or about.st_size > MESSAGE_BYTES_MAX:
                return Unreadable(path, "not a file of the spool, or too large")
            data = placing.read_up_to(handle, MESSAGE_BYTES_MAX)
        finally:
            os.close(handle)
        told = json.loads(data)
    except OSError as error:
        # Only a link is bad for good: what the system can't do at this moment says nothing of the message.
        return Unreadable(path, placing.words(error)) if error.errno == errno.ELOOP else None
    except (ValueError, RecursionError):
        return Unreadable(path, "not JSON")
    return _message(path, told)


def _message(path: Path, told: object) -> Message | Unreadable:
    if not isinstance(told, dict):
        return Unreadable(path, "not an object")
    kind = told.get("type")
    if told.get("version") != VERSION:
        return Unreadable(path, "of another version")
    if not isinstance(kind, str) or not _KIND.fullmatch(kind):
        return Unreadable(path, "without a type")
    return Message(path, kind, told)


def _names(spool: Path) -> list[str]:
    with os.scandir(spool) as items:
        return [item.name for item in items if _NAME.fullmatch(item.name)]


def new_id() -> str:
    """A new UUIDv7; of two that one process makes, the later one sorts later."""
    # Version 7 with the clock's next twelve bits after its milliseconds (RFC 9562, 6.2): messages of one
    # millisecond keep their order too, and a letter's second attempt is not read before its first.
    ms, rest_ns = divmod(time.time_ns(), 1_000_000)
    value = (ms & (1 << 48) - 1) << 80 | 0x7 << 76 | (rest_ns << 12) // 1_000_000 << 64
    value |= 0b10 << 62 | int.from_bytes(os.urandom(8)) & (1 << 62) - 1
    return str(uuid.UUID(int=value))
