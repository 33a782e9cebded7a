"""Who comes after the core that serves: the spare is kept, asked for, and waited for here.

A spare is kept while a proven core serves. A switch that a person asks for waits for it to be there, and for one that
runs the code that lies on the disk: so an update is a switch. If that spare never comes, an update is refused and the
code that serves goes on; a mere restart is done the cold way then. A core that can't be drained serves again, and is
asked again a few times.

Not chosen: a spare that takes over by itself when the core is silent. Two judges are one too many, and the fence
would be all that stood between them.
"""

import dataclasses

from hardcore.model import observations as seen
from hardcore.model.actions import Kill, SpawnSpare
from hardcore.model.phases import SERVING, Phase, Wanted
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery import plan, telling
from hardcore.recovery.budget import NS_PER_MS, NS_PER_S
from hardcore.recovery.course import Course, Switching
from hardcore.recovery.moves import dismiss, fire, next_life
from hardcore.recovery.spare import SpareState
from hardcore.recovery.story import Trouble
from hardcore.recovery.telling import order
from hardcore.recovery.transitions import Trigger
from hardcore.sentinel.deaths import last_said

#: So often a core is asked to let go of the store for a switch, so far apart.
DRAINS_MAX = 3
DRAIN_AGAIN_NS = NS_PER_S
#: A switch that was asked for waits for a spare as long as so many starts may take.
WAITED_STARTS_MAX = 2
#: The spare is kept while the core is proven; a core on probation may yet need this machine for itself.
_KEEPING = frozenset({Phase.RUNNING, Phase.SUSPECT})

SpareFact = seen.CoreSpawned | seen.SpawnFailed | seen.SpareReady | seen.Sampled | seen.CoreExited


def tend(c: Course, now_ns: int) -> None:
    """Start a spare where there should be one, end one that hangs, switch to one that was waited for."""
    spare = c.spare
    if why := spare.hangs(now_ns):
        spare.end(why, now_ns, unasked=True)
        order(c, Kill(spare.life))
        _lost(c, now_ns)
    elif spare.state is SpareState.ENDING and now_ns - spare.since_ns > plan.KILL_AGAIN_MS * NS_PER_MS:
        spare.since_ns = now_ns
        order(c, Kill(spare.life))
    if _keeps(c) and spare.due(now_ns):
        spare.begin(next_life(c), now_ns)
        order(c, SpawnSpare(spare.life))
    _switch_if_ready(c, now_ns)


def heard(c: Course, fact: seen.Observation) -> bool:
    """Take in a fact if it is about the spare; return whether it is."""
    if c.spare.life == 0 or getattr(fact, "life", 0) != c.spare.life:
        return False
    match fact:
        case seen.SpareReady():
            c.spare.ready(fact)
            _switch_if_ready(c, fact.at_ns)
        case seen.Sampled():
            c.spare.looked(fact.at_ns, fact.beats, fact.process)
        case seen.SpawnFailed():
            _ended(c, fact.reason, fact.at_ns)
        case seen.CoreExited():
            _ended(c, last_said(fact), fact.at_ns)
        case seen.StartExtended():
            c.spare.extend(fact)
        case seen.CoreSpawned() if c.spare.state is SpareState.ENDING:
            order(
                c, Kill(c.spare.life)
            )  # it was told to end before it was there, and an order to nobody is lost
        case _:
            pass  # its process exists; a TERM came: nothing to be decided
    return True


def behind(c: Course, fact: seen.Observation) -> bool:
    """Take in a fact if it is about the core that was left behind; return whether it is."""
    if c.behind is None or getattr(fact, "life", 0) != c.behind.life:
        return False
    if isinstance(fact, seen.CoreExited):
        if c.story is not None and c.story.life == c.behind.life:
            telling.mark(c, "killed", fact.at_ns)
        c.behind = None
    return True


def asked(c: Course, fact: seen.OperatorAsked, trouble: Trouble) -> bool:
    """Take in the wish for another core if a spare is to fulfil it; return whether one is."""
    ill = c.reader is not None or c.safety.on or (c.behind is not None and c.behind.stuck)
    if c.phase not in SERVING or ill or not c.spare.comes:
        return False
    give_up_ns = fact.at_ns + WAITED_STARTS_MAX * c.spare.startup_ns
    c.switch_fault = ""
    updates = fact.build not in {"", c.spare.known}
    why = fact.reason or "the operator asked for it"
    c.switching = Switching(trouble, why, fact.build, give_up_ns, updates=updates)
    tend(c, fact.at_ns)
    return True


