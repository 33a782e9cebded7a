"""`state/alerts.json`: what was told to whom, what came of it, and what each channel remembers.

A sender and a person's own try may write at the same time, so every change reads the file anew under a lock of its own.
Where the disk takes no write the book goes on in the run folder, and in memory where that refuses as well: a full disk is
what people have to be told of. A number that grows with each change says which copy is the newest.
"""

import datetime as dt
import fcntl
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from hardcore.alerting.as_read import ENTRIES_MAX, INCIDENTS_MAX, book_of, number_of
from hardcore.alerting.notices import Notice
from hardcore.alerting.outcomes import Sent
from hardcore.host import files
from hardcore.host.folders import Folders
from hardcore.recovery.channels import Channel, Held, Memory, Occasion, after_held, after_told

VERSION: Final = 1
BOOK_BYTES_MAX: Final = 4 << 20

Entry = dict[str, Any]
Value = dict[str, Any]


class Book:
    """The book of one data folder."""

    def __init__(self, folders: Folders) -> None:
        self._paths = (folders.alerts, folders.run / "alerts.json")
        self._locks = tuple(path.with_name("alerts.book.lock") for path in self._paths)
        self._known: Value = {}

    def read(self) -> Value:
        """Return the newest copy."""
        copies = [self._known, *(files.read_json(path, BOOK_BYTES_MAX) for path in self._paths)]
        return book_of(max(copies, key=_serial))

    def change(self, how: Callable[[Value], None]) -> None:
        """Change it. What can't be written is kept here until something can."""
        lock = self._lock()
        try:
            value = self.read()
            how(value)
            value["version"], value["serial"] = VERSION, _serial(value) + 1
            self._known = value
            self._write(value)
        finally:
            if lock is not None:
                os.close(lock)

    def _write(self, value: Value) -> None:
        for path in self._paths:
            try:
                files.write_json(path, value, durable=path == self._paths[0])
            except OSError:
                continue
            return

    def _lock(self) -> int | None:
        for path in self._locks:
            try:
                fd = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
            except OSError:
                continue
            fcntl.flock(fd, fcntl.LOCK_EX)  # held for one small write
            return fd
        return None


def _serial(value: Value) -> int:
    return number_of(value.get("serial")) or 0


# ---- what stands in it ----


def entries(value: Value) -> list[Entry]:
    """Return the notices that are on record, the oldest first."""
    found = value.get("last")
    return [one for one in found if isinstance(one, dict)] if isinstance(found, list) else []


def entry_of(value: Value, notice_id: str) -> Entry | None:
    """Return what is on record of one notice."""
    return next((one for one in entries(value) if one.get("id") == notice_id), None)


def begin(value: Value, notice: Notice) -> Entry:
    """Return the entry of a notice, made if there is none."""
    known = entry_of(value, notice.id)
    if known is not None:
        return known
    fresh: Entry = {
        "id": notice.id,
        "at": notice.at,
        "stage": str(notice.stage),
        "diagnosis": notice.diagnosis,
        "incident": notice.incident,
        "delivered_at": None,
        "attempts": [],
        "held": None,
        "again_at": None,
        "spared": {},
    }
    value["last"] = [*entries(value), fresh][-ENTRIES_MAX:]
    return fresh


def attempts_of(entry: Entry, channel: Channel) -> list[Entry]:
    """Return the attempts to reach one channel, the oldest first."""
    found = entry.get("attempts")
    tried = found if isinstance(found, list) else []
    return [one for one in tried if isinstance(one, dict) and one.get("channel") == channel.number]


def spared(entry: Entry, channel: Channel) -> str | None:
    """Return why one channel was not told."""
    found = entry.get("spared")
    why = found.get(str(channel.number)) if isinstance(found, dict) else None
    return why if isinstance(why, str) else None


def spare(value: Value, notice: Notice, channel: Channel, why: Held) -> None:
    """Note that a channel is not told, and count it among what was left out."""
    entry = begin(value, notice)
    entry["spared"] = {**entry["spared"], str(channel.number): str(why)}
    entry["again_at"] = None
    if not entry["attempts"]:
        entry["held"] = str(why)
    remember(value, channel, after_held(memory(value, channel), notice.occasion))


def set_out(value: Value, notice: Notice, channel: Channel, at: str) -> None:
    """Note that an attempt begins: one that ends its sender counts as well."""
    entry = begin(value, notice)
    fresh = {"channel": channel.number, "at": at, "ok": None, "status": None, "why": ""}
    entry["attempts"] = [*entry["attempts"], fresh]
    entry["held"], entry["again_at"] = None, None


