"""The sender's loop: from the outbox to the channels, each channel at its own pace, nothing for ever.

One attempt is one thread with a time limit: whoever hangs is left behind, and the process ends without waiting for
it. An attempt is written down before it is made, so that one that ends the sender counts too: what waits is sent at
least once and never tried more than a few times. Of one incident the beginning is settled before the end is judged.
"""

import queue
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from hardcore.alerting import book as on_record
from hardcore.alerting.addresses import channels_in_force, now
from hardcore.alerting.book import Book, Entry, Value, at_ms, at_text
from hardcore.alerting.notices import Notice, read_notice, waiting
from hardcore.alerting.outcomes import Sent, failed
from hardcore.alerting.ways import send
from hardcore.alerting.wording import compose
from hardcore.host import files
from hardcore.host.folders import Folders
from hardcore.recovery.channels import Channel, Moment, Stage, held

#: Pauses after a failed attempt; after the last one it is given up.
PAUSES_S: Final = (15.0, 105.0, 480.0)
#: One attempt may take this long in all; each wait inside it is shorter.
ATTEMPT_S: Final = 15.0
#: A report is there a second or two after the end of an incident, and nobody hurries it; its closing message, which is
#: worth more with it, waits no longer than this.
REPORT_S: Final = 20.0
LOOK_S: Final = 0.2
#: A sender that has been at work for this long ends, whatever waits: the next one goes on.
LIFE_S: Final = 1200.0
#: What waited longer is told to nobody any more.
STALE_MS: Final = 86_400_000
REPORT_BYTES_MAX: Final = 1 << 20


@dataclass(frozen=True, slots=True)
class _Flight:
    """An attempt that is under way."""

    notice: Notice
    channel: Channel
    number: int
    began_s: float


