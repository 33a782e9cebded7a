"""Orders: everything the FailoverManager may ask of the executor, in the imperative.

The executor carries out each one and tells what came of it as an `Observation`. Nothing here says how.
"""

from enum import StrEnum

import msgspec

from hardcore.model.observations import Exit, LedgerAudited, Proof, RequestOutcome
from hardcore.model.recorder import CommandNote, LastWords, Witness
from hardcore.model.trials import TrialAction, TrialNote
from hardcore.model.verdicts import Diagnosis, Grade, Testimony


class Spawn(msgspec.Struct, frozen=True):
    """Start a core. `expected_epoch` None: raise whatever stands in the store.

    `witnesses`: the last commits that somebody saw; its ledger has to hold each of them. `safe`: it serves reads only,
    because of this; it raises no epoch and writes nothing.
    """

    life: int
    expected_epoch: int | None
    witnesses: tuple[Witness, ...]
    safe: Diagnosis | None = None


class SpawnSpare(msgspec.Struct, frozen=True):
    """Start a core that warms up, raises no epoch, and waits to be promoted."""

    life: int


class Promote(msgspec.Struct, frozen=True):
    """Have the spare take over: fence, prove, serve. As `Spawn` where they share a word.

    `busy_ms`: how long its fence may wait for the store's lock; None: as long as at any start.
    """

    life: int
    expected_epoch: int | None
    witnesses: tuple[Witness, ...]
    busy_ms: int | None = None


class Drain(msgspec.Struct, frozen=True):
    """Have the core finish what it has, take nothing new, and let go of the store; it lives on, idle.

    One that has not done so within `within_ms` takes requests again and says why.
    """

    life: int
    within_ms: int


class Adopt(msgspec.Struct, frozen=True):
    """Take over the living core that an earlier guard left, as this life."""

    life: int


class Terminate(msgspec.Struct, frozen=True):
    """Ask the core to leave (SIGTERM)."""

    life: int


class Kill(msgspec.Struct, frozen=True):
    """End the core and everything it started (SIGKILL)."""

    life: int


class KillLeftovers(msgspec.Struct, frozen=True):
    """End the cores of an earlier guard, after an identity check; life 0 stands for all of them."""


class TakeEvidence(msgspec.Struct, frozen=True):
    """Take the evidence of life `life` for this incident: from a living core it is stopped first.

    `stop` False: it goes on and is only looked at. `image`: write its memory out too, where that can be done.
    """

    life: int
    incident: str
    living: bool
    budget_ms: int
    stop: bool = True
    image: bool = False


class SampleStacks(msgspec.Struct, frozen=True):
    """Look at all stacks of a living core without stopping it; the newest look joins the evidence."""

    life: int


class LookAtStore(msgspec.Struct, frozen=True):
    """Find out who holds the store's write lock, without opening the store."""

    life: int


class SetSafe(msgspec.Struct, frozen=True):
    """Tell the serving core to answer reads only (`on`), or to try to write again."""

    life: int
    on: bool
    reason: Diagnosis


class Release(msgspec.Struct, frozen=True):
    """Tell the gateway that this life serves, and which keys must only be looked up."""

    life: int
    epoch: int
    suspects: tuple[str, ...]
    incident: str | None


class DeathNote(msgspec.Struct, frozen=True):
    """One death inside an incident."""

    at_ns: int
    diagnosis: Diagnosis
    exit: Exit | None


class Incident(msgspec.Struct, frozen=True):
    """The story of an outage, as facts. Times are monotonic; the shell adds the wall's.

    While it goes on its outcome is `open`, and `closed_ns` is 0.
    """

    id: str
    opened_ns: int
    diagnosis: Diagnosis
    grade: Grade
    evidence: tuple[Testimony, ...]
    planned: bool
    drill: str | None
    reason: str
    life: int
    epoch: int
    exit: Exit | None
    last_words: LastWords | None
    in_flight: tuple[CommandNote, ...]
    suspects: tuple[str, ...]
    timeline: tuple[tuple[str, int], ...]
    deaths: tuple[DeathNote, ...]
    requests: tuple[RequestOutcome, ...]
    proof: Proof | None
    witness: Witness | None
    next_epoch: int | None
    audit: LedgerAudited | None
    outcome: str
    waits_for: Diagnosis | None
    closed_ns: int
    blamed: tuple[str, ...] = ()  # ids of the commands that the evidence names
    trials: tuple[TrialNote, ...] = ()  # what came of its suspects so far


class CloseIncident(msgspec.Struct, frozen=True):
    """Write the facts down and have the report made."""

    incident: Incident


class AddAudit(msgspec.Struct, frozen=True):
    """Write what the proof of the whole ledger said into the facts of an incident that is closed."""

    incident: str
    audit: LedgerAudited


class RestartComponent(msgspec.Struct, frozen=True):
    """Have the serving core start one of its parts anew; the rest of it goes on."""

    life: int
    name: str


class AlertStage(StrEnum):
    """Why somebody is told now."""

    OPENED = "opened"  # something has begun
    CLOSED = "closed"  # and is over: the one closing message
    WAITS = "waits"  # nothing goes on by itself: a person is needed
    OVERDUE = "overdue"  # nobody has come
    FORECAST = "forecast"  # nothing has happened yet


class Alert(msgspec.Struct, frozen=True):
    """Say this to whoever runs the server. `incident` is what it belongs to, if there is one."""

    diagnosis: Diagnosis
    text: str
    incident: str | None = None
    stage: AlertStage = AlertStage.OPENED
    outcome: str = ""  # CLOSED: what became of it
    outage_ms: int | None = None  # CLOSED: how long it was away


class KeepBudget(msgspec.Struct, frozen=True):
    """Write the deaths that count down, so that a successor of this sentinel knows them.

    `shut`: why the policy has shut the service down, so that only a person starts it again; None: it has not.
    """

    deaths_ns: tuple[int, ...]
    shut: Diagnosis | None = None


class Halt(msgspec.Struct, frozen=True):
    """Everything is stopped as asked: the sentinel may end."""


Action = (
    Spawn
    | SpawnSpare
    | Promote
    | Drain
    | Adopt
    | Terminate
    | Kill
    | KillLeftovers
    | TakeEvidence
    | SampleStacks
    | LookAtStore
    | SetSafe
    | Release
    | CloseIncident
    | AddAudit
    | Alert
    | RestartComponent
    | KeepBudget
    | TrialAction
    | Halt
)
