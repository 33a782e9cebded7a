"""What a dying process still says: hooks for every way out that runs code, faulthandler for the rest.

Four ways lead out of Python with an exception, and only one of them ends the process: an exception in a
thread or in a callback of the loop leaves a core that lives on with a part of it missing. So the first
becomes the last words, the other two become events on the recorder. Fatal signals write the stacks of all
threads into a file that was opened in good time, and SIGUSR1 does the same on request, which works even
while C code holds the interpreter. Not chosen: `atexit`; it runs after the story is over.
"""

import asyncio
import faulthandler
import os
import signal
import sys
import threading
import traceback
from pathlib import Path
from types import TracebackType
from typing import Any

from core.guarded.recorder import FlightRecorder

_MESSAGE_CHARACTERS_MAX = 200
_FRAMES_MAX = 16


def keep_last_words(recorder: FlightRecorder, stacks: Path | None) -> None:
    """Install the hooks for the rest of this process's life; call it once, on the main thread.

    `stacks`: the file for faulthandler, made with mode 0600. Without one, or when it can't be opened, the
    stacks go to standard error.
    """
    _open_stacks(recorder, stacks)
    before, before_in_threads = sys.excepthook, threading.excepthook

    def on_way_out(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
        if not isinstance(error, KeyboardInterrupt):
            recorder.last_words("EXCEPTION", story(error))
        before(kind, error, trace)

    def in_thread(args: threading.ExceptHookArgs) -> None:
        # The thread is gone and the process lives on: an event, because nobody is leaving.
        if args.exc_value is not None and not isinstance(args.exc_value, SystemExit):
            recorder.event("THREAD_EXCEPTION", story(args.exc_value))
        before_in_threads(args)

    sys.excepthook = on_way_out
    threading.excepthook = in_thread


def keep_loop_errors(loop: asyncio.AbstractEventLoop, recorder: FlightRecorder) -> None:
    """Note what no task or callback of this loop has caught, then log it as the loop would."""

    def in_loop(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        error = context.get("exception")
        told = story(error) if isinstance(error, BaseException) else str(context.get("message", ""))
        recorder.event("LOOP_EXCEPTION", told)
        loop.default_exception_handler(context)

    loop.set_exception_handler(in_loop)


def story(error: BaseException) -> str:
    """Return an exception in one line: kind, where it happened from the inside out, message.

    The place comes before the message, because the ring of events has room for 64 bytes only.
    """
    frames = [(frame.f_code, line) for frame, line in traceback.walk_tb(error.__traceback__)]
    places = [f"{short_path(code.co_filename)}:{line} {code.co_name}" for code, line in reversed(frames)]
    message = str(error)[:_MESSAGE_CHARACTERS_MAX]
    first, rest = (places[:1] or ["nowhere"])[0], places[1:_FRAMES_MAX]
    called = f" (called from {', '.join(rest)})" if rest else ""
    return f"{type(error).__name__} at {first}: {message}{called}"


def short_path(path: str) -> str:
    """Return the last two parts of a file's path: enough to find it, nothing about the machine."""
    return "/".join(path.rsplit("/", 2)[-2:])


def _open_stacks(recorder: FlightRecorder, stacks: Path | None) -> None:
    fd = sys.stderr.fileno()
    if stacks is not None:
        flags = os.O_CREAT | os.O_WRONLY | os.O_APPEND | os.O_CLOEXEC | os.O_NOFOLLOW
        try:
            fd = os.open(stacks, flags, 0o600)
        except OSError as error:
            recorder.event("NO_STACKS_FILE", str(error.strerror))
    faulthandler.enable(fd, all_threads=True)
    # By faulthandler, not by a Python handler: it also answers while C code holds the interpreter.
    faulthandler.register(signal.SIGUSR1, fd, all_threads=True, chain=False)
