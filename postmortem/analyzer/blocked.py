"""Rule: a thread of the core hung in one frame; which one, and with which transaction and account.

By the ledger's convention a frame that may block keeps `transaction_id` and `account_id` as plain local
texts, so the stack itself names them. The frame is the innermost one that is not a mere wait for events:
a loop that waits in its selector is not blocked.
"""

import re
from collections.abc import Iterable

from postmortem.analyzer.case import Case, Confidence, Finding, Frame, Thread, loop_thread
from postmortem.incident import mappings, number, text, unique

#: What is said of the frame, by diagnosis. Without one (no facts yet) the stack says where the core was, not that
#: it hung there.
RULES = {"LOOP_BLOCKED": "blocked", "SPINNING": "spinning", "UNKNOWN": "was_in"}

_WAITS_FOR_EVENTS = frozenset({"select", "poll", "_run_once", "run_forever", "run_until_complete"})
#: Where a loop that has no frames of its own rests: the runner that called it.
_RUNNER = "asyncio/runners.py:"
_TEXT = re.compile(r"""^(["'])(.*)\1$""", re.DOTALL)
_ITEM = re.compile(r"""["']([^"']+)["']""")


def examine(case: Case) -> list[Finding]:
    """Name the blocked frame of the loop's thread, or the one frame elsewhere that carries a transaction."""
    rule = RULES.get(case.incident.diagnosis)
    return [] if rule is None else frame_finding(case, rule)


def frame_finding(case: Case, rule: str, sure: Confidence = Confidence.CERTAIN) -> list[Finding]:
    """Return where the core hung, told by `rule` and at most as `sure`; nothing if no stack shows it."""
    judged = case.incident.diagnosis != "UNKNOWN"
    loop = loop_thread(case)
    if loop is not None and (frame := blocked_frame(loop)) is not None:
        return [thread_finding(case, loop, frame, rule, sure if judged else Confidence.UNKNOWN)]
    # Loop at rest or not seen: a worker with a transaction in its hands is the next best.
    for thread in case.threads:
        if thread is not loop and ids_of(thread.frames)[1] and (frame := blocked_frame(thread)) is not None:
            return [
                thread_finding(case, thread, frame, rule, Confidence.LIKELY if judged else Confidence.UNKNOWN)
            ]
    return []


def blocked_frame(thread: Thread) -> Frame | None:
    """Return the innermost frame, or None if the thread only waits for events."""
    if not thread.frames or _rests(thread.frames[0]):
        return None
    return thread.frames[0]


def _rests(frame: Frame) -> bool:
    # The name may come with its class: "EpollSelector.select".
    name = frame.function.rpartition(".")[2]
    return name in _WAITS_FOR_EVENTS or (name == "run" and frame.place.startswith(_RUNNER))


def ids_of(frames: Iterable[Frame]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return (account ids, transaction ids) that the locals of these frames show, innermost first."""
    accounts: list[str] = []
    transactions: list[str] = []
    for frame in frames:
        # A frame that is about several names them in one text, with commas between.
        accounts += [
            *plain(frame.shown.get("account_id", "")).split(","),
            *_ITEM.findall(frame.shown.get("account_ids", "")),
        ]
        transactions += plain(frame.shown.get("transaction_id", "")).split(",")
    return unique(accounts), unique(transactions)


def thread_finding(case: Case, thread: Thread, frame: Frame, rule: str, sure: Confidence) -> Finding:
    """Return what `rule` says of one thread in one of its frames, with the ids that its locals show."""
    accounts, transactions = ids_of(thread.frames)
    evidence = [
        f"thread {thread.name or thread.tid} {_state(case, thread)} in {frame.function} ({frame.place})"
    ]
    if thread.holds_gil:
        evidence.append("it held the interpreter lock")
    evidence += [f"called from {caller.function} ({caller.place})" for caller in thread.frames[1:4]]
    evidence += _first_look(case, thread, frame)
    evidence += [f"local account_id = {one}" for one in accounts]
    evidence += [f"local transaction_id = {one}" for one in transactions]
    values = {
        "function": frame.function,
        "place": frame.place,
        "thread": thread.name or str(thread.tid or ""),
    }
    return Finding(rule, sure, values, tuple(evidence), accounts, transactions)


def _state(case: Case, thread: Thread) -> str:
    """Say what the thread did before the guard stopped it; of a stopped one every debugger says that it sleeps."""
    seen = (one for one in mappings(case.process.get("threads")) if number(one.get("tid")) == thread.tid)
    before = next(seen, {})
    if not (letter := text(before.get("state"))):
        return "running" if thread.active else "asleep"
    if letter == "R":
        return "running"
    waits_in = text(before.get("wchan"))
    return f"asleep ({waits_in})" if waits_in not in {"", "0"} else "asleep"


def _first_look(case: Case, thread: Thread, frame: Frame) -> list[str]:
    """Say where the look at the first suspicion had found the same thread."""
    before = next((one for one in case.first_threads if one.tid == thread.tid and one.frames), None)
    if before is None:
        return []
    first = before.frames[0]
    if (first.function, first.place) == (frame.function, frame.place):
        return ["the first look, at the suspicion, had found it in the same place"]
    return [f"the first look, at the suspicion, had found it in {first.function} ({first.place})"]


def plain(shown: str) -> str:
    """Return the text inside its quotes; anything else that a local may hold is no id."""
    match = _TEXT.match(shown)
    return match[2] if match else ""
