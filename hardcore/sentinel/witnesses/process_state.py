"""The witness of the process: what the kernel says it does.

Independent of everything the core writes about itself. Two looks in a row must agree before it says that
a thread sleeps: without any processor time between them, in the same kernel function. Stopped is the letter
T; a thread that is runnable and not scheduled (R) is the machine's fault and is never called asleep.
A process in which no thread at all gets processor time is quiet: what holds its interpreter is no computation.
It also says for how long: a stop of a moment at the end of a long computation is still one of a moment, and
must not be held against the core as if it had lasted as long as the silence of its beats.
"""

from enum import Enum

import msgspec

from hardcore.model.looks import ProcessSample, ThreadSample
from hardcore.model.verdicts import Colour, Testimony
from hardcore.sentinel.lasting import Lasting
from hardcore.sentinel.seen_time import SeenTime

#: Kernel functions in which a thread waits for a lock or a timer: nothing outside can end that soon.
_CONCLUSIVE = ("futex", "nanosleep")


class Sleep(Enum):
    """How a thread sleeps, as far as two looks can tell."""

    NOT = "not asleep"
    CONCLUSIVE = "asleep on a lock or a timer"
    OTHER = "asleep in a wait"
    GONE = "gone"


class ProcessState(msgspec.Struct):
    """Remembers the last look at one life, and since when each thing has been as it is."""

    _last: ProcessSample | None = None
    _last_ns: int = 0
    _stopped: Lasting = msgspec.field(default_factory=Lasting)
    _loop: Lasting = msgspec.field(default_factory=Lasting)
    _writer: Lasting = msgspec.field(default_factory=Lasting)
    _quiet: Lasting = msgspec.field(default_factory=Lasting)

    def look(self, sample: ProcessSample, seen: SeenTime) -> "ProcessFacts":
        """Take in one look and return what it and the one before agree on."""
        last = self._last if self._last_ns == seen.before_ns else None
        self._last, self._last_ns = sample, seen.at_ns
        stopped = last is not None and last.state == sample.state == "T"
        loop = _sleep(last.loop if last else None, sample.loop)
        writer = _sleep(last.writer if last else None, sample.writer)
        quiet = last is not None and _quiet(last, sample)
        return ProcessFacts(
            stopped=stopped,
            stopped_ns=self._stopped.look(stopped, seen),
            loop=loop,
            loop_ns=self._loop.look(loop is not Sleep.NOT, seen),
            loop_waits_in=sample.loop.waits_in if sample.loop else "",
            writer=writer,
            writer_ns=self._writer.look(writer is not Sleep.NOT, seen),
            quiet_ns=self._quiet.look(quiet, seen),
        )


class ProcessFacts(msgspec.Struct, frozen=True):
    """What two looks in a row agree on, and for how long (ns) all looks have."""

    stopped: bool
    stopped_ns: int
    loop: Sleep
    loop_ns: int
    loop_waits_in: str
    writer: Sleep
    writer_ns: int
    quiet_ns: int


def _quiet(before: ProcessSample, now: ProcessSample) -> bool:
    """Whether no thread ran: whoever waits for the interpreter wakes up for less than the process's time can tell."""
    threads = ((before.loop, now.loop), (before.writer, now.writer), (before.beat, now.beat))
    still = all(_turns(was) == _turns(is_) for was, is_ in threads)
    return still and before.state == now.state == "S" and before.cpu_ns == now.cpu_ns


def _turns(thread: ThreadSample | None) -> tuple[int, int] | None:
    return None if thread is None else (thread.cpu_ns, thread.switches)


def _sleep(before: ThreadSample | None, now: ThreadSample | None) -> Sleep:
    if before is None or now is None:
        return Sleep.NOT
    if now.state == "":
        return Sleep.GONE if before.state == "" else Sleep.NOT
    same = (
        before.state == now.state == "S" and before.cpu_ns == now.cpu_ns and before.waits_in == now.waits_in
    )
    if not same:
        return Sleep.NOT
    return Sleep.CONCLUSIVE if any(name in now.waits_in for name in _CONCLUSIVE) else Sleep.OTHER


def testify(facts: ProcessFacts, *, beating: bool) -> Testimony:
    """Return what the kernel says. `beating`: the loop's beats are fresh, so its sleep is a wait for work."""
    if facts.stopped:
        return Testimony("process", Colour.RED, "the process is stopped (state T), not by us")
    if facts.loop in {Sleep.CONCLUSIVE, Sleep.OTHER} and not beating:
        where = f" in {facts.loop_waits_in}" if facts.loop_waits_in else ""
        return Testimony(
            "process",
            Colour.RED,
            f"the loop's thread is {facts.loop.value}{where}, without processor time in two looks",
        )
    return Testimony("process", Colour.GREEN, "the process is running or waiting for work")
