"""Rule: an exception that nobody caught ended the core; which one, and in which frame.

The log's last traceback is the exception's own story, so its frames are certain as long as no core has begun to serve
after it was written: a log outlives its cores. A masked message stays masked; the kind of the exception and the place
are code and are shown.
"""

import re

from postmortem.analyzer.case import Case, Confidence, Finding

#: Python's own code for an exception at the top, and the one that the core leaves with by its contract.
CODES = frozenset({1, 70})
_LOG_CHARS_MAX = 64 << 10
_HEAD = "Traceback (most recent call last):"
_FRAME = re.compile(r'^ {1,8}File "(?:[^"]*/)?([^"/]+)", line (\d+)(?:, in ([\w<>.]{1,80}))?', re.MULTILINE)
_KIND = re.compile(
    r"^(?:\w{1,60}\.){0,8}(\w{0,60}(?:Error|Exception|Interrupt|Exit|Warning))\b", re.MULTILINE
)
_SERVES = "Serving the ledger of"
CALLERS_MAX = 4


def examine(case: Case) -> list[Finding]:
    """Name the exception and the frame that raised it."""
    incident = case.incident
    if incident.exit.code not in CODES and incident.diagnosis != "STARTUP_FAILED":
        return []
    story = last_story(case.log)
    words = incident.last_words
    evidence = [] if words is None else [f"last words: {words.code} {words.text}".rstrip()]
    if story is None:
        bug = incident.exit.code == 70  # the core's contract, docs/wires.md section 2
        return [Finding("uncaught_untold", Confidence.CERTAIN, {}, tuple(evidence))] if bug else []
    kind, frames, current = story
    evidence += [f"the log's last traceback: {kind} in {frames[0]}"]
    evidence += [f"called from {caller}" for caller in frames[1:CALLERS_MAX]]
    sure = Confidence.CERTAIN if current else Confidence.LIKELY
    return [Finding("uncaught", sure, {"kind": kind, "place": frames[0]}, tuple(evidence))]


def last_story(log: str) -> tuple[str, list[str], bool] | None:
    """Return (kind, frames from the inside out, whether no core has served since) of the last traceback in a log."""
    _, head, rest = log[-_LOG_CHARS_MAX:].rpartition(_HEAD)
    if not head:
        return None
    kind = _KIND.search(rest)
    story = rest[: kind.start()] if kind else rest
    frames = [f"{match[3] or '<module>'} ({match[1]}:{match[2]})" for match in _FRAME.finditer(story)]
    if not frames or kind is None:
        return None
    return kind[1], frames[::-1], _SERVES not in rest[kind.end() :]
