"""Watching one throw-away core: an answer, a death, too long, too much, whichever comes first.

Seen from outside and from one thread: the kernel tells the death, a short tick counts the time and looks at the memory. A
core that does not answer in its time is asked for its stacks before it is ended. And it is asked whether it could have
answered at all: on a machine that gives it no processor, before a disk that does not come back, or stopped by somebody,
whoever is slow is not guilty. For the same reason a tick that comes late counts as a short one.
"""

import json
import os
import select
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from enum import Enum
from pathlib import Path
from typing import Any, Final, TypeVar

import msgspec

from core.trying.asking import Exchange, Lost, Reply
from core.trying.forking import Forked
from core.trying.stacks import TEXT_CHARACTERS_MAX, frame_of

TICK_MS: Final = 20
TICK_COUNTED_MS_MAX: Final = 5 * TICK_MS  # of a tick in which we ourselves were not let run
WORD_BYTES_MAX: Final = 256 << 10
WORDS_MAX: Final = 256  # kept of what was not asked for yet
GROWN_BYTES_MIN: Final = 32 << 20  # less than that is no growth: the bound was too near
STACKS_MS_MAX: Final = 500
DEATH_MS_MAX: Final = 2_000  # between a connection that broke and the death that may have broken it
_CPU_ENOUGH_NS: Final = 500_000_000  # of a processor: fifty times what a command takes
FINGERPRINT: Final = "fingerprint"  # what a word about a command has
_READ_BYTES: Final = 64 << 10
_NS_PER_MS: Final = 1_000_000
_PAGE_BYTES: Final = os.sysconf("SC_PAGE_SIZE")

T = TypeVar("T")
Word = dict[str, Any]


class How(Enum):
    """In what way a core was at its end."""

    DIED = "its process ended"
    HUNG = "it did not answer"
    GREW = "its memory passed the bound"
    SLOW = "it could not have answered, in its time or within its memory"


class Ending(msgspec.Struct, frozen=True):
    """How a core ended. `code` or `signal`: of a death that was not ours. `why`: what slowed it."""

    how: How
    code: int | None = None
    signal: int | None = None
    frame: str = ""
    why: str = ""


class Work(msgspec.Struct, frozen=True):
    """What the kernel knows of a process's threads: how long they ran and waited for a processor; their states."""

    ran_ns: int
    waited_ns: int
    states: frozenset[str]


