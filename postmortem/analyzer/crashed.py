"""Rule: the core ended by a fatal signal of its own.

Certain, because the kernel says which signal it was. Where it happened is what the core's own handler
printed in its last moment: the Python frame, and from Python 3.14 on the one in C. Where that one is missing it is said
so, because the line of Python is only where it went out from. SIGKILL is another rule's business, as it never comes from inside.
"""

import re
import signal
from itertools import islice

from postmortem.analyzer.case import Case, Confidence, Finding, Frame, Thread

_FATAL = {
    signal.SIGSEGV: "SIGSEGV",
    signal.SIGABRT: "SIGABRT",
    signal.SIGBUS: "SIGBUS",
    signal.SIGFPE: "SIGFPE",
    signal.SIGILL: "SIGILL",
    signal.SIGSYS: "SIGSYS",
    signal.SIGTRAP: "SIGTRAP",
}
CALLERS_MAX = 4
PRINTED_THREADS_MAX = 512
PRINTED_FRAMES_MAX = 256
_PLACE = re.compile(r'File "([^"]+)", line (\d+) in (\S+)')
#: The dying thread's own stack; others may stand before it, and its stack in C behind it.
_PYTHON_STACK = re.compile(r"^(?:Current thread|Thread) 0x[^\n]*\n((?:[^\n]+\n?)*)", re.MULTILINE)
_NATIVE_STACK = re.compile(r"^Current thread's C stack trace[^\n]*\n((?:[^\n]+\n?)*)", re.MULTILINE)
#: What a handler writes before the stacks of one death.
_HEAD = "Fatal Python error"
#: Of a path, what stands before a library's own name or ours.
_ROOT = re.compile(r"^.*/(?:site-packages/|python3\.\d+/|(?=core/))")
_NUMBER = re.compile(r"0x[0-9a-f]+")
_NATIVE = re.compile(r'Binary file "(?:[^"]*/)?([^"/]*)", at (\w+)\+0x')
#: Frames of the handler that prints, and of the delivery of the signal.
_OF_THE_HANDLER = re.compile(r"_Py_Dump|faulthandler|__restore_rt|_sigtramp|__kernel_rt_sigreturn")


def examine(case: Case) -> list[Finding]:
    """Name the signal, and the frame that the dying process printed first."""
    number = case.incident.exit.signal
    name = next((text for fatal, text in _FATAL.items() if fatal == number), None)
    if name is None:
        return []
    evidence = [f"exit status: signal {number} ({name})"]
    values = {"signal": name, "place": ""}
    if (place := fatal_place(case.traceback)) is not None:
        values["place"] = place
        evidence.append(f"printed by the dying process: {place}")
        evidence += [f"called from {caller}" for caller in places(case.traceback)[1:CALLERS_MAX]]
    native = native_frames(case.traceback)
    evidence += [f"native frame: {one}" for one in native[:CALLERS_MAX]]
    if not native:
        evidence.append(
            "the native frame is not on record: this Python's handler does not print the stack in C"
        )
    if (words := case.incident.last_words) is not None:
        evidence.append(f"last words: {words.code} {words.text}".rstrip())
    rule = "crashed_at" if values["place"] else "crashed"
    return [Finding(rule, Confidence.CERTAIN, values, tuple(evidence))]


def fatal_place(traceback: str) -> str | None:
    """Return `function (file:line)` of the innermost frame of the thread that died, if it was printed."""
    return next(iter(places(traceback)), None)


def places(traceback: str) -> list[str]:
    """Return the frames of the thread that died as `function (file:line)`, the innermost first."""
    return [f"{function} ({path.rpartition('/')[2]}:{line})" for function, path, line in frames_of(traceback)]


def frames_of(traceback: str) -> list[tuple[str, str, int]]:
    """Return the frames of the thread that died as (function, path, line), the innermost first."""
    stacks = list(_PYTHON_STACK.finditer(traceback))
    # The last one: a core that was asked for its stacks before it died has printed more than once.
    dying = next((one for one in reversed(stacks) if one[0].startswith("Current")), None)
    own = dying[1] if dying else "" if stacks else traceback
    return [(match[3], match[1], int(match[2])) for match in _PLACE.finditer(own)]


def printed_threads(traceback: str) -> tuple[Thread, ...]:
    """Return the threads that the dying process printed last, with the one that died marked as active."""
    last = traceback[max(traceback.rfind(_HEAD), 0) :]
    return tuple(_printed(match) for match in islice(_PYTHON_STACK.finditer(last), PRINTED_THREADS_MAX))


def _printed(match: re.Match[str]) -> Thread:
    died = match[0].startswith("Current")
    number = _NUMBER.search(match[0])
    frames = (Frame(one[3], f"{_ROOT.sub('', one[1])}:{one[2]}", {}) for one in _PLACE.finditer(match[1]))
    return Thread(None, number[0] if number else "", died, False, tuple(islice(frames, PRINTED_FRAMES_MAX)))


def native_frames(traceback: str) -> list[str]:
    """Return the frames in C of the thread that died as `function (library)`, the innermost first, if printed."""
    printed = [one[1] for one in _NATIVE_STACK.finditer(traceback)]
    frames = [(match[2], match[1]) for match in _NATIVE.finditer(printed[-1])] if printed else []
    return [f"{function} ({library})" for function, library in frames if not _OF_THE_HANDLER.search(function)]
