"""What waits on the event loop: its suspended tasks, each with the place where it waits and whom it is about.

A suspended task has no thread, so no reader of stacks ever sees it; but while tasks are only suspended the
loop runs, and it can be asked. Each task is followed along what it awaits down to the innermost frame, and the
plain strings `transaction_id` and `account_id` of the frames on the way are told, and nothing else of them: a
frame's other locals are somebody's money. Cost and answer are bounded, because the one who asks is in a hurry.
Not chosen: `Task.get_stack`, which knows the outermost frame only.
"""

import asyncio
import json
from collections.abc import Iterable
from types import CoroutineType, FrameType, GeneratorType
from typing import Any, Final

from core.guarded.last_words import short_path

LOOKED_AT_MAX: Final = 1_000
TOLD_BYTES_MAX: Final = 64 << 10
#: Awaits followed in one task: deeper than anything here, and the end of a chain that bites its tail.
DEPTH_MAX: Final = 100
ID_CHARACTERS_MAX: Final = 240
NAME_CHARACTERS_MAX: Final = 100
_NAMES: Final = ("transaction_id", "account_id")
_ENVELOPE_BYTES: Final = 64  # room for the answer around the list

TaskNote = dict[str, str]


def suspended_tasks() -> tuple[list[TaskNote], int]:
    """Return what can be told of the running loop's suspended tasks, and how many there are.

    Those that name a transaction or an account come first: where not all can be told, these are. Call it on the
    loop's thread; the task that calls is not suspended and not told.
    """
    others = asyncio.all_tasks() - {asyncio.current_task()}
    notes = [note_of(task) for task, _ in zip(others, range(LOOKED_AT_MAX), strict=False)]
    notes.sort(key=lambda note: not (note["transaction_id"] or note["account_id"]))
    return list(_fitting(notes)), len(others)


def note_of(task: "asyncio.Task[Any]") -> TaskNote:
    """Return where a task waits and what it names."""
    note = {
        "name": task.get_name()[:NAME_CHARACTERS_MAX],
        "waits_at": "",
        "transaction_id": "",
        "account_id": "",
    }
    frame = None
    for frame in _frames(task.get_coro()):
        for name in _NAMES:
            # Asked for first: to make the locals of a frame that has none of them costs more than all the rest.
            value = frame.f_locals.get(name) if name in frame.f_code.co_varnames else None
            # The innermost frame has the last word; one that knows no name does not take another's away.
            if type(value) is str and value:
                note[name] = value[:ID_CHARACTERS_MAX]
    if frame is not None:
        note["waits_at"] = f"{short_path(frame.f_code.co_filename)}:{frame.f_lineno} {frame.f_code.co_name}"
    return note


def _frames(awaited: object) -> Iterable[FrameType]:
    """Give the frames along what is awaited, from the outside in.

    Of coroutines and generators; an async generator in between hides what it waits for.
    """
    for _ in range(DEPTH_MAX):
        if isinstance(awaited, CoroutineType):
            frame, awaited = awaited.cr_frame, awaited.cr_await
        elif isinstance(awaited, GeneratorType):
            frame, awaited = awaited.gi_frame, awaited.gi_yieldfrom
        else:
            return
        if frame is not None:  # none: it has ended meanwhile
            yield frame


def _fitting(notes: Iterable[TaskNote]) -> Iterable[TaskNote]:
    room_bytes = TOLD_BYTES_MAX - _ENVELOPE_BYTES
    for note in notes:
        room_bytes -= len(json.dumps(note)) + 2  # and a comma with its space
        if room_bytes < 0:
            return
        yield note