class Ward:
    """One throw-away core, from its fork to its end.

    `told`: the last that it said of the command of the last request. `tried`: how many cases it has been given.
    """

    def __init__(self, forked: Forked, stacks: Path, memory_bytes: int) -> None:
        """Watch a child; nothing is waited for yet. `memory_bytes`: how much may be resident."""
        self._forked = forked
        self._stacks = stacks
        self._memory_bytes = memory_bytes
        self._said = bytearray()
        self._words: list[Word] = []
        self._mute = False
        self._over = False
        self.tried = 0
        self.told: Word = {}

    def word(self, limit_ms: int) -> Word | Ending:
        """Wait for its next word."""
        return self._until(limit_ms, lambda: self._words.pop(0) if self._words else None)

    def reply(self, address: str, sent: bytes, limit_ms: int) -> Reply | Lost | Ending:
        """Send it a request and wait for the answer. Lost: the connection broke, and it lives on."""
        self.told = {}
        self._words.clear()
        try:
            exchange = Exchange(address, sent)
        except OSError:
            return self._death() if self._is_dead(DEATH_MS_MAX) else Lost()
        try:
            found: Reply | Lost | Ending = self._until(limit_ms, exchange.step, exchange)
        finally:
            exchange.close()
        self._hear()  # it spoke before it answered, and perhaps after we had last listened
        self.told = next((word for word in reversed(self._words) if FINGERPRINT in word), {})
        if isinstance(found, Ending):
            return found
        # Whoever has answered and is gone at once has died of it as well.
        return self._death() if self._is_dead(DEATH_MS_MAX if isinstance(found, Lost) else 0) else found

    def end(self) -> None:
        """End it with all that it has started, and forget it."""
        if not self._over:
            self._reap()

    def _until(
        self, limit_ms: int, done: Callable[[], T | None], exchange: Exchange | None = None
    ) -> T | Ending:
        """Wait until `done` gives something; or return how the core came to its end, at which it then is."""
        before, began_bytes = work_of(self._forked.pid), resident_bytes(self._forked.pid)
        spent_ns, seen_ns = 0, time.monotonic_ns()
        while True:
            dead = self._is_dead(0)  # asked first: what it said before that is heard below
            self._hear()
            if (found := done()) is not None:
                return found
            if dead:
                return self._death()
            if (has_bytes := resident_bytes(self._forked.pid)) > self._memory_bytes:
                return self._stopped(self._too_much(has_bytes - began_bytes))
            if spent_ns >= limit_ms * _NS_PER_MS:
                why = slowed(spent_ns, before, work_of(self._forked.pid))
                return self._stopped(Ending(How.SLOW, why=why) if why else Ending(How.HUNG))
            self._rest(exchange)
            now_ns = time.monotonic_ns()
            spent_ns += min(now_ns - seen_ns, TICK_COUNTED_MS_MAX * _NS_PER_MS)
            seen_ns = now_ns

    def _too_much(self, grown_bytes: int) -> Ending:
        if grown_bytes >= GROWN_BYTES_MIN:
            return Ending(How.GREW)
        return Ending(How.SLOW, why=f"{self._memory_bytes} bytes of memory are what any core takes")

    def _rest(self, exchange: Exchange | None) -> None:
        poll = select.poll()
        poll.register(self._forked.death, select.POLLIN)
        if not self._mute:
            poll.register(self._forked.words, select.POLLIN)
        if exchange is not None:
            poll.register(exchange.socket, select.POLLOUT if exchange.is_sending else select.POLLIN)
        poll.poll(TICK_MS)

    def _hear(self) -> None:
        """Take in what it has said. A line that is too long, or none, is passed over."""
        try:
            while chunk := self._forked.words.recv(_READ_BYTES):
                self._said += chunk
                *lines, rest = bytes(self._said).split(b"\n")
                self._said = bytearray(rest[:WORD_BYTES_MAX])
                self._words.extend(word for line in lines if isinstance(word := _read(line), dict))
                del self._words[:-WORDS_MAX]
            self._mute = True
        except BlockingIOError:
            pass
        except OSError:
            self._mute = True

    def _is_dead(self, within_ms: int) -> bool:
        poll = select.poll()
        poll.register(self._forked.death, select.POLLIN)
        return bool(poll.poll(within_ms))

    def _stopped(self, ending: Ending) -> Ending:
        """Ask it for its stacks, end it, and return that with the frame."""
        with suppress(ProcessLookupError):
            os.kill(self._forked.pid, signal.SIGUSR1)
        until_ns = time.monotonic_ns() + STACKS_MS_MAX * _NS_PER_MS
        before = -1
        while time.monotonic_ns() < until_ns and not self._is_dead(TICK_MS):
            size_bytes = self._stacks.stat().st_size if self._stacks.exists() else 0
            if 0 < size_bytes == before:  # nothing came since the last look
                break
            before = size_bytes
        self._reap()
        return msgspec.structs.replace(ending, frame=frame_of(self._written(), hangs=True))

    def _death(self) -> Ending:
        status = self._reap()
        frame = frame_of(self._written(), hangs=False)
        if not os.WIFSIGNALED(status):
            return Ending(How.DIED, code=os.WEXITSTATUS(status), frame=frame)
        number = os.WTERMSIG(status)
        return Ending(How.HUNG if number == signal.SIGXCPU else How.DIED, signal=number, frame=frame)

    def _written(self) -> str:
        try:
            with self._stacks.open("rb") as file:
                return file.read(TEXT_CHARACTERS_MAX).decode("utf-8", "replace")
        except OSError:
            return ""

    def _reap(self) -> int:
        """End whatever is left of it and return the status of its death."""
        self._over = True
        for end in (os.killpg, os.kill):  # it may not lead a group yet
            with suppress(ProcessLookupError, PermissionError):
                end(self._forked.pid, signal.SIGKILL)
        _, status = os.waitpid(self._forked.pid, 0)
        os.close(self._forked.death)
        self._forked.words.close()
        return status


def slowed(spent_ns: int, before: Work, now: Work) -> str:
    """Return why a core that has not answered in `spent_ns` could not have; empty: it could."""
    if now.states & {"T", "t"}:
        return "it was stopped from outside"
    if "D" in now.states:
        return "the disk did not come back in its time"
    ran_ns, waited_ns = now.ran_ns - before.ran_ns, now.waited_ns - before.waited_ns
    if waited_ns > spent_ns // 2 and ran_ns < min(_CPU_ENOUGH_NS, spent_ns // 4):
        return "the machine gave it no processor in its time"
    return ""


def work_of(pid: int) -> Work:
    """Return what the kernel knows of a process's work; nothing where it is gone, or the kernel does not say."""
    ran_ns = waited_ns = 0
    states = set()
    with suppress(OSError, ValueError, IndexError):
        for task in os.scandir(f"/proc/{pid}/task"):
            ran, waited, _ = Path(task.path, "schedstat").read_text().split()
            ran_ns, waited_ns = ran_ns + int(ran), waited_ns + int(waited)
            states.add(Path(task.path, "stat").read_text().rpartition(")")[2].split()[0])
    return Work(ran_ns, waited_ns, frozenset(states))


def resident_bytes(pid: int) -> int:
    """Return how much memory a process has now; 0 where it is gone."""
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * _PAGE_BYTES
    except (OSError, ValueError, IndexError):
        return 0


def _read(line: bytes) -> object:
    try:
        return json.loads(line)
    except (ValueError, RecursionError):
        return None
