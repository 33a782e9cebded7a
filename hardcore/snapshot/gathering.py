"""The thread that goes through the steps of a recipe: one collector after another, each until its own moment.

What one collector leaves for a later one (the threads that were seen before the stop, the debugger that reads
while others write) stands in the `Gathering`, and what was had in the `Haul`, which the loop may store at any
moment. A bug in one collector costs its own piece; a collector that hangs in the kernel costs what would have
come after it, and the debugger that was begun is ended by whoever waits (`abandon`).
"""

import time
from collections.abc import Sequence
from typing import assert_never

import msgspec

from hardcore.model.looks import ProcessSample
from hardcore.snapshot import children, collectors, holders, memory, printed, stacks, tasks, threads
from hardcore.snapshot.recipe import Piece, Step
from hardcore.snapshot.subject import Haul, Subject, Tools


class Gathering(msgspec.Struct):
    """One evidence while it is being taken. `sample`: the watch's last look at a process that is gone."""

    subject: Subject
    tools: Tools
    haul: Haul
    sample: ProcessSample | None = None
    table: holders.Table | None = None
    rollup: memory.Rollup | None = None
    seen: list[threads.ThreadFacts] = msgspec.field(default_factory=list)
    printed_after_bytes: int | None = None
    debugger: children.Child | str | None = None


def prepare(steps: Sequence[Step], work: Gathering) -> None:
    """Name every piece as pending, so that what the end of the budget cuts off is named by itself."""
    work.haul.pending.update({str(step.piece): "the budget was over" for step in steps})
    if work.subject.first_stacks:
        work.haul.files["stacks-first.json"] = work.subject.first_stacks


def gather(steps: Sequence[Step], work: Gathering) -> None:
    """Go through the steps. Blocks, at most until the last step's moment if no collector hangs."""
    haul = work.haul
    work.table = holders.begin_table()  # the slowest on a busy machine, and good at any moment
    try:
        for step in steps:
            begun_ns = time.monotonic_ns()
            if begun_ns > steps[-1].until_ns:
                return
            haul.pending[step.piece] = "it was still being collected when the budget was over"
            try:
                _gather_one(step, work, step.deadline_ns(begun_ns, steps[-1].until_ns))
            except Exception as error:  # noqa: BLE001  a bug in one collector must not cost the others' evidence
                haul.missing[step.piece] = f"a fault in the collector: {type(error).__name__}: {error}"
            haul.costs_us[step.piece] = (time.monotonic_ns() - begun_ns) // 1_000
            del haul.pending[step.piece]
    finally:
        if not isinstance(work.debugger, str | None):
            children.end(work.debugger)


def abandon(work: Gathering) -> None:
    """End what a gathering that hangs has begun. Does not wait."""
    if not isinstance(work.debugger, str | None):
        children.kill(work.debugger)


def _gather_one(step: Step, work: Gathering, until_ns: int) -> None:
    subject, haul = work.subject, work.haul
    match step.piece:
        case Piece.THREADS:
            threads.collect_threads(subject, haul, work.seen, until_ns)
        case Piece.ASK:
            work.printed_after_bytes = printed.ask(subject, haul)
        case Piece.TASKS:
            tasks.collect_tasks(subject, haul, min(until_ns, step.patience_ns(time.monotonic_ns())))
        case Piece.TRACEBACK:
            if work.printed_after_bytes is not None:
                printed.pick_up(subject, haul, work.printed_after_bytes, until_ns)
        case Piece.STOP:
            threads.stop(subject, haul, until_ns)
        case Piece.DEBUGGER:
            work.debugger = stacks.begin(subject.pid, work.tools)
            work.rollup = memory.begin_rollup(subject.pid)
        case Piece.RECORDER:
            collectors.collect_recorder(subject, haul)
        case Piece.PROCESS:
            collectors.collect_process(subject, haul, work.seen)
        case Piece.SAMPLE:
            collectors.collect_sample(subject, haul, work.sample)
        case Piece.LOG:
            collectors.collect_log(subject, haul, until_ns)
        case Piece.LOCKS:
            assert work.table is not None, "begun before the first step"
            holders.collect_locks(
                subject, haul, work.table, min(until_ns, step.patience_ns(time.monotonic_ns()))
            )
        case Piece.MEMORY:
            memory.collect_memory(
                subject, haul, work.rollup, min(until_ns, step.patience_ns(time.monotonic_ns()))
            )
        case Piece.STACKS:
            stacks.collect_stacks(haul, subject.pid, work.tools, work.debugger, until_ns)
        case Piece.LAST_TRACEBACK:
            printed.keep_last(subject, haul)
        case _:
            assert_never(step.piece)
