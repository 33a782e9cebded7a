"""Rule: a command was being decided for longer than it may take.

The recorder's slot says since when, how long it may take and on which thread, so the command is certain; where it
waited is what that thread's stack shows. Its time runs from the beginning of the deciding, or from its last
reported progress.
"""

from collections.abc import Mapping
from typing import Any

from postmortem.analyzer.blocked import thread_finding
from postmortem.analyzer.case import Case, Confidence, Finding
from postmortem.incident import mappings, number, text, texts, unique

_NS_PER_S = 1_000_000_000


def examine(case: Case) -> list[Finding]:
    """Name the command with its account and transaction, and the frame in which it waited."""
    if case.incident.diagnosis != "TRANSACTION_TIMEOUT":
        return []
    found: list[Finding] = []
    for command in _deciding(case):
        found.append(_over_time(case, command))
        tid = number(command.get("thread"))
        thread = next((one for one in case.threads if tid and one.tid == tid and one.frames), None)
        if thread is not None:
            found.append(thread_finding(case, thread, thread.frames[0], "waits_in", Confidence.CERTAIN))
    return found


def _deciding(case: Case) -> list[Mapping[str, Any]]:
    """Return the commands that the guard blamed, or else those that are over their time by the page alone."""
    deciding = [one for one in mappings(case.recorder.get("in_flight")) if one.get("stage") == "DECIDING"]
    blamed = [one for one in deciding if one.get("command_id") in case.incident.blamed]
    now_ns = number(case.recorder.get("taken_at_ns")) or 0
    return blamed or [
        one for one in deciding if 0 < (number(one.get("limit_ns")) or 0) < now_ns - _since_ns(one)
    ]


def _since_ns(command: Mapping[str, Any]) -> int:
    return max(number(command.get("stage_ns")) or 0, number(command.get("progress_ns")) or 0)


def _over_time(case: Case, command: Mapping[str, Any]) -> Finding:
    now_ns = number(case.recorder.get("taken_at_ns")) or 0
    limit_s = (number(command.get("limit_ns")) or 0) / _NS_PER_S
    took_s = max(0, now_ns - _since_ns(command)) / _NS_PER_S
    took = f"{took_s:.1f}"
    if took == f"{limit_s:.1f}" and took_s > limit_s:
        took = f"{took_s:.3f}"  # "5.0 s of 5.0 s" tells nobody that it was too long
    kind = text(command.get("kind"))
    evidence = (
        f"{kind or 'command'} {text(command.get('command_id'))} in stage DECIDING for {took} s",
        f"it may take {limit_s:.1f} s",
    )
    values = {"kind": kind or "?", "seconds": took, "limit": f"{limit_s:.1f}"}
    return Finding(
        "over_time",
        Confidence.CERTAIN,
        values,
        evidence,
        unique(texts(command.get("account_ids"))),
        unique([text(command.get("transaction_id"))]),
    )
