"""The sender's loop: from the outbox to the channels, each channel at its own pace, nothing for ever.

One attempt is one thread with a time limit: whoever hangs is left behind, and the process ends without waiting for
it. An attempt is written down before it is made, so that one that ends the sender counts too: what waits is sent at
least once and never tried more than a few times. Of one incident the beginning is settled before the end is judged.
What is held back and still goes on stays in the outbox; where nothing is due for long, the sender writes down when it
will be and ends, and the guard starts the next one then.
"""

import enum
import os
import queue
import threading
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, assert_never

import msgspec

from hardcore.alerting import book as on_record
from hardcore.alerting.addresses import channels_in_force, now
from hardcore.alerting.book import Book, Entry, Value, at_ms, at_text
from hardcore.alerting.notices import Notice, read_notice, waiting
from hardcore.alerting.outcomes import Sent, failed
from hardcore.alerting.ways import send
from hardcore.alerting.wording import compose
from hardcore.host import files
from hardcore.host.folders import Folders
from hardcore.recovery.channels import Channel, Held, Kind, Moment, Stage, held, lifts_ms

#: Pauses after a failed attempt; after the last one it is given up. Hours in all: what takes a server away (a power
#: cut, a line that is down) takes its way to people along.
PAUSES_S: Final = (15.0, 105.0, 480.0, 1800.0, 7200.0, 21_600.0)
#: One attempt may take this long in all; each wait inside it is shorter.
ATTEMPT_S: Final = 15.0
#: A report is there a second or two after the end of an incident, and nobody hurries it; its closing message, which is
#: worth more with it, waits no longer than this.
REPORT_S: Final = 20.0
#: A mail server may look into a mail before it takes it.
MAIL_ATTEMPT_S: Final = 60.0
LOOK_S: Final = 0.2
#: A sender that has been at work for this long ends, whatever waits: the next one goes on.
LIFE_S: Final = 1200.0
#: Nothing is due for so long: it is not waited for here.
IDLE_MS: Final = 600_000
#: What waited longer since it could have been told is told to nobody any more.
STALE_MS: Final = 86_400_000
REPORT_BYTES_MAX: Final = 1 << 20


class _Flight(msgspec.Struct, frozen=True):
    """An attempt that is under way."""

    notice: Notice
    channel: Channel
    number: int
    began_s: float