class Sender:
    """Sends what waits in the outbox of one data folder. Holds its lock as long as it lives."""

    def __init__(self, folders: Folders, pauses_s: Sequence[float] = PAUSES_S) -> None:
        self._folders = folders
        self._pauses_s = pauses_s
        self._book = Book(folders)
        self._flights: dict[int, _Flight] = {}
        self._landed: queue.SimpleQueue[tuple[_Flight, Sent]] = queue.SimpleQueue()
        self._count = 0
        self._seen_s: dict[str, float] = {}
        self._done: set[str] = set()  # also where a file can't be removed
        self._channels: tuple[Channel, ...] = ()

    def run(self, life_s: float = LIFE_S) -> None:
        """Send until nothing waits any more, or this sender's time is over."""
        give_up_at = time.monotonic() + life_s
        while time.monotonic() < give_up_at:
            self._channels = channels_in_force(self._folders)
            cases = self._cases()
            if not cases:
                return
            value, moment = self._book.read(), now(self._folders)
            for channel in self._channels:
                if channel.number not in self._flights:
                    self._advance(channel, cases, value, moment)
            self._collect()
            self._settle(cases)

    def _cases(self) -> list[tuple[Path, Notice]]:
        """Return what waits, in its order; what nobody can read is taken away."""
        cases = []
        for path in waiting((self._folders.outbox, self._folders.run / "alerts")):
            if path.name in self._done:
                continue
            notice = read_notice(path)
            if notice is None or _is_stale(notice):
                self._remove(path)
                continue
            self._seen_s.setdefault(notice.id, time.monotonic())
            cases.append((path, notice))
        return sorted(cases, key=lambda case: _rank(case[1]))

    def _remove(self, path: Path) -> None:
        self._done.add(path.name)
        try:
            path.unlink(missing_ok=True)
        except OSError:
            return  # a disk that takes no write: it is remembered here

    # ---- one channel ----

    def _advance(
        self, channel: Channel, cases: list[tuple[Path, Notice]], value: Value, moment: Moment
    ) -> None:
        """Begin the next attempt that is due on this channel, if there is one."""
        unsettled: set[str] = set()
        for _, notice in cases:
            entry = on_record.entry_of(value, notice.id) or {}
            if self._is_over(entry, channel):
                continue
            if notice.incident is not None and notice.incident in unsettled:
                continue  # the beginning first
            if not self._is_due(entry, channel, moment) or not self._is_ready(notice):
                unsettled.add(notice.incident or "")
                continue
            why = held(channel, on_record.memory(value, channel), notice.occasion, moment)
            if why is None or on_record.attempts_of(entry, channel):
                self._take_off(channel, notice, value, moment)
                return
            self._book.change(lambda v, n=notice, w=why: on_record.spare(v, n, channel, w))  # type: ignore[misc]
            value = self._book.read()

    def _is_over(self, entry: Entry, channel: Channel) -> bool:
        tried = on_record.attempts_of(entry, channel)
        if on_record.spared(entry, channel) or any(one.get("ok") is True for one in tried):
            return True
        gave_up = len(tried) > len(self._pauses_s) or any(one.get("final") is True for one in tried)
        return gave_up and channel.number not in self._flights

    def _is_due(self, entry: Entry, channel: Channel, moment: Moment) -> bool:
        tried = on_record.attempts_of(entry, channel)
        if not tried:
            return True
        last_ms = at_ms(tried[-1].get("at"))
        pause_ms = self._pauses_s[len(tried) - 1] * 1000
        # A clock that was set back makes the last attempt lie ahead.
        return last_ms is None or not 0 <= moment.at_ms - last_ms < pause_ms

    def _is_ready(self, notice: Notice) -> bool:
        """Whether what the message says is on record: its end waits a moment for the report."""
        if notice.stage is not Stage.CLOSED or notice.incident is None or self._file(notice, "report.json"):
            return True
        return time.monotonic() - self._seen_s[notice.id] >= REPORT_S

    def _take_off(self, channel: Channel, notice: Notice, value: Value, moment: Moment) -> None:
        # An end is told of one outage; what was left out belongs to the next beginning.
        known = on_record.memory(value, channel)
        left_out = 0 if notice.stage is Stage.CLOSED else known.count(notice.occasion.mark)
        message = compose(notice, self._facts(notice), channel.lang, left_out)
        self._count += 1
        flight = _Flight(notice, channel, self._count, time.monotonic())
        self._book.change(lambda v: on_record.set_out(v, notice, channel, at_text(moment.at_ms)))
        self._flights[channel.number] = flight
        work = threading.Thread(
            target=lambda: self._landed.put((flight, _attempt(channel, message))), daemon=True
        )
        work.start()

    # ---- what came of it ----

    def _collect(self) -> None:
        """Take in what has come back, and leave behind who hangs."""
        try:
            flight, sent = self._landed.get(timeout=LOOK_S)
        except queue.Empty:
            pass
        else:
            if self._flights.get(flight.channel.number) == flight:
                self._land(flight, sent)
        late = [one for one in self._flights.values() if time.monotonic() - one.began_s > ATTEMPT_S]
        for one in late:
            self._land(one, failed("timeout"))

    def _land(self, flight: _Flight, sent: Sent) -> None:
        del self._flights[flight.channel.number]
        at = at_text(now(self._folders).at_ms)
        self._book.change(lambda v: on_record.come_back(v, flight.notice, flight.channel, sent, at))
        incident = flight.notice.incident
        if incident is not None and not sent.ok and self._reached_nobody(flight.notice):
            self._book.change(lambda v: on_record.nobody(v, incident, at))

    def _reached_nobody(self, notice: Notice) -> bool:
        """Whether each channel has been tried for this notice in vain."""
        entry = on_record.entry_of(self._book.read(), notice.id) or {}
        tried = [on_record.attempts_of(entry, channel) for channel in self._channels]
        return all(ones and all(one.get("ok") is False for one in ones) for ones in tried)

    def _settle(self, cases: list[tuple[Path, Notice]]) -> None:
        """Take away what is over on each channel. Without a channel nothing is anybody's."""
        value = self._book.read()
        for path, notice in cases:
            entry = on_record.entry_of(value, notice.id) or {}
            flying = any(flight.notice.id == notice.id for flight in self._flights.values())
            if not flying and all(self._is_over(entry, channel) for channel in self._channels):
                self._remove(path)

    # ---- what is on record of an incident ----

    def _facts(self, notice: Notice) -> Mapping[str, Any]:
        for name in ("report.json", "incident.json", "opening.json"):
            path = self._file(notice, name)
            if path is not None and (facts := files.read_json(path, REPORT_BYTES_MAX)):
                return facts
        return {}

    def _file(self, notice: Notice, name: str) -> Path | None:
        # It comes from a file: it must not lead out of the folder.
        incident = notice.incident or ""
        if not incident or "/" in incident or incident.startswith("."):
            return None
        path = self._folders.incidents / incident / name
        return path if path.is_file() else None


def _attempt(channel: Channel, message: Any) -> Sent:
    try:
        return send(channel, message)
    except Exception:  # noqa: BLE001  # a bug on one way must not silence the others; it is told by its code
        return failed("fault")


def _rank(notice: Notice) -> tuple[str, int, str]:
    """The order of what waits: by the millisecond in its name, and within one as a story goes."""
    told = (Stage.OPENED, Stage.FORECAST, Stage.WAITS, Stage.OVERDUE, Stage.CLOSED, Stage.TEST)
    return notice.id[:13], told.index(notice.stage), notice.id


def _is_stale(notice: Notice) -> bool:
    put_ms = at_ms(notice.at)
    return put_ms is not None and time.time_ns() // 1_000_000 - put_ms > STALE_MS
