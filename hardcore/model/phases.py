"""Where the guarded process is, and what that means to everybody else.

The phase is the only state of a crisis. What the page shows, what the HA state says, which stage of the
recovery is on and whether a request is held are *readings* of it: total functions below, so none of them
can go stale. "Show page" and "hide page" as orders were tried in a sketch and went out of step with the
phase as soon as the operator changed his mind in the middle.
"""

from enum import StrEnum
from typing import assert_never

from hardcore.model.verdicts import Diagnosis


class Phase(StrEnum):
    """Where the guarded process is. `recovery/transitions.py` lists every way from one to the next."""

    STOPPED = "STOPPED"  # no core, none wanted or none yet
    ADOPTING = "ADOPTING"  # a predecessor's processes were found and are being ended
    STARTING = "STARTING"  # a core was started and has not raised the epoch yet
    PROVING = "PROVING"  # it has raised the epoch and proves the ledger
    PROBATION = "PROBATION"  # it serves, and has yet to last
    RUNNING = "RUNNING"  # it serves
    SUSPECT = "SUSPECT"  # it serves, one witness is worried
    DRAINING = "DRAINING"  # told to finish what it has and let go of the store: a spare is to take over
    SNAPSHOT_LIVE = "SNAPSHOT_LIVE"  # judged; stopped; the evidence is being taken
    STOPPING = "STOPPING"  # asked to leave
    KILLING = "KILLING"  # SIGKILL sent, its end not seen yet
    UNKILLABLE = "UNKILLABLE"  # it may still live: nothing may be started beside it
    SWITCHING = "SWITCHING"  # the spare was told to take over and has not raised the epoch yet
    BACKOFF = "BACKOFF"  # no core; the next one waits for its time
    FATAL = "FATAL"  # no core; the guard has stopped trying by itself


class HAState(StrEnum):
    """The state for people and monitors."""

    STARTING = "STARTING"
    OPERATIONAL = "OPERATIONAL"
    DEGRADED = "DEGRADED"
    RECOVERY = "RECOVERY"
    SAFE_MODE = "SAFE_MODE"
    MANUAL_INTERVENTION = "MANUAL_INTERVENTION"
    SHUTDOWN = "SHUTDOWN"


class Wanted(StrEnum):
    """What the operator wants; kept on disk; always wins."""

    UP = "UP"
    SAFE = "SAFE"  # it runs, and serves reads only
    DOWN = "DOWN"


class StartCause(StrEnum):
    """Why the present core was (or is being) started."""

    FIRST = "first"
    PLANNED = "planned"
    UNPLANNED = "unplanned"


class Face(StrEnum):
    """What the gateway does with a request."""

    FORWARD = "FORWARD"  # pass it to the serving core
    HOLD = "HOLD"  # keep it until a core serves, or its time is over
    REFUSE = "REFUSE"  # answer 503 at once: nobody knows when a core comes back
    CLOSED = "CLOSED"  # the service is being stopped


#: Phases in which the core named in the feed answers requests.
SERVING = frozenset({Phase.PROBATION, Phase.RUNNING, Phase.SUSPECT})

#: Phases in which a process of ours may be alive as the core.
LIVING = frozenset(Phase) - {Phase.STOPPED, Phase.BACKOFF, Phase.FATAL}


def face(phase: Phase, wanted: Wanted) -> Face:
    """Return what the gateway does with a request in this phase."""
    match phase:
        case Phase.PROBATION | Phase.RUNNING | Phase.SUSPECT:
            return Face.FORWARD
        case Phase.FATAL | Phase.UNKILLABLE:
            return Face.REFUSE
        case Phase.STOPPED:
            return Face.CLOSED if wanted is Wanted.DOWN else Face.HOLD
        case (
            Phase.ADOPTING
            | Phase.STARTING
            | Phase.PROVING
            | Phase.DRAINING
            | Phase.SNAPSHOT_LIVE
            | Phase.SWITCHING
            | Phase.STOPPING
            | Phase.KILLING
            | Phase.BACKOFF
        ):
            return Face.CLOSED if wanted is Wanted.DOWN else Face.HOLD
        case _:
            assert_never(phase)


def ha_state(
    phase: Phase,
    wanted: Wanted,
    cause: StartCause,
    *,
    yellow: bool,
    safe: Diagnosis | None = None,
    alone: Diagnosis | None = None,
) -> HAState:
    """Return the state for people.

    `yellow`: a witness has been worried for long enough to say so. `safe`: why the core that serves answers reads
    only. A damaged ledger is one of the reasons that only a person can end. `alone`: what is wrong with it, where the
    policy leaves that to a person.
    """
    if wanted is Wanted.DOWN:
        return HAState.SHUTDOWN
    if safe is not None and phase in SERVING:
        damaged = safe is Diagnosis.STORE_CORRUPT
        return HAState.MANUAL_INTERVENTION if damaged else HAState.SAFE_MODE
    if alone is not None and phase in SERVING:
        return HAState.MANUAL_INTERVENTION
    match phase:
        case Phase.FATAL | Phase.UNKILLABLE:
            return HAState.MANUAL_INTERVENTION
        case Phase.RUNNING | Phase.SUSPECT:
            return HAState.DEGRADED if yellow else HAState.OPERATIONAL
        case Phase.PROBATION:
            return HAState.RECOVERY if cause is StartCause.UNPLANNED else HAState.OPERATIONAL
        case Phase.DRAINING | Phase.SWITCHING | Phase.PROVING if cause is StartCause.PLANNED:
            return HAState.OPERATIONAL
        case Phase.ADOPTING | Phase.SNAPSHOT_LIVE | Phase.KILLING:
            return HAState.RECOVERY
        case (
            Phase.STOPPED
            | Phase.STARTING
            | Phase.DRAINING
            | Phase.SWITCHING
            | Phase.PROVING
            | Phase.STOPPING
            | Phase.BACKOFF
        ):
            return HAState.STARTING if cause is StartCause.FIRST else HAState.RECOVERY
        case _:
            assert_never(phase)


def stage(phase: Phase) -> int | None:
    """Return the stage of the recovery that people are shown, 1 to 4, or None where none is on.

    1 problem found, 2 stopping the old core, 3 starting the next, 4 checking the balances.
    """
    match phase:
        case Phase.SNAPSHOT_LIVE:
            return 1
        case Phase.ADOPTING | Phase.DRAINING | Phase.STOPPING | Phase.KILLING | Phase.UNKILLABLE:
            return 2
        case Phase.STARTING | Phase.SWITCHING | Phase.BACKOFF | Phase.FATAL:
            return 3
        case Phase.PROVING:
            return 4
        case Phase.STOPPED | Phase.PROBATION | Phase.RUNNING | Phase.SUSPECT:
            return None
        case _:
            assert_never(phase)
