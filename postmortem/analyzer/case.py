"""What a rule gets to see and what it gives back: the case, and a finding with its confidence.

A case is a bundle turned into values: rules are plain functions from it, so that each can be read and tested
alone. Findings name facts, not sentences; the sentences stand in the catalogue, in every language.
"""

from collections.abc import Callable, Mapping
from enum import StrEnum
from typing import Any

import msgspec

from postmortem.analyzer.tape import Tape
from postmortem.incident import Incident, mapping, mappings, number, text


class Confidence(StrEnum):
    """How sure a finding is: a fact was seen, the facts fit, or nobody can tell."""

    CERTAIN = "certain"
    LIKELY = "likely"
    UNKNOWN = "unknown"


class Frame(msgspec.Struct, frozen=True):
    """One frame of a stack. `place` is `file:line`; `shown` are the locals as the evidence shows them."""

    function: str
    place: str
    shown: Mapping[str, str]


class Thread(msgspec.Struct, frozen=True):
    """One thread's stack, the innermost frame first."""

    tid: int | None
    name: str
    active: bool
    holds_gil: bool
    frames: tuple[Frame, ...]


class Case(msgspec.Struct, frozen=True):
    """Everything a bundle says. `traceback` is what the core itself printed of its stacks.

    `first_threads` are the stacks as they were at the first suspicion, before the verdict.
    """

    incident: Incident
    threads: tuple[Thread, ...]
    process: Mapping[str, Any]
    recorder: Mapping[str, Any]
    traceback: str
    first_threads: tuple[Thread, ...] = ()
    memory: Mapping[str, Any] = msgspec.field(default_factory=dict)
    locks: Mapping[str, Any] = msgspec.field(default_factory=dict)
    log: str = ""
    tape: Tape = msgspec.field(default_factory=Tape)
    gateway: Mapping[str, Any] = msgspec.field(default_factory=dict)  # what a lost gateway has left


class Waiting(msgspec.Struct, frozen=True):
    """Thread `who` waits for `lock`, which thread `holder` has."""

    who: str
    lock: str
    holder: str


class Finding(msgspec.Struct, frozen=True):
    """What a rule found. `values` fill the catalogue's sentence for `rule`; `evidence` are facts as read.

    `waits`: who waited for whom, where that is what was found.
    """

    rule: str
    confidence: Confidence
    values: Mapping[str, str]
    evidence: tuple[str, ...]
    account_ids: tuple[str, ...] = ()
    transaction_ids: tuple[str, ...] = ()
    waits: tuple[Waiting, ...] = ()


Rule = Callable[[Case], list[Finding]]

FRAMES_MAX = 256
THREADS_MAX = 512


def read_threads(raw: object) -> tuple[Thread, ...]:
    """Return the threads of a `stacks.json`, of whatever it holds."""
    return tuple(
        Thread(
            tid=number(thread.get("os_thread_id")),
            name=text(thread.get("thread_name")),
            active=thread.get("active") is True,
            holds_gil=thread.get("owns_gil") is True,
            frames=tuple(_frame(frame) for frame in mappings(thread.get("frames"))[:FRAMES_MAX]),
        )
        for thread in mappings(raw)[:THREADS_MAX]
    )


def loop_thread(case: Case) -> Thread | None:
    """Return the stack of the event loop's thread: named by the recorder, else the process's main one."""
    tid = number(mapping(case.recorder.get("threads")).get("loop")) or number(case.process.get("pid"))
    by_id = next((thread for thread in case.threads if tid is not None and thread.tid == tid), None)
    return by_id or next((thread for thread in case.threads if thread.name == "MainThread"), None)


def _frame(raw: Mapping[str, Any]) -> Frame:
    place = text(raw.get("short_filename")) or text(raw.get("filename")).rpartition("/")[2]
    shown = {text(local.get("name")): text(local.get("repr")) for local in mappings(raw.get("locals"))}
    return Frame(text(raw.get("name")), f"{place}:{number(raw.get('line')) or 0}", shown)
