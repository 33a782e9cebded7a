"""What makes two deaths the same: a fingerprint, and the facts it is made of.

It is made of the diagnosis, of how the process ended, and of where: the innermost frames of our own code by function
and file, the kind of an exception, the locks of a ring, the program that held a lock. Addresses, line numbers, ids,
times and amounts stay out, because an edit above the fault or another customer is not another fault. The version is
part of it: a better rule must not join old groups to new ones by accident. A hash of the whole stack was not chosen;
it made as many groups as there were runs.
"""

import hashlib
import re

import msgspec

from postmortem.analyzer.case import Case, Finding, loop_thread
from postmortem.analyzer.crashed import frames_of
from postmortem.incident import deciding

VERSION = 2
DIGITS = 16
#: Frames of our own code that count, from the inside out.
FRAMES_MAX = 2
#: Folders of what is not ours, in a place as the evidence shows it.
_FOREIGN = re.compile(
    r"^(?:asyncio|concurrent|threading|selectors|importlib|ctypes|uvicorn|starlette|json)\b"
)
_PLACED = re.compile(r"^(.*?) ?\(([^()]*?)(?::\d+)?\)$")
_NO_NAME = re.compile(r"0x[0-9a-f]+|\d{2,}")
_RULES_WITH_PLACE = frozenset(
    {"crashed_at", "uncaught", "blocked", "spinning", "gil_held", "waits_in", "was_in", "deadlock"}
)


class Fingerprint(msgspec.Struct, frozen=True):
    """`digest`: 16 hex digits. `why`: what equal deaths have in common, as facts. `version`: of the rule that made it."""

    digest: str
    why: tuple[str, ...]
    version: int = VERSION


def make_fingerprint(case: Case, findings: tuple[Finding, ...]) -> Fingerprint:
    """Return the fingerprint of a case: the same whenever the same thing happens again."""
    incident = case.incident
    why = [f"diagnosis {incident.diagnosis}"]
    if incident.exit.signal is not None and incident.diagnosis == "CRASHED":
        why.append(f"signal {incident.exit.signal}")
    if incident.exit.code is not None:
        why.append(f"exit code {incident.exit.code}")
    if incident.last_words is not None and incident.last_words.code:
        why.append(f"last words {incident.last_words.code}")
    why += _where(case, findings)
    text = "\n".join([f"version {VERSION}", *why])
    return Fingerprint(
        hashlib.sha256(text.encode("utf-8", "backslashreplace")).hexdigest()[:DIGITS], tuple(why)
    )


def _where(case: Case, findings: tuple[Finding, ...]) -> list[str]:
    """Return where it happened; where no frame is known, what was being done."""
    ring = next((finding for finding in findings if finding.waits), None)
    if ring is not None:
        return [f"lock {steady(lock)}" for lock in sorted({one.lock for one in ring.waits})]
    kinds = [f"exception {one.values['kind']}" for one in findings if one.rule == "uncaught"]
    frames = _frames(case, findings)
    if frames:
        return [*kinds, *(f"frame {frame}" for frame in frames)]
    holders = sorted({one.values["name"] for one in findings if one.rule == "locked_out_by"})
    if holders:
        return [f"holder {steady(name)}" for name in holders]
    parts = sorted({one.values["name"] for one in findings if one.rule == "component"})
    if parts and case.incident.diagnosis == "COMPONENT_STALLED":
        return [f"component {steady(name)}" for name in parts]
    named = sorted({one.kind for one in deciding(case.incident) if one.stage == "DECIDING" and one.kind})
    return [*kinds, *(f"command {kind}" for kind in named)]


def _frames(case: Case, findings: tuple[Finding, ...]) -> list[str]:
    """Return the innermost frames that a rule rests on: our own ones first, else the one that was named."""
    named = next((one for one in findings if one.rule in _RULES_WITH_PLACE and one.values.get("place")), None)
    if named is None:
        return []
    if named.rule == "crashed_at":
        stack = [f"{function} ({path}:{line})" for function, path, line in frames_of(case.traceback)]
    elif named.rule == "uncaught":
        stack = [named.values["place"]]
    else:
        first = f"{named.values.get('function', '')} ({named.values['place']})"
        stack = [first, *_below(case, named, first)]
    own = [frame for frame in stack if not _is_foreign(frame)]
    return list(dict.fromkeys(steady(frame) for frame in own or stack))[:FRAMES_MAX]


def _below(case: Case, finding: Finding, first: str) -> list[str]:
    """Return the frames that called the one a finding names, on the same thread."""
    name = finding.values.get("thread", "")
    thread = next((one for one in case.threads if name in {one.name, str(one.tid)}), None) or loop_thread(
        case
    )
    stack = [f"{frame.function} ({frame.place})" for frame in thread.frames] if thread is not None else []
    return stack[stack.index(first) + 1 :] if first in stack else []


def is_own(place: str) -> bool:
    """Tell whether a frame's place `file:line` is in code of the ledger, as far as its path shows."""
    return not _is_foreign(f"f ({place})")


def _is_foreign(frame: str) -> bool:
    match = _PLACED.match(frame)
    return _FOREIGN.match(match[2] if match else frame) is not None


def steady(frame: str) -> str:
    """Return `function (file)` without the line, and any text without addresses and long numbers."""
    match = _PLACED.match(frame)
    told = f"{match[1].rpartition('.')[2]} ({match[2].rpartition('/')[2]})" if match else frame
    return _NO_NAME.sub("#", told)
