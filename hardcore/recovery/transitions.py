"""The table: in which phase what leads where, and what is done on the way.

Everything that changes the phase lives in this file, and this file knows nothing of cores, sockets or
clocks. It is total: a cell that is not listed means STAY, so no fact can surprise any phase. The pictures
in the manual are drawn from it.

How to read a death. A core that ends, however, leads to BACKOFF: the one phase without a process in which
the next step is decided. On entering it these questions are asked, in this order, and the first that holds
is taken at once (*state-triggered*, `ON_ENTRY`): does the operator want no core (UNWANTED)? does the mode leave what
comes next to a person (WITHHELD)? is there no sense in another try, but a core may still serve reads (READS_ONLY)? is there no sense in it at all (HOPELESS)? is there
nothing to wait for (NO_DELAY)? Only if none holds does BACKOFF last, until its deadline. UNKILLABLE asks the first
of them. So a STOP given at any moment before is never forgotten: it is kept as `wanted` and asked for here. Between
them stand two questions about a switch (below).

How to read a trouble. A verdict that a restart would not help (TROUBLED) leaves the core where it is: an incident
is opened without a death, the evidence is taken beside the running core, and it is told to serve reads only where the
policy says so. Whether it does is no phase of its own but a value beside the phase (`safety.py`): a core that reads
only may be late, lost, stopped or killed like any other, and a second set of phases would have doubled the table.
A core that was *started* to read only leaves that by being changed for another (RENEW).

How to read a mode. A guard that may only watch judges as any other, but its verdicts are told as troubles (TROUBLED) and
a core that is gone is replaced only if a person asked for what comes (WITHHELD). What was begun goes to its end in any
mode: a start, a switch, a kill after which nobody could be let go on. So a mode is no phase either (`mandate.py`).

How to read a switch. A spare that is ready takes over wherever a core would be started without a pause: after a death
(SPARE_READY is asked in BACKOFF before NO_DELAY), after a kill that has not been seen to work (asked in UNKILLABLE, with
a short patience for the store's lock: the fence is what makes that safe), and after a core that was told to drain.
Who lives on behind the fence then is no phase but a value beside it (`succession.py`), told to leave as soon as its
successor serves, or none will. A spare that fails is ended first, and then the way is the cold one: it was the only one. Unless who was left behind
was never fenced off (STUCK): that one is the core again, and only its end lets another begin.

A core that can't be drained serves again, and its incident stays open until the switch is done or given up: one wish
is one incident.

Why nobody serves reads while UNKILLABLE. A core that only reads needs no fence, so one could serve beside a core that was
killed, is still there and holds the store's lock. But that is a core that hangs in the kernel, most often in the very
disk that the reader would have to read; the sockets, receipts and look-ups of its clients wait for a core that may
write, which its end alone lets begin; and a third kind of core beside the fence would double the questions above.

Why a start that waits for the log's trial has no phase: it is a longer pause of BACKOFF (`hearing.py`), and everything
that may end a pause ends it.

Why a dead core has no phase for its evidence: its recorder page is never reused, so it can be read at the
wake-up (1 ms) and copied beside the restart; a phase in which to wait would only make the outage longer.
Why UNKILLABLE is a phase: a START given there would make two cores. Why FATAL has no process: for the same
reason. Why nothing leads back from SNAPSHOT_LIVE to RUNNING: the core was stopped by us in the middle of
something, and two kinds of evidence had agreed. Why an order is repeated at SPAWNED: a core may be told to
leave while its process is still being made, and an order to nobody is lost.

Each phase has at most one deadline; `plan.limit_ns` names it. The one of PROBATION alone changes no phase: a core that
is silent when it comes has proven nothing, so the end of the probation is a fact of its own (LASTED).
"""

from collections.abc import Mapping
from enum import StrEnum

from hardcore.model.phases import Phase


