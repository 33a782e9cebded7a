"""Suspects and what a trial says of them, as values.

A death convicts nobody: it makes suspects, and only a trial in a throw-away core on a copy of the ledger, where the
command does it again, makes one of them a poison (without that rule random kills convicted 79 innocents in 150
deaths). The wires are `docs/wires.md` sections 12 to 15. Facts come from the court's process and from whoever holds a
request's body; orders go to the executor; what is remembered is the pure value of `recovery/court.py`.
"""

from enum import StrEnum

import msgspec

from hardcore.model.verdicts import Diagnosis


class Ordeal(StrEnum):
    """What became of one case in the throw-away core."""

    DIED = "died"  # its process ended
    HUNG = "hung"  # it did not answer in its time
    GREW = "grew"  # its memory passed the bound
    SURVIVED = "survived"
    COMMITTED = "committed"  # its key is in the ledger: nothing was run
    UNTRIED = "untried"  # nobody could try it


#: What convicts.
REPRODUCED = frozenset({Ordeal.DIED, Ordeal.HUNG, Ordeal.GREW})


class Reason(StrEnum):
    """Why a request is set aside, in one word for people and programs; its sentence stands in the catalogue."""

    CRASHED_CORE = "CRASHED_CORE"
    HUNG_CORE = "HUNG_CORE"
    DEADLOCK = "DEADLOCK"
    MEMORY_LIMIT = "MEMORY_LIMIT"
    INVALID_FOR_STATE = "INVALID_FOR_STATE"
    SCHEMA_UNKNOWN = "SCHEMA_UNKNOWN"
    DUPLICATE_KEY_OTHER_PAYLOAD = "DUPLICATE_KEY_OTHER_PAYLOAD"
    EXPIRED_WAITING = "EXPIRED_WAITING"
    ACCOUNT_QUARANTINED = "ACCOUNT_QUARANTINED"
    OPERATOR_HOLD = "OPERATOR_HOLD"
    UNPROVEN = "UNPROVEN"


class Letter(msgspec.Struct, frozen=True):
    """One dead letter as the guard knows it. `name` is the suspect's; `seq`: it is an event of the log.

    `held`: nothing was reproduced, so its name alone is refused; else its digest and fingerprint are too.
    """

    id: str
    name: str
    reason: Reason
    held: bool
    incidents: tuple[str, ...]
    deaths: int
    command_id: str = ""
    kind: str = ""
    account_ids: tuple[str, ...] = ()
    transaction_id: str = ""
    source: str = ""
    fingerprint: str = ""
    digest: str = ""
    seq: int | None = None


class TrialNote(msgspec.Struct, frozen=True):
    """One trial as an incident tells it. `letter`: what came of it, empty if it was cleared. What is known of the command
    is told with it: an event of the log, or a row, need not have been in flight.
    """

    name: str
    command_id: str
    ordeal: Ordeal
    letter: str
    took_ms: int
    why: str = ""
    fingerprint: str = ""
    kind: str = ""
    account_ids: tuple[str, ...] = ()
    transaction_id: str = ""


class Suspect(msgspec.Struct, frozen=True):
    """A command that may have caused a death. `deaths`: from inside, with it at work, that nothing else explains;
    `filed`: its case is on the disk.

    `ordeal`: what its last trial said, None while it is open. `letter`: it is set aside under this number. `at_ns`: of
    the death, monotonic; whoever was at work in the same one has the same. `blame`: what that death was called, None if
    nobody saw it. `company`: it only stood in the queue behind a suspect of its kind. `waits`: its accounts wait for its
    trial. `tries`: trials that said nothing; `hung`: it was slow in one. `survived`: it did no harm on trial, and who else
    was at work in its death has yet to be tried; `cleared`: it did none after an earlier death. `seq`: an event of the log.
    """

    name: str
    incident: str
    deaths: int = 1
    command_id: str = ""
    kind: str = ""
    account_ids: tuple[str, ...] = ()
    transaction_id: str = ""
    source: str = ""
    digest: str = ""
    filed: bool = False
    ordeal: Ordeal | None = None
    letter: str = ""
    at_ns: int = 0
    blame: Diagnosis | None = None
    before: tuple[str, ...] = ()  # earlier incidents that it was suspected in
    company: bool = False
    waits: bool = True
    filed_ns: int = 0
    closed_ns: int = 0
    tries: int = 0
    hung: bool = False
    survived: bool = False
    cleared: bool = False
    fingerprint: str = ""
    took_ms: int = 0
    why: str = ""
    seq: int | None = None

    @property
    def open(self) -> bool:
        """Whether it has yet to be said what becomes of it."""
        return self.ordeal is None


