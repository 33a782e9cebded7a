"""The witness of the transactions: which command is being decided for longer than it may?

The time runs from the moment a command was taken up, and anew from each progress it reports. Time in which its
thread was ready and not scheduled, or waited for a disk, or in which we ourselves slept, is no time of the
command's. What its thread did before it was first looked at can't be excused, so a command counts as over its time
only once it has been looked at for a while. Reads have limits of their own and are looked at in the same way.
"""

import msgspec

from hardcore.model.looks import ThreadSample
from hardcore.model.recorder import CommandNote, SlotStage
from hardcore.model.verdicts import Colour, Testimony
from hardcore.sentinel.lasting import NS_PER_MS
from hardcore.sentinel.seen_time import SeenTime


class Deciding(msgspec.Struct, frozen=True):
    """One command that is being decided.

    `counted_ns`: how long, without what is excused; `watched_ns`: how long we have been looking; `limit_ns` 0: it
    may take for ever. `sample`: its thread, if the kernel was asked about it.
    """

    note: CommandNote
    since_ns: int
    counted_ns: int
    watched_ns: int
    limit_ns: int
    sample: ThreadSample | None

    @property
    def overdue(self) -> bool:
        """Whether it has had all the time it may have."""
        return 0 < self.limit_ns <= self.counted_ns

    @property
    def in_lock(self) -> bool:
        """Whether its thread sleeps on a lock."""
        return self.sample is not None and self.sample.state == "S" and "futex" in self.sample.waits_in

    @property
    def in_disk(self) -> bool:
        """Whether its thread waits for a disk, where nothing can reach it."""
        return self.sample is not None and self.sample.state == "D"


class Run(msgspec.Struct):
    """What is remembered of one command between two looks."""

    since_ns: int
    first_ns: int
    last_ns: int
    excused_ns: int
    sample: ThreadSample | None


class Transactions(msgspec.Struct):
    """Remembers the commands that are being decided; as many as there are slots at most."""

    _runs: dict[str, Run] = msgspec.field(default_factory=dict)

    def look(
        self,
        in_flight: tuple[CommandNote, ...] | None,
        threads: tuple[tuple[int, ThreadSample], ...],
        limit_ms: int,
        seen: SeenTime,
    ) -> tuple[Deciding, ...]:
        """Take in one look. `limit_ms` is for those whose page names none; None in flight: nobody looked."""
        if in_flight is None:
            return ()
        by_thread = dict(threads)
        notes = [note for note in in_flight if note.stage is SlotStage.DECIDING and not note.torn]
        self._runs = {note.command_id: self._run(note, by_thread.get(note.thread), seen) for note in notes}
        return tuple(_told(note, self._runs[note.command_id], limit_ms, seen) for note in notes)

    def _run(self, note: CommandNote, sample: ThreadSample | None, seen: SeenTime) -> Run:
        since_ns = max(note.stage_ns, note.progress_ns)
        run = self._runs.get(note.command_id)
        if run is None or run.since_ns != since_ns:
            return Run(since_ns, seen.at_ns, seen.at_ns, 0, sample)
        excused_ns = run.excused_ns + _excused(run, sample, seen.since(run.last_ns))
        return Run(since_ns, run.first_ns, seen.at_ns, excused_ns, sample)


def _excused(run: Run, sample: ThreadSample | None, gap_ns: int) -> int:
    if sample is None or run.sample is None:
        return 0
    if "D" in {sample.state, run.sample.state}:
        return gap_ns
    return min(gap_ns, max(0, sample.run_delay_ns - run.sample.run_delay_ns))


def _told(note: CommandNote, run: Run, limit_ms: int, seen: SeenTime) -> Deciding:
    counted_ns = max(0, seen.since(run.since_ns) - run.excused_ns)
    limit_ns = note.limit_ns or limit_ms * NS_PER_MS
    return Deciding(note, run.since_ns, counted_ns, seen.since(run.first_ns), limit_ns, run.sample)


def testify(found: tuple[Deciding, ...]) -> Testimony | None:
    """Return what is over its time, or None if nothing is."""
    late = [one for one in found if one.overdue]
    if not late:
        return None
    worst = max(late, key=lambda one: one.counted_ns)
    name = worst.note.transaction_id or worst.note.command_id
    why = (
        f"{worst.note.kind} {name} has been decided for {worst.counted_ns // NS_PER_MS} ms; "
        f"it may take {worst.limit_ns // NS_PER_MS} ms"
    )
    return Testimony("transactions", Colour.YELLOW, why)