class _Step(enum.Enum):
    """What became of a notice on a channel for now."""

    SETTLED = enum.auto()  # it is spared
    APART = enum.auto()  # it is held back, and holds nothing back itself
    FIRST = enum.auto()  # it waits, and its end with it
    OFF = enum.auto()  # an attempt has begun


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
        self._later: dict[
            tuple[str, int], tuple[int, Held | None]
        ] = {}  # when something is due, and why not now
        self._busy = False  # something is due within moments
        self._given_up: set[tuple[str, int]] = set()
        self._ended: set[str] = set()  # incidents whose end waits to be told
        self._newest: dict[str, str] = {}  # of what the floor lies on: the last notice that waits

    def run(self, life_s: float = LIFE_S) -> None:
        """Send until nothing waits any more, or this sender's time is over."""
        give_up_at = time.monotonic() + life_s
        while time.monotonic() < give_up_at:
            named, value, moment = channels_in_force(self._folders), self._book.read(), now(self._folders)
            if named is None:
                return  # nobody can say who is to be told: everything stays as it is
            self._channels = named
            cases = self._cases(value, moment)
            if not cases:
                return
            self._look_over(cases)
            for channel in self._channels:
                if channel.number not in self._flights:
                    self._advance(channel, cases, value, moment)
            self._collect()
            self._settle(cases)
            if self._rests(moment):
                self._put_off(cases)
                return

    def _cases(self, value: Value, moment: Moment) -> list[tuple[Path, Notice]]:
        """Return what waits, in its order; what nobody can read is taken away."""
        cases = []
        for path in waiting((self._folders.outbox, self._folders.run / "alerts")):
            if path.name in self._done:
                continue
            notice = read_notice(path)
            if notice is None or _is_stale(notice, on_record.entry_of(value, notice.id) or {}, moment):
                self._remove(path)
                continue
            self._seen_s.setdefault(notice.id, time.monotonic())
            cases.append((path, notice))
        return sorted(cases, key=lambda case: _rank(case[1]))

    def _look_over(self, cases: list[tuple[Path, Notice]]) -> None:
        self._later.clear()
        self._busy = False
        self._ended = {
            one.incident for _, one in cases if one.stage is Stage.CLOSED and one.incident is not None
        }
        self._newest = {notice.occasion.mark: notice.id for _, notice in cases}

    def _rests(self, moment: Moment) -> bool:
        """Whether nothing is due for long."""
        if self._flights or self._busy or not self._later:
            return False
        return min(due_ms for due_ms, _ in self._later.values()) - moment.at_ms > IDLE_MS

    def _put_off(self, cases: list[tuple[Path, Notice]]) -> None:
        """Write down when each of what waits is due: whoever starts senders goes by it."""
        soonest = min(self._later.values(), key=lambda one: one[0])
        for path, notice in cases:
            own = [due for (name, _), due in self._later.items() if name == notice.id]
            due_ms, why = min(own, key=lambda one: one[0], default=soonest)
            if path.name not in self._done:
                self._book.change(lambda v, n=notice, d=due_ms, w=why: on_record.put_off(v, n, at_text(d), w))  # type: ignore[misc]

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
            if self._is_over(notice, on_record.entry_of(value, notice.id) or {}, channel):
                continue
            if notice.incident is not None and notice.incident in unsettled:
                continue  # the beginning first
            try:
                step = self._step(channel, notice, value, moment)
            except Exception:  # noqa: BLE001  # a bug about one notice must not silence the others
                self._give_up(channel, notice, moment)
                step = _Step.SETTLED
            match step:
                case _Step.OFF:
                    return
                case _Step.FIRST:
                    unsettled.add(notice.incident or "")
                case _Step.SETTLED:
                    self._busy = True
                    value = self._book.read()
                case _Step.APART:
                    continue
                case _:
                    assert_never(step)

    def _step(self, channel: Channel, notice: Notice, value: Value, moment: Moment) -> _Step:
        entry = on_record.entry_of(value, notice.id) or {}
        if (due_ms := self._due_ms(entry, channel, moment)) is not None:
            self._later[notice.id, channel.number] = due_ms, None
            return _Step.FIRST
        if not self._is_ready(notice):
            self._busy = True
            return _Step.FIRST
        memory, what = on_record.memory(value, channel), notice.occasion
        why = held(channel, memory, what, moment)
        if why is None or on_record.attempts_of(entry, channel):
            self._take_off(channel, notice, value, moment)
            return _Step.OFF
        until_ms = lifts_ms(channel, memory, what, moment, why) if self._goes_on(notice) else None
        if until_ms is not None:
            self._later[notice.id, channel.number] = until_ms, why
            return _Step.APART
        self._book.change(lambda v: on_record.spare(v, notice, channel, why))
        return _Step.SETTLED

    def _goes_on(self, notice: Notice) -> bool:
        """Whether what is held back will still be news: the last of its kind, of what is not over by then."""
        if self._newest.get(notice.occasion.mark) != notice.id or notice.stage is Stage.FORECAST:
            return False
        if notice.stage is Stage.CLOSED:
            return True
        incident = notice.incident
        over = incident is None or incident in self._ended or self._file(notice, "incident.json") is not None
        return not over

    def _give_up(self, channel: Channel, notice: Notice, moment: Moment) -> None:
        self._given_up.add((notice.id, channel.number))
        at = at_text(moment.at_ms)
        with suppress(Exception):  # the same bug, perhaps; here it is remembered
            self._book.change(lambda v: on_record.set_out(v, notice, channel, at))
            sent = failed("fault", final=True)
            self._book.change(lambda v: on_record.come_back(v, notice, channel, sent, at))

    def _is_over(self, notice: Notice, entry: Entry, channel: Channel) -> bool:
        tried = on_record.attempts_of(entry, channel)
        if (notice.id, channel.number) in self._given_up or on_record.spared(entry, channel):
            return True
        if any(one.get("ok") is True for one in tried):
            return True
        gave_up = len(tried) > len(self._pauses_s) or any(one.get("final") is True for one in tried)
        return gave_up and channel.number not in self._flights

    def _due_ms(self, entry: Entry, channel: Channel, moment: Moment) -> int | None:
        """Return until when the pause after the last attempt lasts, or None."""
        tried = on_record.attempts_of(entry, channel)
        last_ms = at_ms(tried[-1].get("at")) if tried else None
        if last_ms is None:
            return None
        pause_ms = int(self._pauses_s[min(len(tried), len(self._pauses_s)) - 1] * 1000)
        # A clock that was set back makes the last attempt lie ahead.
        return last_ms + pause_ms if 0 <= moment.at_ms - last_ms < pause_ms else None

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
        late = [
            one for one in self._flights.values() if time.monotonic() - one.began_s > _limit_s(one.channel)
        ]
        for one in late:
            self._land(one, failed("timeout"))

    def _land(self, flight: _Flight, sent: Sent) -> None:
        del self._flights[flight.channel.number]
        self._busy = True
        at = at_text(now(self._folders).at_ms)
        self._book.change(lambda v: on_record.come_back(v, flight.notice, flight.channel, sent, at))

    def _reached_nobody(self, notice: Notice, entry: Entry) -> bool:
        """Whether each channel that is told of this at all has been tried in vain. Without a channel nobody is."""
        asked = [
            channel
            for channel in self._channels
            if not on_record.spared(entry, channel)
            and self._later.get((notice.id, channel.number), (0, None))[1] is None
        ]
        return (bool(asked) or not self._channels) and all(
            self._is_in_vain(notice, entry, channel) for channel in asked
        )

    def _is_in_vain(self, notice: Notice, entry: Entry, channel: Channel) -> bool:
        tried = on_record.attempts_of(entry, channel)
        if any(one["ok"] is True for one in tried):
            return False
        return bool(tried and tried[-1]["ok"] is False) or self._is_over(notice, entry, channel)

    def _settle(self, cases: list[tuple[Path, Notice]]) -> None:
        """Take away what is over on each channel, and say of what nobody was told. Without a channel nothing waits."""
        value = self._book.read()
        for path, notice in cases:
            entry = on_record.entry_of(value, notice.id) or {}
            incident = notice.incident
            if incident is not None and incident not in value["untold"] and incident not in value["told"]:
                at = at_text(now(self._folders).at_ms)
                if self._reached_nobody(notice, entry):
                    self._book.change(lambda v, i=incident, t=at: on_record.nobody(v, i, t))  # type: ignore[misc]
            flying = any(flight.notice.id == notice.id for flight in self._flights.values())
            if not flying and all(self._is_over(notice, entry, channel) for channel in self._channels):
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
        # Asked like this it is no error that a name is too long, or none.
        return path if os.path.isfile(path) else None  # noqa: PTH113


def _attempt(channel: Channel, message: Any) -> Sent:
    try:
        return send(channel, message)
    except Exception:  # noqa: BLE001  # a bug on one way must not silence the others; it is told by its code
        return failed("fault")


def _limit_s(channel: Channel) -> float:
    return MAIL_ATTEMPT_S if channel.kind is Kind.SMTP else ATTEMPT_S


def _rank(notice: Notice) -> tuple[str, int, str]:
    """The order of what waits: by the millisecond in its name, and within one as a story goes."""
    told = (Stage.OPENED, Stage.FORECAST, Stage.WAITS, Stage.OVERDUE, Stage.CLOSED, Stage.TEST)
    return notice.id[:13], told.index(notice.stage), notice.id


def _is_stale(notice: Notice, entry: Entry, moment: Moment) -> bool:
    known = [at_ms(at) for at in (notice.at, entry.get("again_at")) if at]
    put_ms = max((at for at in known if at is not None), default=None)
    return put_ms is not None and moment.at_ms - put_ms > STALE_MS
