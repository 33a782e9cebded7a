"""A job: one committed import as the importer has it in its hands, from its first row to its end.

State and nothing else; who changes it is the importer. It may be made anew at any time from what is on the disk, and is,
after a death and for a shift that takes over.
"""

from collections import deque
from collections.abc import Callable, Iterator
from typing import Final

import msgspec

from core import frames
from core.guarded.poison import name_of
from core.hub import Frame
from core.imports import judging, waves
from core.imports.folder import ImportFolder
from core.imports.reading.candidates import Result
from core.imports.records import Manifest, Progress
from core.imports.states import State, Trigger, Waiting, after
from core.imports.suspected import HeldRow

TELL_ROWS_MAX: Final = 1_024  # are booked between two notes of how far it is
#: So many rows may have been at work when a core died, and its successor books them one by one, each with its own name.
ONE_BY_ONE_ROWS: Final = TELL_ROWS_MAX + 4 * waves.ROWS_MAX


def _no_rows() -> Iterator[Result]:
    return iter(())


class Job(msgspec.Struct):
    """One committed import. `rows` are all of its rows, parsed as they are needed; `parsed` of them are.

    Those before `progress.done` are settled and only parsed: which of several identical rows one is depends on
    the rows before it. `end` is the state it has come to, while that is not on the disk yet. `waits_for`: the name
    of its next row, while that one waits for its trial; `filed`: whose cases are; `file_again_ns`: when they are filed,
    or said, once more. `waiting`: why it does not go on, as its pages were told last. `rows_anew` gives all rows once
    more. `shift`: whose work it is. `next` is the wave that was prepared while one before it was written; up to the row
    `one_by_one` each goes by itself.
    """

    folder: ImportFolder
    manifest: Manifest
    total: int
    rows: Iterator[Result]
    progress: Progress
    parsed: int = 0
    ahead: deque[Result] = msgspec.field(default_factory=deque)
    next: waves.Wave | None = None
    one_by_one: int = 0
    told_ns: int = 0
    told_rows: int = 0
    end: State | None = None
    end_again_ns: int = 0
    waits_for: str = ""
    filed: set[str] = set()
    file_again_ns: int = 0
    waiting: Waiting | None = None
    rows_anew: Callable[[], Iterator[Result]] = _no_rows
    shift: int = 0


class RowsLostError(Exception):
    """The kept rows end early or are torn."""


def anew(job: Job, shift: int) -> Job:
    """Return a job of its own for another shift, at the last row that was settled."""
    made = Job(job.folder, job.manifest, job.total, job.rows_anew(), job.progress)
    made.one_by_one = job.progress.done + ONE_BY_ONE_ROWS
    made.end, made.waiting, made.rows_anew, made.shift = job.end, job.waiting, job.rows_anew, shift
    return made


def ended(job: Job) -> State | None:
    """Return the state of an import that has no rows left."""
    if job.progress.done != job.total:
        raise RowsLostError
    return after(State.COMMITTING, Trigger.LAST_ROW)


def broken(folder: ImportFolder, manifest: Manifest, progress: Progress, fault: str) -> Job:
    """Return an import that can't be gone on with; the importer writes its end down."""
    job = Job(folder, manifest, progress.done, iter(()), progress)
    break_off(job, fault)
    return job


def break_off(job: Job, fault: str) -> None:
    """Have an import end as one that failed, because of this."""
    job.manifest = msgspec.structs.replace(job.manifest, fault=fault)
    job.end = after(State.COMMITTING, Trigger.BROKE)


def frame_of(job: Job) -> Frame:
    """Return what an open page is told of an import."""
    wish, now = job.manifest, job.progress
    return frames.progress(
        wish.id, wish.state.value, now.done, job.total, now.duplicates, now.refused, job.waiting
    )


def row_held(job: Job, ordinal: int) -> HeldRow:
    """Return a row of an import as one that waits for its trial."""
    key = judging.key_of(job.manifest, ordinal)
    return HeldRow(name_of(key), key, job.manifest.id, ordinal)
