"""The witness of the processor: what was burned in a silence, who queues for the interpreter, who is not let.

Time is counted as the kernel counts it, in processor time, and not by the wall: a computation of half a
second takes ten on a machine where twenty others compute, and is as healthy there. So a hang that computes has
lasted once it has *burned* its limit; time in which a thread was ready and not scheduled counts for nothing.
A silence ends with a beat or with anything completed, and so does what was burned in it.

Whoever waits for the interpreter sleeps on a lock and wakes up every 5 ms to ask for it: nothing else in a core
looks like that, which tells "the one that has it is asleep" from a core that waits for work.
"""

import msgspec

from hardcore.model.looks import ProcessSample, ThreadSample
from hardcore.model.recorder import Beats
from hardcore.model.verdicts import Colour, Testimony
from hardcore.sentinel.lasting import NS_PER_MS, Lasting
from hardcore.sentinel.seen_time import SeenTime

#: A thread with less than this share of a processor only wakes up to look.
DOZING_PERCENT = 5
#: The whole process, with all that wake up in it; its time is told in steps of 10 ms.
IDLE_PERCENT = 10
IDLE_STEP_NS = 10 * NS_PER_MS
#: Wake-ups in a second of a thread that waits for the interpreter: 200 when it is let, a third of it where twenty others
#: compute. A healthy beat has 40, and beats.
ASKING_PER_S = 50
#: A thread that was ready for this share of the time and got next to nothing is not scheduled.
UNSCHEDULED_PERCENT = 80


class ProcessorFacts(msgspec.Struct, frozen=True):
    """All in ns. `loop_*`: burned by the loop's thread since its last beat; `held_*`: by the process since any beat.

    `_burned_ns` leaves collections of memory out, `_all_ns` has everything. `queued_ns`: how long the loop has
    slept on a lock, waking up at most to ask. `idle_ns`: how long everybody has waited for an interpreter whose
    holder had no processor time; `idle_known`: every thread was looked at, or the holder is the loop itself.
    `starved_ns`: how long the loop's thread has been ready and was not let.
    """

    loop_burned_ns: int = 0
    loop_all_ns: int = 0
    held_burned_ns: int = 0
    held_all_ns: int = 0
    queued_ns: int = 0
    idle_ns: int = 0
    idle_known: bool = False
    starved_ns: int = 0


class Processor(msgspec.Struct):
    """Remembers the last look, and what was burned since the last sign of life."""

    _last: ProcessSample | None = None
    _last_ns: int = 0
    _beats: Beats = msgspec.field(default_factory=Beats)
    _loop_moved: bool = False
    _any_moved: bool = False
    _loop_burned_ns: int = 0
    _loop_all_ns: int = 0
    _held_burned_ns: int = 0
    _held_all_ns: int = 0
    _queued: Lasting = msgspec.field(default_factory=Lasting)
    _idle: Lasting = msgspec.field(default_factory=Lasting)
    _idle_spent_ns: int = 0
    _starved: Lasting = msgspec.field(default_factory=Lasting)

    def look(
        self, beats: Beats, sample: ProcessSample, seen: SeenTime, *, collecting: bool
    ) -> ProcessorFacts:
        """Take in one look. `collecting`: a collection of memory ran in the interval that ends here."""
        last = self._last if self._last_ns == seen.before_ns else None
        self._last, self._last_ns = sample, seen.at_ns
        self._begin_anew(beats, amnesty=seen.begins_anew)
        if last is None:
            return ProcessorFacts()
        span = Span(last, sample, seen.at_ns - seen.before_ns, seen.gap_ns)
        self._charge(span, collecting=collecting)
        queued_ns = self._queued.look(_dozes(span, last.loop, sample.loop), seen)
        starved = _starves(span, last.loop, sample.loop)
        return ProcessorFacts(
            loop_burned_ns=self._loop_burned_ns,
            loop_all_ns=self._loop_all_ns,
            held_burned_ns=self._held_burned_ns,
            held_all_ns=self._held_all_ns,
            queued_ns=queued_ns,
            idle_ns=self._idles(span, seen),
            idle_known=sample.busy is not None or _holds_asleep(last.loop, sample.loop),
            starved_ns=self._starved.look(starved, seen),
        )

    def _begin_anew(self, beats: Beats, *, amnesty: bool) -> None:
        """Forget what was burned before a sign of life; what is completed is one, whatever the beats say."""
        last, self._beats = self._beats, beats
        moved = amnesty or beats.completed != last.completed
        self._loop_moved = moved or beats.loop_ns != last.loop_ns
        self._any_moved = self._loop_moved or beats.thread_ns != last.thread_ns
        if self._loop_moved:
            self._loop_burned_ns = self._loop_all_ns = 0
        if self._any_moved:
            self._held_burned_ns = self._held_all_ns = 0
            self._idle.since_ns = 0

    def _charge(self, span: "Span", *, collecting: bool) -> None:
        """Add what this interval burned; one in which there was a sign of life does not belong to a silence."""
        loop_ns = 0 if self._loop_moved else min(_burned(span.last.loop, span.now.loop), span.seen_ns)
        process_ns = 0 if self._any_moved else min(max(0, span.now.cpu_ns - span.last.cpu_ns), span.seen_ns)
        self._loop_all_ns += loop_ns
        self._held_all_ns += process_ns
        if not collecting:
            self._loop_burned_ns += loop_ns
            self._held_burned_ns += process_ns

    def _idles(self, span: "Span", seen: SeenTime) -> int:
        """Return for how long all have waited for an interpreter that nobody uses."""
        last, now = span.last, span.now
        waits = (
            not now.busy
            and _asks(span, last.beat, now.beat)
            and (_asks(span, last.loop, now.loop) or _sleeps(last.loop, now.loop))
        )
        if not self._idle.since_ns:
            self._idle_spent_ns = 0
        self._idle_spent_ns += max(0, now.cpu_ns - last.cpu_ns)
        for_ns = self._idle.look(waits, seen)
        if self._idle_spent_ns > IDLE_STEP_NS + for_ns * IDLE_PERCENT // 100:
            self._idle.since_ns = 0
            return 0
        return for_ns