class Trigger(StrEnum):
    """What a fact means to the table."""

    START = "START"  # begin with nothing to clear away
    FOUND = "FOUND"  # begin, and an earlier sentinel's processes are there
    FOUND_SERVING = "FOUND_SERVING"  # begin, and among them is a core that serves
    FOUND_NEW = "FOUND_NEW"  # begin, and among them is a core that has only just begun to serve
    STOP = "STOP"  # the operator wants no core
    RESTART = "RESTART"  # the operator wants a new core, the old one may finish
    RESTART_HARD = "RESTART_HARD"  # the same, at once
    RESTART_IMAGED = "RESTART_IMAGED"  # the same, with an image of the old one's memory
    SWITCH = "SWITCH"  # the operator wants a new core, and a spare is ready
    RENEW = "RENEW"  # a core that was started to read only has its time to make room for one that may write
    RESUME = "RESUME"  # the operator says: try again
    SPAWNED = "SPAWNED"  # the process exists
    SPAWN_FAILED = "SPAWN_FAILED"
    DRAINED = "DRAINED"  # the core has let go of the store, and the spare is still ready
    NOT_DRAINED = "NOT_DRAINED"  # it could not, and serves again
    UNSPARED = "UNSPARED"  # it has let go, and there is no spare any more
    REFUSED = "REFUSED"  # the spare does not take over
    EPOCH_RAISED = "EPOCH_RAISED"
    READY = "READY"
    UNPROVEN = "UNPROVEN"  # it is ready, and its ledger lacks what a client was told of
    LASTED = "LASTED"  # its probation is over, and it is well
    EXITED = "EXITED"  # the core is gone
    LATE = "LATE"  # the verdict is yellow
    ON_TIME = "ON_TIME"  # the verdict is green
    LOST = "LOST"  # the verdict is red
    TROUBLED = "TROUBLED"  # it is red anew, and a restart would not help
    EASED = "EASED"  # nothing has been heard of that for long enough, or only a person can end it
    EVIDENCE_TAKEN = "EVIDENCE_TAKEN"
    DEADLINE = "DEADLINE"
    SHUTDOWN = "SHUTDOWN"  # the policy shuts the service down: nobody has come
    UNWANTED = "UNWANTED"  # state-triggered, see above
    WITHHELD = "WITHHELD"  # the mode leaves what comes next to a person
    STUCK = "STUCK"  # who was left behind was killed, is still there, and nothing has fenced it off
    READS_ONLY = "READS_ONLY"
    HOPELESS = "HOPELESS"
    SPARE_READY = "SPARE_READY"
    NO_DELAY = "NO_DELAY"


class Step(StrEnum):
    """What is done on the way; the FailoverManager turns each into an order with its particulars."""

    SPAWN = "SPAWN"
    SPAWN_READER = "SPAWN_READER"  # a core that serves reads only
    ADOPT = "ADOPT"
    DRAIN = "DRAIN"
    LEAVE_BEHIND = "LEAVE_BEHIND"  # the present core lives on, behind the fence
    PROMOTE = "PROMOTE"
    PROMOTE_BRIEFLY = "PROMOTE_BRIEFLY"  # the same, with little patience for the store's lock
    REJOIN = "REJOIN"  # who was left behind is the core again
    RETIRE = "RETIRE"  # who lives on behind the fence is told to leave
    DISMISS = "DISMISS"  # the spare is ended: somebody may put another ledger in place of the one it knows
    TERMINATE = "TERMINATE"
    KILL = "KILL"
    KILL_LEFTOVERS = "KILL_LEFTOVERS"
    OPEN = "OPEN"  # an incident, or a further death in the open one
    OPEN_PLANNED = "OPEN_PLANNED"  # an incident that the operator asked for
    OPEN_UNWATCHED = "OPEN_UNWATCHED"  # an incident that stopped nobody: the guard was gone
    OPEN_TROUBLE = "OPEN_TROUBLE"  # an incident without a death, or a further trouble in the open one
    EVIDENCE_LIVE = "EVIDENCE_LIVE"
    EVIDENCE_BESIDE = "EVIDENCE_BESIDE"  # of a core that goes on
    EVIDENCE_DEAD = "EVIDENCE_DEAD"
    READ_ONLY = "READ_ONLY"  # tell the serving core, if the policy says so
    RELEASE = "RELEASE"
    RELEASE_AGAIN = "RELEASE_AGAIN"  # the same core goes on serving
    SETTLED = "SETTLED"  # the core has proven itself: the tries before it are forgotten
    CLOSE = "CLOSE"  # the incident, if one is open
    ALERT = "ALERT"
    FORGET = "FORGET"  # the budget and the tries, because the operator said so
    HALT = "HALT"


Row = tuple[Phase, tuple[Step, ...]]

P, T, S = Phase, Trigger, Step

#: Asked on entering a phase and when its deadline leads back to it, in this order; the first that holds is taken at
#: once.
ON_ENTRY: Mapping[Phase, tuple[Trigger, ...]] = {
    P.BACKOFF: (T.UNWANTED, T.STUCK, T.WITHHELD, T.READS_ONLY, T.HOPELESS, T.SPARE_READY, T.NO_DELAY),
    P.UNKILLABLE: (T.UNWANTED, T.SPARE_READY),
}

