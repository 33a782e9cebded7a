"""Rule: the core ended by a fatal signal of its own.

Certain, because the kernel says which signal it was. Where it happened is what the core's own handler
printed in its last moment; SIGKILL is another rule's business, as it never comes from inside.
"""

import re
import signal

from postmortem.analyzer.case import Case, Confidence, Finding

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
_PLACE = re.compile(r'File "(?:[^"]*/)?([^"/]+)", line (\d+) in (\S+)')


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
    if (words := case.incident.last_words) is not None:
        evidence.append(f"last words: {words.code} {words.text}".rstrip())
    rule = "crashed_at" if values["place"] else "crashed"
    return [Finding(rule, Confidence.CERTAIN, values, tuple(evidence))]


def fatal_place(traceback: str) -> str | None:
    """Return `function (file:line)` of the innermost frame of the thread that died, if it was printed."""
    return next(iter(places(traceback)), None)


def places(traceback: str) -> list[str]:
    """Return the frames of the thread that died, the innermost first."""
    # The dying thread's stack is the one under "Current thread", other threads may stand before it.
    _, mark, rest = traceback.rpartition("Current thread")
    own = rest.split("\n\n", 1)[0] if mark else traceback
    return [f"{match[3]} ({match[1]}:{match[2]})" for match in _PLACE.finditer(own)]