def put_off(value: Value, notice: Notice, at: str, why: Held | None) -> None:
    """Note that nothing more is done about a notice before then. `why`: what holds it back; None: a pause."""
    entry = begin(value, notice)
    entry["again_at"] = at
    if why is not None and not entry["attempts"]:
        entry["held"] = str(why)


def come_back(value: Value, notice: Notice, channel: Channel, sent: Sent, at: str) -> None:
    """Note what came of the attempt that is under way."""
    entry = begin(value, notice)
    for tried in attempts_of(entry, channel)[-1:]:
        tried |= {"ok": sent.ok, "status": sent.status, "why": sent.why, "final": sent.final}
    note_channel(value, channel, sent, at)
    if sent.ok:
        entry["delivered_at"] = entry["delivered_at"] or at
        told(value, notice.occasion, channel, at)


def told(value: Value, what: Occasion, channel: Channel, at: str) -> None:
    """Note that a channel was told of something."""
    remember(value, channel, after_told(memory(value, channel), what, _ms(at)))
    if what.incident is not None:
        _forget(value, "untold", what.incident)
        _name(value, "told", what.incident, at)


def nobody(value: Value, incident: str, at: str) -> None:
    """Note that each channel was tried for this incident, and none could be reached."""
    if incident not in _times(value, "told"):
        _name(value, "untold", incident, at)


def note_channel(value: Value, channel: Channel, sent: Sent, at: str) -> None:
    """Note how a channel was reached last."""
    known = channels(value).get(channel.number, {})
    counts = {name: _count(known.get(name)) for name in ("sent", "failed")}
    counts["sent" if sent.ok else "failed"] += 1
    fresh = {
        "number": channel.number,
        "kind": str(channel.kind),
        "name": channel.name,
        "place": channel.place,
        "ok": sent.ok,
        "at": at,
        "status": sent.status,
        "why": sent.why,
        **counts,
    }
    others = [one for number, one in channels(value).items() if number != channel.number]
    value["channels"] = sorted([*others, fresh], key=lambda one: int(one["number"]))


def channels(value: Value) -> dict[int, Entry]:
    """Return what is on record of each channel, by its number."""
    found = value.get("channels")
    known = found if isinstance(found, list) else []
    return {
        one["number"]: one for one in known if isinstance(one, dict) and isinstance(one.get("number"), int)
    }


def _count(value: object) -> int:
    return value if isinstance(value, int) else 0


def _times(value: Value, name: str) -> dict[str, str]:
    found = value.get(name)
    return found if isinstance(found, dict) else {}


def _name(value: Value, name: str, incident: str, at: str) -> None:
    known = {**_times(value, name)}
    known.setdefault(incident, at)
    value[name] = dict(list(known.items())[-INCIDENTS_MAX:])


def _forget(value: Value, name: str, incident: str) -> None:
    value[name] = {one: at for one, at in _times(value, name).items() if one != incident}


# ---- what a channel remembers ----


def memory(value: Value, channel: Channel) -> Memory:
    """Return what this channel remembers. One that has another address by now begins anew."""
    known = value.get("memory")
    found = known.get(_key(channel)) if isinstance(known, dict) else None
    if not isinstance(found, dict):
        return Memory()
    incidents = found.get("incidents")
    return Memory(
        _pairs(found.get("told_ms")),
        _pairs(found.get("left_out")),
        tuple(str(one) for one in incidents) if isinstance(incidents, list) else (),
    )


def remember(value: Value, channel: Channel, what: Memory) -> None:
    """Keep what this channel remembers."""
    known = value.get("memory")
    fresh = {
        "told_ms": dict(what.told_ms),
        "left_out": dict(what.left_out),
        "incidents": list(what.incidents),
    }
    value["memory"] = {**(known if isinstance(known, dict) else {}), _key(channel): fresh}


def _key(channel: Channel) -> str:
    return f"{channel.number} {channel.kind} {channel.place}"


def _pairs(value: object) -> tuple[tuple[str, int], ...]:
    if not isinstance(value, dict):
        return ()
    return tuple((str(name), number) for name, number in value.items() if isinstance(number, int))


# ---- times ----


def at_text(at_ms: int) -> str:
    """Return a moment of the wall clock as RFC 3339."""
    moment = dt.datetime.fromtimestamp(at_ms / 1000, tz=dt.UTC)
    return moment.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def _ms(at: str) -> int:
    return at_ms(at) or 0


def at_ms(at: object) -> int | None:
    """Return a moment of the wall clock in milliseconds; None: it is none."""
    try:
        return int(dt.datetime.fromisoformat(str(at)).timestamp() * 1000)
    except (ValueError, OverflowError, OSError):
        return None


def lock_paths(folders: Folders) -> tuple[Path, ...]:
    """Return where the one sender of a data folder holds its lock; the second where the first takes none."""
    return folders.state / "alerts.lock", folders.run / "alerts.lock"