_DIED = (P.BACKOFF, (S.OPEN, S.EVIDENCE_DEAD))
_JUDGED = (P.SNAPSHOT_LIVE, (S.OPEN, S.EVIDENCE_LIVE))
_LEAVE = (P.STOPPING, (S.TERMINATE,))
_SERVES = (P.PROBATION, (S.RELEASE, S.RETIRE))
_SWITCH = (P.DRAINING, (S.OPEN_PLANNED, S.DRAIN))
_RENEWED = (P.STOPPING, (S.OPEN_PLANNED, S.TERMINATE))
_RENEWED_HARD = (P.KILLING, (S.OPEN_PLANNED, S.KILL))
_RENEWED_IMAGED = (P.SNAPSHOT_LIVE, (S.OPEN_PLANNED, S.EVIDENCE_LIVE))
_TROUBLE = (S.OPEN_TROUBLE, S.EVIDENCE_BESIDE, S.READ_ONLY)
_SHUT = (P.STOPPING, (S.OPEN_PLANNED, S.TERMINATE))
_LEFT_TO_A_PERSON = (P.FATAL, (S.RETIRE, S.DISMISS, S.ALERT, S.CLOSE))
_AGAIN = (P.STARTING, (S.FORGET, S.RETIRE, S.SPAWN))

