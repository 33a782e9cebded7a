"""From the way a process ended to what that means.

A dead process needs no second witness: its exit status is the fact. What the status alone can't tell (a
SIGKILL has no sender) is said with the care it deserves: not ours, so from outside, and nobody is suspect. Nor is
anybody where the status could not be read and the core has said nothing: it may have been a kill. Only the kernel's own count of kills for memory makes it a lack of memory; no exit code does.
Exit codes are those of `docs/wires.md` section 2.
"""

import re

import msgspec

from hardcore.model.looks import DiskFacts
from hardcore.model.observations import CoreExited, Exit
from hardcore.model.recorder import LastWords
from hardcore.model.verdicts import Colour, Diagnosis, Grade, Testimony
from hardcore.sentinel.witnesses.disk import refusal

#: Linux signal numbers by name; the pure rooms import no `signal`.
SIGNAL_NAMES = {
    1: "SIGHUP",
    2: "SIGINT",
    3: "SIGQUIT",
    4: "SIGILL",
    5: "SIGTRAP",
    6: "SIGABRT",
    7: "SIGBUS",
    8: "SIGFPE",
    9: "SIGKILL",
    10: "SIGUSR1",
    11: "SIGSEGV",
    12: "SIGUSR2",
    13: "SIGPIPE",
    14: "SIGALRM",
    15: "SIGTERM",
    24: "SIGXCPU",
    25: "SIGXFSZ",
    31: "SIGSYS",
}

#: Signals that a process brings upon itself.
_OWN = frozenset({4, 5, 6, 7, 8, 11, 31})

_SIGKILL = 9

_CODES = {
    65: Diagnosis.STORE_CORRUPT,
    69: Diagnosis.DB_LOCKED,
    73: Diagnosis.DISK_FULL,
    74: Diagnosis.COMMIT_FAILED,
    75: Diagnosis.FENCED,
    78: Diagnosis.CONFIG_INVALID,
}


#: An error in a log, as `host/said.py` says it: its kind, what it says, its place.
_ERROR = re.compile(r"(\w+)(?:: .*)? \(([^()]+, line \d+)\)")

#: Codes that stand for several diagnoses: the first of the last words says which.
_FINER = {69: frozenset({Diagnosis.STORE_AWAY}), 73: frozenset({Diagnosis.DISK_READ_ONLY})}


class Death(msgspec.Struct, frozen=True):
    """What an end means: a diagnosis, how sure it is, and the facts it rests on."""

    diagnosis: Diagnosis
    grade: Grade
    evidence: tuple[Testimony, ...]


def describe(how: Exit) -> str:
    """Return the way a process ended in words."""
    if how.signal is not None:
        return f"ended by {SIGNAL_NAMES.get(how.signal, f'signal {how.signal}')}"
    if how.code is not None:
        return f"exited with code {how.code}"
    return "is gone; nobody could read its exit status"


def last_said(fact: CoreExited) -> str:
    """Return what a core that is gone has said last: on its page, or else in its log."""
    words = fact.page.last_words if fact.page else None
    return f"{words.code}: {words.text}" if words else fact.said or "it ended without a word"


def judge_death(
    how: Exit,
    words: LastWords | None,
    *,
    was_ready: bool,
    term_sent: bool,
    oom_kills: int | None = None,
    disk: DiskFacts | None = None,
    said: str = "",
) -> Death:
    """Return what this unasked end means.

    `was_ready`: the core had reached READY. `term_sent`: a TERM had reached it that was not ours. `oom_kills`: how
    often the kernel has killed for memory since this life began; None: nobody can tell. `disk`: the last look at the
    data folder's file system while it lived. `said`: the end of its log.
    """
    facts = [Testimony("pidfd", Colour.RED, f"the core {describe(how)}")]
    if words is not None:
        # Their code alone: the sentence may quote what a person typed, and a testimony goes everywhere unmasked.
        facts.append(Testimony("last words", Colour.RED, words.code))
    elif error := _ERROR.fullmatch(said):
        # Its kind and its place alone, for the same reason.
        facts.append(Testimony("log", Colour.RED, f"{error[1]} ({error[2]})"))
    if term_sent:
        facts.append(Testimony("core", Colour.RED, "a TERM had reached it from another process"))
    if how.signal == _SIGKILL and oom_kills:
        counted = f"the kernel's count of kills for memory rose by {oom_kills} in this life"
        facts.append(Testimony("memory", Colour.RED, counted))
        return Death(Diagnosis.OUT_OF_MEMORY, Grade.CERTAIN, tuple(facts))
    diagnosis, grade = _name(how, words, was_ready=was_ready, term_sent=term_sent)
    refused = refusal(disk) if diagnosis is Diagnosis.COMMIT_FAILED else None
    if refused is not None:
        # It is the disk's doing: the next core could not write either.
        facts.append(Testimony("disk", Colour.RED, "a small write of ours was refused as well"))
        return Death(refused, Grade.CERTAIN, tuple(facts))
    return Death(diagnosis, grade, tuple(facts))


def own_fault(how: Exit) -> Diagnosis | None:
    """Return what a core that was asked to leave did instead of leaving, or None if it left.

    A crash in the middle of a stop is still a crash: what it was deciding is suspect all the same.
    """
    if how.signal in _OWN:
        return Diagnosis.CRASHED
    return None if how.code in {0, None, *_CODES} else Diagnosis.EXITED


def _name_unseen(words: LastWords | None) -> tuple[Diagnosis, Grade]:
    """Name an end whose status nobody could read: by what the core itself said, or not at all."""
    if words is None:
        return Diagnosis.EXITED, Grade.UNKNOWN
    known = (*_CODES.values(), *(one for finer in _FINER.values() for one in finer))
    return next((one for one in known if one == words.code), Diagnosis.EXITED), Grade.LIKELY


def _name(how: Exit, words: LastWords | None, *, was_ready: bool, term_sent: bool) -> tuple[Diagnosis, Grade]:
    if how.signal in _OWN:
        return Diagnosis.CRASHED, Grade.CERTAIN
    if how.signal is not None:
        return Diagnosis.KILLED_FROM_OUTSIDE, Grade.CERTAIN if how.signal == _SIGKILL else Grade.LIKELY
    if how.code in _CODES:
        # A program of somebody else's may use these numbers too: only with last words are they certain.
        if words is None:
            return _CODES[how.code], Grade.LIKELY
        finer = next((one for one in _FINER.get(how.code, ()) if one == words.code), None)
        return finer or _CODES[how.code], Grade.CERTAIN
    if how.code is None:
        return _name_unseen(words)
    if term_sent and how.code == 0:
        return Diagnosis.KILLED_FROM_OUTSIDE, Grade.CERTAIN
    if not was_ready:
        return Diagnosis.STARTUP_FAILED, Grade.CERTAIN
    return Diagnosis.EXITED, Grade.CERTAIN
