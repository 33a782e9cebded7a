"""What the guard says to the doors, and the file that its counts are kept in.

The doors are the gateway's, and it answers them from memory; so once a second while somebody reads them, and every ten
seconds otherwise, it is told the status and the counts in one line of the feed. Nothing of the watch waits for it: the
status is made beside the loop, the file is written by a hand, and while one is being written no second one begins.
"""

import asyncio
from collections.abc import Callable, Mapping
from typing import Any, Final

import psutil

from hardcore.control.protocol import Ask, Request, write_line
from hardcore.counters import Counts, read_counts
from hardcore.door import Door
from hardcore.host import clock, files
from hardcore.house import House
from hardcore.model import observations as seen
from hardcore.model.actions import Incident
from hardcore.model.phases import SERVING
from hardcore.quarantine_file import LETTER_TYPES
from hardcore.recovery.budget import NS_PER_S
from hardcore.recovery.reading import Reading, Transition

#: Somebody who asked within this time may ask again.
ASKED_HOLDS_NS: Final = 60 * NS_PER_S
#: In peace, and while nobody asks.
TELL_EVERY_NS: Final = 10 * NS_PER_S
#: Time and late looks are kept this often; what is counted by its events, at once.
KEEP_EVERY_NS: Final = 300 * NS_PER_S
#: A longer status is cut to what the doors read, so that the line stays one that is heard.
STATUS_BYTES_MAX: Final = 40 << 10
READ_AT_THE_DOORS: Final = ("state", "phase", "core", "spare", "budget", "sentinel", "ledger_verified_at")
#: Files of one incident whose sizes are added up.
EVIDENCE_FILES_MAX: Final = 256
COUNTERS_BYTES_MAX: Final = 1 << 16
FINISH_S: Final = 1.0


class StandingLine:
    """Counts, keeps, and tells."""

    def __init__(
        self,
        house: House,
        door: Door,
        open_incident: Callable[[], Incident | None],
        publish: Callable[[Mapping[str, object]], None],
    ) -> None:
        self._house = house
        self._door = door
        self._open_incident = open_incident
        self._publish = publish
        self._counts: Counts = read_counts(files.read_json(house.folders.counters, COUNTERS_BYTES_MAX))
        self._told_ns: int | None = None
        self._telling = False
        self._kept_ns = clock.now_ns()
        self._keeping = False
        self._news = False  # something was counted that is not in the file

    # ---- what is counted ----

    def hear(self, fact: seen.Observation) -> None:
        """Count what a fact means, once the manager has taken it in."""
        if not isinstance(fact, seen.FirstServed):
            return
        who, incident = self._who(), self._open_incident()
        if who is not None and fact.epoch == self._house.reading().epoch:
            diagnosis = incident.diagnosis if incident is not None else None
            self._news = self._counts.serve(who, fact.epoch, diagnosis) or self._news

    def change(self, change: Transition) -> None:
        """Count what a change of the phase means."""
        self._counts.change(change.before, change.after)

    def close(self, incident: Incident) -> None:
        """Count an incident that is over."""
        self._counts.close(incident)
        self._news = True
        self._house.begin(self._weigh(incident.id))

    def look(self) -> None:
        """A second has passed: tell and keep what is due."""
        now_ns, reading = clock.now_ns(), self._house.reading()
        self._counts.pass_time(reading.state, reading.late_ticks, now_ns)
        who = self._who() if self._house.adopted and reading.phase in SERVING else None
        if who is not None:
            self._counts.adopt(who)
        if not self._telling and self._is_due(now_ns):
            self._telling, self._told_ns = True, now_ns
            self._house.begin(self._tell())
        if not self._keeping and (self._news or now_ns - self._kept_ns >= KEEP_EVERY_NS):
            self._keeping, self._kept_ns, self._news = True, now_ns, False
            self._house.begin(self._keep())

    def _is_due(self, now_ns: int) -> bool:
        asked_ns = self._door.doors_asked_ns
        if asked_ns is not None and now_ns - asked_ns <= ASKED_HOLDS_NS:
            return True
        return self._told_ns is None or now_ns - self._told_ns >= TELL_EVERY_NS

    def _who(self) -> tuple[int, int] | None:
        life = self._house.life()
        if life is None or life.handle is None:
            return None
        return life.handle.identity.pid, life.handle.identity.start

    # ---- what is told and kept ----

    async def _tell(self) -> None:
        try:
            status, _ = await self._door.answer(Request(Ask.STATUS))
            told = {"type": "standing", "status": _bounded(status), "counters": self._told()}
            self._publish(told)
        finally:
            self._telling = False

    def _told(self) -> dict[str, object]:
        reading = self._house.reading()
        now_ns = clock.now_ns()
        due = {str(one.resource): (one.due_ns - now_ns) / NS_PER_S for one in reading.forecasts}
        return {
            **self._counts.told(),
            "letters": self._letters(),
            "forecasts": due,
            "core_started_s": self._began_s(reading),
        }

    def _letters(self) -> dict[str, int]:
        """Return how many letters are in force for each reason; which reasons there are, the guard decides."""
        counted: dict[str, int] = {}
        for rule in self._house.court.rules.aside.rules:
            if rule.get("type") in LETTER_TYPES:
                reason = str(rule.get("reason") or "UNKNOWN")
                counted[reason] = counted.get(reason, 0) + 1
        return counted

    def _began_s(self, reading: Reading) -> float | None:
        """Return when the serving core began, in seconds since 1970."""
        who = self._who() if reading.phase in SERVING else None
        if who is None:
            return None
        try:
            return float(psutil.Process(who[0]).create_time())
        except psutil.Error:  # it died a moment ago; its end is on its way to us
            return None

    async def _keep(self) -> None:
        try:
            await self._house.in_hand(self._write, self._counts.told())
        finally:
            self._keeping = False

    def _write(self, told: dict[str, object]) -> None:
        try:
            files.write_json(self._house.folders.counters, told)
        except OSError:
            self._news = True  # a full disk: the counts go on here, and are written when it takes them

    async def finish(self) -> None:
        """Keep what was counted; the guard ends, and waits no longer than a moment for a disk."""
        self._counts.pass_time(self._house.reading().state, self._house.reading().late_ticks, clock.now_ns())
        await asyncio.wait({asyncio.ensure_future(self._keep())}, timeout=FINISH_S)

    async def _weigh(self, incident: str) -> None:
        """Know how much evidence there is of an incident."""
        self._counts.snapshot_bytes = await self._house.in_hand(self._evidence_bytes, incident)

    def _evidence_bytes(self, incident: str) -> int:
        try:
            found = list((self._house.folders.incidents / incident).iterdir())[:EVIDENCE_FILES_MAX]
            return sum(path.stat().st_size for path in found if path.is_file())
        except OSError:
            return 0


def _bounded(status: Mapping[str, object]) -> Mapping[str, Any]:
    if len(write_line(status)) <= STATUS_BYTES_MAX:
        return status
    return {name: status[name] for name in READ_AT_THE_DOORS if name in status}