class Conviction(msgspec.Struct, frozen=True):
    """One conviction of what a source had sent, monotonic."""

    source: str
    at_ns: int


class CourtMemory(msgspec.Struct, frozen=True):
    """What a successor of this guard has to know of suspects: the open ones, and those tried in the last day.

    `settled_seq`: the head of the ledger under the last core that outlived its probation. Which events are left out is
    not remembered here: the rules in force say so, and a trial leaves out what they name.
    """

    suspects: tuple[Suspect, ...] = ()
    settled_seq: int = 0
    convictions: tuple[Conviction, ...] = ()


# ---- facts ----


class CaseFiled(msgspec.Struct, frozen=True):
    """The whole request (or row) of a suspect lies in `state/cases/`. `source`: who sent it."""

    at_ns: int
    name: str
    source: str = ""
    digest: str = ""


class SuspectsSettled(msgspec.Struct, frozen=True):
    """These suspects are in the ledger: they were looked up after the fence."""

    at_ns: int
    names: tuple[str, ...]


class Tried(msgspec.Struct, frozen=True):
    """One case was tried. `seq`: the event that was found, where the log was on trial."""

    at_ns: int
    name: str
    ordeal: Ordeal
    took_ms: int = 0
    fingerprint: str = ""
    kind: str = ""
    account_ids: tuple[str, ...] = ()
    transaction_id: str = ""
    signal: int | None = None
    code: int | None = None
    frame: str = ""
    seq: int | None = None
    why: str = ""


class CourtAtWork(msgspec.Struct, frozen=True):
    """The court's process has said how far it is: its copy is made, or a case is begun. It is not silent."""

    at_ns: int


class TrialsOver(msgspec.Struct, frozen=True):
    """The court's process has ended, once for each `Try` or `TryLog`, also after `EndTrials` and if none could be made.

    `fault`: why it could not do its work; empty: it did.
    """

    at_ns: int
    fault: str = ""


class RuleRemoved(msgspec.Struct, frozen=True):
    """A person has taken a rule away: what it named may run again."""

    at_ns: int
    rule: str


TrialObservation = CaseFiled | SuspectsSettled | Tried | CourtAtWork | TrialsOver | RuleRemoved


# ---- orders ----


class Try(msgspec.Struct, frozen=True):
    """Try these suspects, in their order, in throw-away cores. One court at a time."""

    names: tuple[str, ...]
    limit_ms: int
    memory_bytes: int


class TryLog(msgspec.Struct, frozen=True):
    """Find the event after `after_seq` that kills whoever rebuilds from it."""

    after_seq: int
    limit_ms: int
    memory_bytes: int


class EndTrials(msgspec.Struct, frozen=True):
    """End the court; `TrialsOver` says when it is gone, and only then another begins."""


class SetAside(msgspec.Struct, frozen=True):
    """Refuse it from now on, wherever it comes from, tell whoever waits for it, and write its letter.

    `again`: it was said before, and its request has come again: whoever waits is told again, and nobody is convicted anew.
    """

    letter: Letter
    again: bool = False


class Acquit(msgspec.Struct, frozen=True):
    """Tell whoever waits with this suspect: `run` it once; else nothing more is expected of it."""

    name: str
    run: bool


class StopSource(msgspec.Struct, frozen=True):
    """Let this source change nothing for a while: too much that it sent was convicted."""

    source: str
    for_ns: int


class SuspectNote(msgspec.Struct, frozen=True):
    """One open suspect, as whoever holds its request has to know it."""

    name: str
    account_ids: tuple[str, ...]


class KeepCourt(msgspec.Struct, frozen=True):
    """Write the court's memory down, and tell the gateway and the core who is suspect now."""

    suspects: tuple[SuspectNote, ...]
    memory: CourtMemory


class AddTrials(msgspec.Struct, frozen=True):
    """Write what came of its trials into the facts of an incident, open or closed; all of them, in place of what was said."""

    incident: str
    trials: tuple[TrialNote, ...]


TrialAction = Try | TryLog | EndTrials | SetAside | Acquit | StopSource | KeepCourt | AddTrials
