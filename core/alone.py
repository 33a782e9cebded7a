"""Work on a thread of its own, which can be left behind: who waits for it may stop waiting, and the process may end.

A pool's thread that never comes back takes one of the pool's places for ever, and is waited for when the process
leaves. What a component does in a thread may hang for reasons that nobody can end from outside (a disk, a file of a
stranger), so each piece has a daemon thread for itself, and one that comes back waits a moment for the next piece: whoever
starts a thread waits until it runs, which beside a busy writer held up the loop for ten milliseconds. Not chosen: to end
such a thread by an exception from outside; it would strike in the middle of anything.
"""

import asyncio
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from queue import Empty, SimpleQueue
from typing import Any, ClassVar, Final, TypeVar

from core.guarded.components import ComponentBeat

T = TypeVar("T")

_STALL_S: Final = 86_400.0  # longer than anybody's patience with a component
_IDLE_S: Final = 1.0  # that a thread without work waits for some


async def alone(work: Callable[[], T], name: str) -> T:
    """Do `work` on a thread that nobody else has and return what it returns; raises what it raises.

    Whoever is cancelled meanwhile leaves it behind: it goes on, and what comes of it is lost.
    """
    loop = asyncio.get_running_loop()
    done: asyncio.Future[T] = loop.create_future()

    def run() -> None:
        try:
            outcome = work()
        except BaseException as error:  # noqa: BLE001  the one who waits has to hear of it, whatever it is
            _tell(loop, done, partial(done.set_exception, error))
        else:
            _tell(loop, done, partial(done.set_result, outcome))

    _Hand.free(name).take(run)
    return await done


class _Hand:
    """A thread that does one piece of work after another. One that hangs in a piece is never free again."""

    _idle: ClassVar[dict[str, list["_Hand"]]] = {}

    def __init__(self, name: str) -> None:
        self._free = self._idle.setdefault(name, [])
        self._given: SimpleQueue[Callable[[], None]] = SimpleQueue()
        threading.Thread(target=self._run, name=name, daemon=True).start()

    @classmethod
    def free(cls, name: str) -> "_Hand":
        """Return one of this name that has no work."""
        try:
            return cls._idle[name].pop()
        except LookupError:
            return cls(name)

    def take(self, work: Callable[[], None]) -> None:
        """Do a piece; whoever gives it has it from `free`."""
        self._given.put(work)

    def _run(self) -> None:
        while True:
            try:
                work = self._given.get(timeout=_IDLE_S)
            except Empty:
                # Who takes a hand and who lets it go take it out of the same list: only one of them finds it there.
                with suppress(ValueError):
                    self._free.remove(self)
                    return
                continue
            work()
            self._free.append(self)


def _tell(loop: asyncio.AbstractEventLoop, done: "asyncio.Future[T]", say: Callable[[], None]) -> None:
    def say_if_waited_for() -> None:
        if not done.done():
            say()

    with suppress(RuntimeError):  # the loop is closed: the process is leaving, and nobody waits
        loop.call_soon_threadsafe(say_if_waited_for)


class LeftBehindError(Exception):
    """This piece of work was given up by those who waited: another one does it, and this one may do nothing more."""


class Turns:
    """One component's pieces of work, one after the other, each on a thread of its own that can be left behind.

    `begin_anew` leaves the piece that is at work behind and does it again from its beginning, so whoever waits for it
    waits on and notices nothing. A piece must therefore be a question and change nothing. All on the loop's thread,
    but `go_on`.
    """

    def __init__(self, name: str, beats: ComponentBeat) -> None:
        """Prepare. `beats` says that a piece is at work, and gets on."""
        self._name = name
        self._beats = beats
        self._turn = asyncio.Lock()
        self._number = 0
        self._given_up: asyncio.Future[None] | None = None
        self._at_work: asyncio.Task[Any] | None = None
        self._stalls = False

    @property
    def is_busy(self) -> bool:
        """Whether a piece is at work."""
        return self._turn.locked()

    async def do(self, work: Callable[[Callable[[], None]], T]) -> T:
        """Do a piece when its turn has come, and return what came of it.

        `work` is given `go_on`, to be called between its steps: it beats, and raises LeftBehindError in a piece that was
        left behind.
        """
        async with self._turn:
            while True:
                task = asyncio.create_task(alone(self._piece(work), self._name), name=self._name)
                self._at_work = task
                self._given_up = asyncio.get_running_loop().create_future()
                self._beats.works(True)
                try:
                    either: set[asyncio.Future[Any]] = {task, self._given_up}
                    await asyncio.wait(either, return_when=asyncio.FIRST_COMPLETED)
                    if task.done():
                        return task.result()
                finally:
                    if task.done():
                        self._beats.done()
                    self._beats.works(False)

    def _piece(self, work: Callable[[Callable[[], None]], T]) -> Callable[[], T]:
        number = self._number

        def go_on() -> None:
            if self._stalls and number == self._number:
                self._stalls = False
                time.sleep(_STALL_S)
            if number != self._number:
                raise LeftBehindError
            self._beats.beat()

        def piece() -> T:
            go_on()
            return work(go_on)

        return piece

    def begin_anew(self) -> None:
        """Leave what is at work behind, and do it again for whoever waits."""
        self._number += 1
        self._stalls = False
        if self._at_work is not None:
            self._at_work.add_done_callback(_heard)
            self._at_work = None
        if self._given_up is not None and not self._given_up.done():
            self._given_up.set_result(None)

    def stall(self) -> None:
        """Have the piece at work, or the next one, come to no end: a drill."""
        self._stalls = True

    async def end(self) -> None:
        """Wait for the piece at work, but for none that was left behind."""
        if self._at_work is not None:
            await asyncio.wait({self._at_work})


def _heard(task: "asyncio.Task[Any]") -> None:
    if not task.cancelled():
        task.exception()  # nobody waits for it any more, and nobody is told of it