class Span(msgspec.Struct, frozen=True):
    """Two looks in a row at one process, the time between them, and how much of it we have seen (ns).

    A machine that was away may have charged that to whoever ran last, or let nobody run: what has burned much, or
    little, is told by the time that was seen; how often something happened, by all of it.
    """

    last: ProcessSample
    now: ProcessSample
    for_ns: int
    seen_ns: int


def _burned(last: ThreadSample | None, now: ThreadSample | None) -> int:
    return max(0, now.cpu_ns - last.cpu_ns) if last and now else 0


def _dozes(span: Span, last: ThreadSample | None, now: ThreadSample | None) -> bool:
    """Whether the thread sleeps on a lock in both looks and has hardly had any processor time between them."""
    return (
        last is not None
        and now is not None
        and last.state == now.state == "S"
        and "futex" in last.waits_in
        and "futex" in now.waits_in
        and _burned(last, now) * 100 <= span.seen_ns * DOZING_PERCENT
    )


def _asks(span: Span, last: ThreadSample | None, now: ThreadSample | None) -> bool:
    """Whether the thread waits for the interpreter: it dozes, and wakes up again and again."""
    if last is None or now is None or not _dozes(span, last, now):
        return False
    return (now.switches - last.switches) * 1_000_000_000 >= ASKING_PER_S * span.for_ns


def _sleeps(last: ThreadSample | None, now: ThreadSample | None) -> bool:
    """Whether the thread sleeps in one place, without any processor time."""
    return (
        last is not None
        and now is not None
        and last.state == now.state == "S"
        and last.cpu_ns == now.cpu_ns
        and last.waits_in == now.waits_in
    )


def _holds_asleep(last: ThreadSample | None, now: ThreadSample | None) -> bool:
    """Whether it is the thread itself that has the interpreter: it sleeps, and not as one that waits for a lock."""
    return now is not None and _sleeps(last, now) and now.waits_in != "" and "futex" not in now.waits_in


def _starves(span: Span, last: ThreadSample | None, now: ThreadSample | None) -> bool:
    """Whether the thread was ready all the time and hardly let."""
    if last is None or now is None or _burned(last, now) * 100 > span.for_ns * (100 - UNSCHEDULED_PERCENT):
        return False
    delayed = (now.run_delay_ns - last.run_delay_ns) * 100 >= span.for_ns * UNSCHEDULED_PERCENT
    return delayed or last.state == now.state == "R"


def testify(facts: ProcessorFacts, limit_ms: int) -> Testimony | None:
    """Return what the processor tells about the loop's silence; None while that is nothing to tell."""
    if facts.starved_ns >= limit_ms * NS_PER_MS:
        why = f"the loop's thread has been ready for {facts.starved_ns // NS_PER_MS} ms and was not scheduled"
        return Testimony("processor", Colour.GREEN, why)
    if facts.loop_all_ns >= limit_ms * NS_PER_MS:
        why = f"the loop's thread has burned {facts.loop_all_ns // NS_PER_MS} ms of processor time in this silence"
        return Testimony("processor", Colour.YELLOW, why)
    return None
