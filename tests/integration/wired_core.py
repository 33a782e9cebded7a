"""A core's process on the wires of a guard, and a test in the guard's place: it starts spares, promotes and drains."""

import json
import socket
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hardcore.host.recorder import PageReader, make_page
from hardcore.model.recorder import LifeState, Page
from tests import stores
from tests.integration.lone_core import Core, started
from tests.waiting import WAIT_S, until

DATAGRAM_BYTES = 4096
# It loads at a low priority, so where others keep the processors busy it has a fortieth of one.
SPARE_S = 45.0
Words = dict[str, str]


@dataclass
class Wired:
    """One life, and what it says."""

    core: Core
    folder: Path
    reader: PageReader
    ear: socket.socket
    heard: list[Words] = field(default_factory=list)

    @property
    def pid(self) -> int:
        return self.core.process.pid

    def hears(self, name: str, within_s: float = WAIT_S) -> Words:
        """Wait until it says something that has this name in it, and return all that came with it."""

        def look() -> Words | None:
            self._listen()
            return next((words for words in self.heard if name in words), None)

        try:
            found = until(look, f"{name} to be said", within_s)
        except AssertionError as error:
            raise AssertionError(f"{error}; heard {self.heard}, {self.core.said()}") from None
        assert found is not None
        return found

    def has_said(self, name: str) -> bool:
        self._listen()
        return any(name in words for words in self.heard)

    def _listen(self) -> None:
        while True:
            try:
                told = self.ear.recv(DATAGRAM_BYTES).decode()
            except BlockingIOError:
                return
            self.heard.append(dict(line.split("=", 1) for line in told.splitlines()))

    def order(self, **said: object) -> dict[str, Any]:
        """Give an order and return the answer."""
        with closing(socket.socket(socket.AF_UNIX)) as door:
            door.settimeout(WAIT_S)
            door.connect(str(self.folder / "control"))
            door.sendall(json.dumps({"generation": 1, **said}).encode() + b"\n")
            answer: dict[str, Any] = json.loads(door.makefile("rb").readline())
        return answer

    def promote(
        self, expected: int | None, *witnesses: str, busy_ms: int | None = None, generation: int = 1
    ) -> dict[str, Any]:
        return self.order(
            verb="promote",
            expected_epoch=expected,
            witnesses=list(witnesses),
            busy_ms=busy_ms,
            generation=generation,
        )

    def drain(self, within_ms: int = 10_000) -> dict[str, Any]:
        return self.order(verb="drain", within_ms=within_ms)

    def page(self) -> Page:
        page = self.reader.read()
        assert isinstance(page, Page), page
        return page

    def state(self) -> LifeState:
        return self.page().beats.state

    def events(self) -> list[str]:
        return [event.code for event in self.page().events]

    def witness(self) -> str:
        seen = self.page().witness
        assert seen is not None
        return f"{seen.seq}:{seen.epoch}:{seen.hash}"

    def oom_score(self) -> int:
        return int(Path(f"/proc/{self.pid}/oom_score_adj").read_text())


class Guard:
    """Starts lives over one data folder; all of them are gone when it ends."""

    def __init__(self, folder: Path, ending: ExitStack) -> None:
        self.data = folder / "data"
        self._folder = folder
        self._ending = ending
        self._lives = 0

    def start(self, **environ: Any) -> Wired:
        self._lives += 1
        folder = self._folder / f"life-{self._lives}"
        folder.mkdir()
        nonce = f"nonce-{self._lives}"
        make_page(folder / "page", nonce, "boot")
        ear = self._ending.enter_context(closing(_ear(folder / "notify")))
        wires: dict[str, Any] = {
            "HARDCORE_RECORDER": str(folder / "page"),
            "HARDCORE_CONTROL": str(folder / "control"),
            "NOTIFY_SOCKET": str(folder / "notify"),
        }
        core = self._ending.enter_context(started(self.data, sock=folder / "sock", **wires, **environ))
        reader = self._ending.enter_context(closing(PageReader(folder / "page", nonce)))
        return Wired(core, folder, reader, ear)

    def core(self, **environ: str) -> Wired:
        """Start a core and wait until it serves."""
        made = self.start(**environ)
        made.hears("READY")
        made.order(verb="quarantine")  # as a guard does when it lets people in: nobody is suspect
        return made

    def spare(self, **environ: str) -> Wired:
        """Start a spare and wait until it can be promoted."""
        made = self.start(HARDCORE_SPARE="1", **environ)
        made.hears("X_SPARE", SPARE_S)
        return made

    def epoch(self) -> int:
        """The store's own epoch."""
        return stores.epoch(self.data)


def _ear(path: Path) -> socket.socket:
    ear = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
    ear.bind(str(path))
    return ear


@contextmanager
def guarding(folder: Path) -> Iterator[Guard]:
    with ExitStack() as ending:
        yield Guard(folder, ending)