def drained(c: Course, fact: seen.Drained) -> None:
    """Take in the core's answer to an order to drain."""
    if c.phase is not Phase.DRAINING:
        return
    if fact.done:
        ready = c.spare.fit(fact.at_ns)
        c.switching = None
        fire(
            c,
            Trigger.DRAINED if ready else Trigger.UNSPARED,
            fact.at_ns,
            f"let go of the store at {fact.seq}",
        )
        return
    fire(c, Trigger.NOT_DRAINED, fact.at_ns, fact.reason)
    wish = c.switching
    if wish is None or wish.drains >= DRAINS_MAX:
        c.switching, c.switch_fault = None, fact.reason
        telling.alert(c, Diagnosis.PLANNED_SWITCH, f"The switch was given up: {fact.reason}")
        return
    wish.again_ns = fact.at_ns + DRAIN_AGAIN_NS


def ring(c: Course, now_ns: int) -> None:
    """Do what the time has come for: a drain again, an end for whom was told to leave and has not."""
    if c.behind is not None and c.behind.leave_by_ns is not None and now_ns >= c.behind.leave_by_ns:
        c.behind.leave_by_ns, c.behind.stuck = now_ns + plan.KILL_AGAIN_MS * NS_PER_MS, True
        order(c, Kill(c.behind.life))
    _switch_if_ready(c, now_ns)


def next_ns(c: Course) -> int | None:
    """Return when `ring` wants to be called, or None while nothing waits for its time."""
    due = [c.behind.leave_by_ns] if c.behind is not None else []
    if c.switching is not None and c.phase in _KEEPING:
        due += [c.switching.again_ns or c.switching.give_up_ns]
    return min((at_ns for at_ns in due if at_ns is not None), default=None)


def _switch_if_ready(c: Course, now_ns: int) -> None:
    wish = c.switching
    if wish is None or c.phase not in _KEEPING or (wish.again_ns is not None and now_ns < wish.again_ns):
        return
    wish.again_ns = None
    if c.safety.on and now_ns < wish.give_up_ns:
        return  # a core that reads only for a while is not the one to change; its successor could not write either
    if c.spare.state is SpareState.READY and wish.build not in {"", c.spare.build}:
        dismiss(c, now_ns)  # other code lies on the disk now
    if c.spare.fit(now_ns):
        wish.drains += 1
        c.pending = dataclasses.replace(wish.trouble, fault_ns=now_ns)  # the wait for a spare stopped nobody
        fire(c, Trigger.SWITCH, now_ns, wish.reason)
    elif not c.spare.comes or now_ns >= wish.give_up_ns:
        _give_up(c, wish, now_ns)


def _keeps(c: Course) -> bool:
    """Whether this is a time to have a spare: none beside a core that only reads, none while an old one is there."""
    proven = c.phase in _KEEPING and c.reader is None and not c.safety.locked
    return proven and c.wanted is Wanted.UP and c.behind is None


def _give_up(c: Course, wish: Switching, now_ns: int) -> None:
    """No spare will come: what was a mere restart is done the cold way, and an update is not done at all.

    Nor is anything that a spare has just failed at: a core that is started the cold way runs the same code.
    """
    c.switching = None
    if wish.updates or c.spare.fault:
        c.switch_fault = c.spare.fault or c.spare.why_not() or "no spare was ready in time"
        text = (
            f"The code that lies on the disk does not start ({c.switch_fault}). The old code goes on serving."
        )
        telling.alert(c, Diagnosis.PLANNED_SWITCH, text)
        return
    c.pending = dataclasses.replace(wish.trouble, fault_ns=now_ns)  # the wait for a spare stopped nobody
    fire(c, Trigger.RESTART, now_ns, wish.reason)


def _ended(c: Course, why: str, now_ns: int) -> None:
    if c.spare.ended(why, now_ns):
        _lost(c, now_ns)


def _lost(c: Course, now_ns: int) -> None:
    if c.spare.lost:
        text = f"Spare cores die again and again ({c.spare.fault}). Without one, a restart takes longer."
        telling.alert(c, Diagnosis.SPARE_LOST, text)
    elif c.switching is not None and c.switching.updates:
        _give_up(c, c.switching, now_ns)
