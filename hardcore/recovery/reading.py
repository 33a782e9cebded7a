"""What the manager tells of itself: the present moment, and each change of phase with its real reason."""

import msgspec

from hardcore.model.forecasts import Forecast
from hardcore.model.observations import LedgerAudited
from hardcore.model.phases import Face, HAState, Phase, Wanted
from hardcore.model.recorder import ComponentBeat
from hardcore.model.verdicts import Diagnosis, Verdict
from hardcore.recovery.spare import Lack
from hardcore.recovery.transitions import Trigger


class Transition(msgspec.Struct, frozen=True):
    """One change of phase with its real reason."""

    at_ns: int
    before: Phase
    after: Phase
    trigger: Trigger
    reason: str


class StateChange(msgspec.Struct, frozen=True):
    """One change of the state for people, with the phase and the reason behind it."""

    at_ns: int
    before: HAState
    after: HAState
    phase: Phase
    reason: str


class Reading(msgspec.Struct, frozen=True):
    """What the present moment means to everybody else."""

    phase: Phase
    state: HAState
    face: Face
    stage: int | None
    since_ns: int
    fault_ns: int | None  # when the outage that the open incident is about began
    wanted: Wanted
    life: int
    epoch: int | None
    incident: str | None
    planned: bool
    verdict: Verdict
    waits_for: str | None
    late_ticks: int
    deaths: int
    audit: LedgerAudited | None
    safe: Diagnosis | None = None  # why the serving core answers reads only
    drill_ns: int | None = None  # when a drill was ordered that has shown no effect yet
    in_question: bool = False  # an operator may say that the ledger is right as it stands
    behind: int | None = None  # the life that lives on behind the fence
    spare: int = 0  # the life that waits, 0: none
    spare_ready: bool = False
    spare_fault: str = ""  # why there is none: what became of the last one, or what keeps one from being had
    spare_lack: Lack | None = None  # the same as a word
    spare_lost: bool = False  # they die again and again: another is tried only now and then
    spare_build: str = ""  # the code that it runs
    switch_waits: bool = False  # a switch was asked for and has not been done
    switch_updates: bool = False  # and it waits for a spare to show whether the code on the disk starts
    switch_fault: str = ""  # why the last one was given up
    start_fault: str = ""  # what the core said last that was started and never served, until one serves
    locked_by: str | None = None  # who keeps the ledger's lock from a core that is to write
    mode: str = "act"  # what the guard may do
    safe_by: str | None = None  # who has the core read only: "operator", "policy"; None: nobody
    needs_ns: int | None = None  # since when a person is needed
    history: tuple[StateChange, ...] = ()  # the last changes of the state, the newest last
    components: tuple[ComponentBeat, ...] = ()  # the parts of the serving core, as they were last seen
    forecasts: tuple[Forecast, ...] = ()  # what will run out, the soonest first
