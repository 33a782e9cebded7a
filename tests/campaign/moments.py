"""When a fault strikes: a moment of the core's work, or of a recovery, waited for and then met.

A moment that does not come within its patience is not forced: the fault strikes all the same, and what was
really met (the phase the guard had told last, the stage that the recorder page showed) is what the coverage
counts. Guessing a moment by sleeping was not chosen: a machine under load would move it.
"""

import contextlib
import json
import socket
import threading
import time
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final, Self

from hardcore.host.recorder import PageReader
from hardcore.model.recorder import SlotStage
from tests.integration.house import House

#: A moment that has not come by then does not come in this run.
PATIENCE_S: Final = 3.0
_LOOK_S: Final = 0.0002
_DIAL_S: Final = 0.02


class Moment(StrEnum):
    """When to strike."""

    ANY = "any"
    QUEUED = "queued"
    DECIDING = "deciding"
    WRITING = "writing"
    COMMITTED = "committed"
    ANSWERING = "answering"
    STARTING = "STARTING"
    PROVING = "PROVING"
    PROBATION = "PROBATION"
    EVIDENCE = "SNAPSHOT_LIVE"
    SWITCHING = "SWITCHING"
    DRAINING = "DRAINING"


#: Moments of a transaction, by the stage that its slot shows.
STAGES: Final = {
    Moment.QUEUED: SlotStage.QUEUED,
    Moment.DECIDING: SlotStage.DECIDING,
    Moment.WRITING: SlotStage.WRITING,
    Moment.COMMITTED: SlotStage.COMMITTED,
    Moment.ANSWERING: SlotStage.ANSWERING,
}
#: Moments of a recovery: they come only after something else has struck.
PHASES: Final = frozenset(Moment) - set(STAGES) - {Moment.ANY}


@dataclass
class Feed:
    """The phase as the guard tells it, heard on the feed that the gateway hears; dialled again after each guard."""

    house: House
    phase: str = "none"
    _changed: threading.Condition = field(default_factory=threading.Condition)
    _over: threading.Event = field(default_factory=threading.Event)
    _thread: threading.Thread | None = None

    def __enter__(self) -> Self:
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        assert self._thread is not None, "it was entered"
        self._thread.join(10)

    def wait(self, phase: str) -> bool:
        """Wait until the guard says this phase; return whether it did."""
        with self._changed:
            return self._changed.wait_for(lambda: self.phase == phase, PATIENCE_S)

    def _listen(self) -> None:
        while not self._over.is_set():
            with contextlib.suppress(OSError, ValueError), socket.socket(socket.AF_UNIX) as line:
                line.settimeout(0.2)
                line.connect(str(self.house.folders.control))
                line.sendall(b'{"verb": "subscribe"}\n')
                self._hear(line)
            self._over.wait(_DIAL_S)

    def _hear(self, line: socket.socket) -> None:
        rest = b""
        while not self._over.is_set():
            try:
                data = line.recv(65536)
            except TimeoutError:
                continue
            if not data:
                return
            *whole, rest = (rest + data).split(b"\n")
            for one in whole:
                told = json.loads(one)
                if told.get("type") == "phase":
                    with self._changed:
                        self.phase = told["phase"]
                        self._changed.notify_all()


def reached(house: House, feed: Feed, moment: Moment) -> str:
    """Wait for the moment; return what was really met: a stage of a transaction, or a phase."""
    if moment in PHASES:
        feed.wait(moment.value)
    stage = STAGES.get(moment)
    if stage is not None and _shown(house, stage):
        return moment.value
    return feed.phase


def _shown(house: House, stage: SlotStage) -> bool:
    """Whether the serving core's page showed a command in this stage within the patience."""
    page = _page(house)
    if page is None:
        return False
    give_up_at, pause = time.monotonic() + PATIENCE_S, threading.Event()
    with contextlib.closing(page):
        while time.monotonic() < give_up_at:
            if any(note.stage is stage for note in page.in_flight() or ()):
                return True
            pause.wait(_LOOK_S)
    return False


def _page(house: House) -> PageReader | None:
    pid = (house.status().get("core") or {}).get("pid")
    for path in house.folders.run.glob("recorder-*"):
        if "." in path.name:
            continue
        reader = PageReader(path)
        identity = reader.identity() if reader.fault is None else None
        if identity is not None and identity[0] == pid:
            return reader
        reader.close()
    return None