TABLE: Mapping[Phase, Mapping[Trigger, Row]] = {
    P.STOPPED: {
        T.START: (P.STARTING, (S.SPAWN,)),
        T.FOUND: (P.ADOPTING, (S.OPEN, S.KILL_LEFTOVERS)),
        T.FOUND_SERVING: (
            P.RUNNING,
            (S.ADOPT, S.OPEN_UNWATCHED, S.KILL_LEFTOVERS, S.RELEASE, S.CLOSE),
        ),
        T.FOUND_NEW: (P.PROBATION, (S.ADOPT, S.OPEN_UNWATCHED, S.KILL_LEFTOVERS, S.RELEASE)),
        T.HOPELESS: (P.FATAL, (S.DISMISS, S.ALERT)),
        T.STOP: (P.STOPPED, (S.HALT,)),
    },
    P.ADOPTING: {
        T.EXITED: (P.BACKOFF, ()),
        T.DEADLINE: (P.UNKILLABLE, (S.ALERT,)),
    },
    P.STARTING: {
        T.EPOCH_RAISED: (P.PROVING, ()),
        T.READY: _SERVES,
        T.UNPROVEN: _JUDGED,
        T.SPAWN_FAILED: (P.BACKOFF, (S.OPEN,)),
        T.EXITED: _DIED,
        T.DEADLINE: _JUDGED,
        T.STOP: _LEAVE,
        T.RESTART_HARD: _RENEWED_HARD,
    },
    P.SWITCHING: {
        T.EPOCH_RAISED: (P.PROVING, ()),
        T.READY: _SERVES,
        T.UNPROVEN: _JUDGED,
        T.EXITED: _DIED,
        T.REFUSED: (P.KILLING, (S.KILL,)),
        T.DEADLINE: (P.KILLING, (S.KILL,)),
        T.STOP: _LEAVE,
        T.RESTART_HARD: (P.KILLING, (S.KILL,)),
    },
    P.PROVING: {
        T.READY: _SERVES,
        T.UNPROVEN: _JUDGED,
        T.EXITED: _DIED,
        T.DEADLINE: _JUDGED,
        T.STOP: _LEAVE,
        T.RESTART_HARD: _RENEWED_HARD,
    },
    P.PROBATION: {
        T.LASTED: (P.RUNNING, (S.SETTLED, S.CLOSE)),
        T.EXITED: _DIED,
        T.LOST: _JUDGED,
        T.STOP: _LEAVE,
        T.RESTART: _RENEWED,
        T.RESTART_HARD: _RENEWED_HARD,
        T.RESTART_IMAGED: _RENEWED_IMAGED,
        T.RENEW: _LEAVE,
        T.TROUBLED: (P.PROBATION, _TROUBLE),
        T.SHUTDOWN: _SHUT,
    },
    P.RUNNING: {
        T.LATE: (P.SUSPECT, ()),
        T.EXITED: _DIED,
        T.LOST: _JUDGED,
        T.STOP: _LEAVE,
        T.SWITCH: _SWITCH,
        T.RESTART: _RENEWED,
        T.RESTART_HARD: _RENEWED_HARD,
        T.RESTART_IMAGED: _RENEWED_IMAGED,
        T.RENEW: _LEAVE,
        T.TROUBLED: (P.RUNNING, _TROUBLE),
        T.SHUTDOWN: _SHUT,
        T.EASED: (P.RUNNING, (S.CLOSE,)),
    },
    P.SUSPECT: {
        T.ON_TIME: (P.RUNNING, ()),
        T.EXITED: _DIED,
        T.LOST: _JUDGED,
        T.STOP: _LEAVE,
        T.SWITCH: _SWITCH,
        T.RESTART: _RENEWED,
        T.RESTART_HARD: _RENEWED_HARD,
        T.RESTART_IMAGED: _RENEWED_IMAGED,
        T.RENEW: _LEAVE,
        T.TROUBLED: (P.SUSPECT, _TROUBLE),
        T.SHUTDOWN: _SHUT,
        T.EASED: (P.SUSPECT, (S.CLOSE,)),
    },
    P.DRAINING: {
        T.DRAINED: (P.SWITCHING, (S.LEAVE_BEHIND, S.PROMOTE)),
        T.NOT_DRAINED: (P.RUNNING, (S.RELEASE_AGAIN,)),
        T.UNSPARED: _LEAVE,
        T.DEADLINE: _LEAVE,
        T.EXITED: _DIED,
        T.STOP: _LEAVE,
        T.RESTART_HARD: (P.KILLING, (S.KILL,)),
    },
    P.SNAPSHOT_LIVE: {
        T.EVIDENCE_TAKEN: (P.KILLING, (S.KILL,)),
        T.DEADLINE: (P.KILLING, (S.KILL,)),
        T.EXITED: (P.BACKOFF, ()),
        T.SPAWN_FAILED: (P.BACKOFF, ()),
    },
    P.STOPPING: {
        T.SPAWNED: (P.STOPPING, (S.TERMINATE,)),
        T.SPAWN_FAILED: (P.BACKOFF, ()),
        T.EXITED: (P.BACKOFF, ()),
        T.DEADLINE: (P.KILLING, (S.KILL,)),
        T.RESTART_HARD: (P.KILLING, (S.KILL,)),
    },
    P.KILLING: {
        T.SPAWNED: (P.KILLING, (S.KILL,)),
        T.SPAWN_FAILED: (P.BACKOFF, ()),
        T.EXITED: (P.BACKOFF, ()),
        T.DEADLINE: (P.UNKILLABLE, (S.ALERT,)),
    },
    P.UNKILLABLE: {
        T.SPAWNED: (P.UNKILLABLE, (S.KILL,)),
        T.SPAWN_FAILED: (P.BACKOFF, ()),
        T.EXITED: (P.BACKOFF, ()),
        T.DEADLINE: (P.UNKILLABLE, (S.KILL,)),
        T.RESUME: (P.UNKILLABLE, (S.KILL,)),
        T.RESTART_HARD: (P.UNKILLABLE, (S.KILL,)),
        T.UNWANTED: (P.UNKILLABLE, (S.CLOSE, S.HALT)),
        T.STOP: (P.UNKILLABLE, (S.CLOSE, S.HALT)),
        T.SPARE_READY: (P.SWITCHING, (S.LEAVE_BEHIND, S.PROMOTE_BRIEFLY)),
    },
    P.BACKOFF: {
        T.UNWANTED: (P.STOPPED, (S.CLOSE, S.HALT)),
        T.STUCK: (P.UNKILLABLE, (S.REJOIN, S.KILL)),
        T.READS_ONLY: (P.STARTING, (S.RETIRE, S.DISMISS, S.SPAWN_READER)),
        T.WITHHELD: _LEFT_TO_A_PERSON,
        T.HOPELESS: _LEFT_TO_A_PERSON,
        T.SPARE_READY: (P.SWITCHING, (S.PROMOTE,)),
        T.NO_DELAY: (P.STARTING, (S.RETIRE, S.SPAWN)),
        T.DEADLINE: (P.STARTING, (S.RETIRE, S.SPAWN)),
        T.STOP: (P.STOPPED, (S.CLOSE, S.HALT)),
        T.RESTART: _AGAIN,
        T.RESTART_HARD: _AGAIN,
        T.RESUME: _AGAIN,
    },
    P.FATAL: {
        T.DEADLINE: (P.STARTING, (S.SPAWN,)),
        T.READS_ONLY: (P.STARTING, (S.RETIRE, S.DISMISS, S.SPAWN_READER)),
        T.STOP: (P.STOPPED, (S.HALT,)),
        T.RESTART: (P.STARTING, (S.FORGET, S.OPEN_PLANNED, S.SPAWN)),
        T.RESTART_HARD: (P.STARTING, (S.FORGET, S.OPEN_PLANNED, S.SPAWN)),
        T.RESUME: _AGAIN,
    },
}


def step(phase: Phase, trigger: Trigger) -> Row | None:
    """Return where `trigger` leads from `phase` and what is done on the way, or None for STAY."""
    return TABLE[phase].get(trigger)
