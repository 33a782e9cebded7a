"""Who comes after the core that serves: the spare is kept, asked for, and waited for here.

A spare is kept while a proven core serves. A switch that a person asks for waits for it to be there, and for one that
runs the code that lies on the disk: so an update is a switch. Code that nobody has seen start never takes the place of
a core that serves: where no spare is kept, or spares have died, one is started for that wish alone, and if it fails the
wish is refused with its last words. One spare at most is there, so an old one makes room for that try; if it fails
there is none until the code is mended, which is looked for every minute, and said meanwhile. A mere restart, with the
code that serves, is done the cold way where there can be no spare. A core that can't be drained serves again, and is
asked again a few times.

After a death the spare takes over whatever lies on the disk by then: all that it needs is loaded, it has been seen to
start, and what lies there has not.

A switch that no person asked for (what grows reaches its limit, a part stands still again and again) waits for a calm
moment (`calm.py`), and when none comes for as long as there is room. So many a day are done, because a core
that is worth changing every hour is a person's matter; one that could not be done counts for nothing, and is tried again
after a pause that grows.

Not chosen: a spare that takes over by itself when the core is silent. Two judges are one too many, and the fence
would be all that stood between them.
"""

from msgspec import structs

from hardcore.model import observations as seen
from hardcore.model.actions import Kill, SpawnSpare
from hardcore.model.phases import SERVING, Phase, Wanted
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery import hearing, mandate, plan, relief, telling
from hardcore.recovery.budget import NS_PER_MS, NS_PER_S
from hardcore.recovery.course import Course, Switching
from hardcore.recovery.moves import dismiss, fire, next_life
from hardcore.recovery.spare import Spare, SpareState
from hardcore.recovery.story import Trouble
from hardcore.recovery.telling import order
from hardcore.recovery.transitions import Trigger
from hardcore.sentinel.deaths import last_said

#: So often a core is asked to let go of the store for a switch, so far apart.
DRAINS_MAX = 3
DRAIN_AGAIN_NS = NS_PER_S
#: A switch that was asked for waits for a spare as long as so many starts may take.
WAITED_STARTS_MAX = 2
#: How long a calm moment is waited for; then until the limit is so near.
PATIENCE_NS = 60 * NS_PER_S
NEAR_NS = 120 * NS_PER_S
#: How often it is looked for.
CALM_AGAIN_NS = NS_PER_S
DAY_NS = 86_400 * NS_PER_S
#: One of those that could not be done is tried again after this, and after twice as long each time.
RELIEF_AGAIN_NS = 300 * NS_PER_S
#: The spare is kept while the core is proven; a core on probation may yet need this machine for itself.
_KEEPING = frozenset({Phase.RUNNING, Phase.SUSPECT})


def tend(c: Course, now_ns: int) -> None:
    """Start a spare where there should be one, end one that hangs, switch to one that was waited for."""
    spare = c.spare
    if why := spare.hangs(now_ns):
        spare.end(why, now_ns, unasked=True)
        order(c, Kill(spare.life))
        _lost(c, spare.life, now_ns)
    elif spare.state is SpareState.ENDING and now_ns - spare.since_ns > plan.KILL_AGAIN_MS * NS_PER_MS:
        spare.since_ns = now_ns
        order(c, Kill(spare.life))
    tries = c.switching is not None and c.switching.updates
    if tries or not (spare.unwanted or c.reader):
        if _keeps(c) and (spare.due(now_ns) or (tries and spare.state is SpareState.NONE)):
            spare.begin(next_life(c), now_ns)
            order(c, SpawnSpare(spare.life))
    else:
        dismiss(c, now_ns)  # it was there for a wish that is over
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
        case seen.LedgerAudited() if not fact.ok and c.phase in SERVING:
            # What it has met is the ledger's fault, and the core that serves has the same ledger.
            relief.audited(c, structs.replace(fact, life=c.life))
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
            c.story.add_page(fact.page, c.behind.blame)
            hearing.read(c, fact.page, c.behind.blame, c.behind.life, fact.at_ns)
        c.behind = None
    return True


def asked(c: Course, fact: seen.OperatorAsked, trouble: Trouble) -> bool:
    """Take in the wish for another core if a spare is to fulfil or to try it; return whether that is so."""
    if c.phase not in SERVING:
        return False
    updates = fact.build not in {"", fact.serves} or c.spare.fault != ""
    if not updates and (c.reader is not None or c.safety.troubled or _hopeless(c)):
        return False
    why = fact.reason or "the operator asked for it"
    c.switching = Switching(trouble, why, fact.build, c.born, updates=updates)
    tend(c, fact.at_ns)
    return True


def relieve(c: Course, trouble: Trouble, now_ns: int, *, limit_ns: int | None = None) -> bool:
    """Have the core changed for another in a calm moment, because of `trouble`; return whether that will be done.

    `limit_ns`: when whatever grows reaches its limit, so that no calm is waited for any more; None: nobody knows. It is
    not done by a guard that only watches (a person's `resume` does it), beside another switch, or more often in a day
    than the policy says.
    """
    busy = c.switching is not None or c.phase not in _KEEPING or c.wanted is Wanted.DOWN
    if busy or c.reader is not None or c.safety.troubled:
        return False
    if mandate.watches_only(c):
        c.offered = trouble
        return False
    if now_ns < c.relief_after_ns or len(_lately(c, now_ns)) >= c.policy.forecast_switches_max:
        return False
    why = telling.worst(trouble.death)
    c.switching = Switching(
        trouble, why, "", c.born, ours=True, patience_ns=now_ns + PATIENCE_NS, limit_ns=limit_ns
    )
    tend(c, now_ns)
    return True


def _lately(c: Course, now_ns: int) -> tuple[int, ...]:
    """Return when those of the last day were done that no person asked for."""
    return tuple(at_ns for at_ns in c.relieved_ns if now_ns - at_ns < DAY_NS)


def _count(c: Course, wish: Switching | None, now_ns: int) -> None:
    """A switch is being done: one that no person asked for is one of the day's."""
    if wish is not None and wish.ours:
        c.relieved_ns = (*_lately(c, now_ns), now_ns)
        c.relief_pause_ns = c.relief_after_ns = 0


def resumed(c: Course, now_ns: int) -> None:
    """A person says of a core that is worth another one, where the mode leaves that to a person: do it, and now."""
    trouble, c.offered = c.offered, None
    if trouble is None or c.switching is not None or c.phase not in _KEEPING:
        return
    c.switching = Switching(trouble, telling.worst(trouble.death), "", c.born)
    tend(c, now_ns)


def counted(c: Course, fact: seen.GatewayCounted) -> None:
    """Take in how much the gateway has to do."""
    c.calm.counted(fact)


def drained(c: Course, fact: seen.Drained) -> None:
    """Take in the core's answer to an order to drain."""
    if c.phase is not Phase.DRAINING:
        return
    if fact.done:
        ready = c.spare.fit(fact.at_ns)
        _count(c, c.switching, fact.at_ns)
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
        _refuse(c, fact.reason, f"The switch was given up: {fact.reason}", fact.at_ns)
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
    if wish is not None and wish.ours and not wish.drains and mandate.watches_only(c):
        # It was not begun, and the mode leaves it to a person now.
        c.switching, c.offered = None, wish.trouble
        return
    if wish is None or c.phase not in _KEEPING or (wish.again_ns is not None and now_ns < wish.again_ns):
        return
    wish.again_ns = None
    if wish.ours and _is_over(c, wish):
        c.switching = None
        return
    if wish.ours and not _is_time(c, wish, now_ns):
        wish.again_ns = now_ns + CALM_AGAIN_NS
        return
    if wish.give_up_ns is None and _keeps(c):
        wish.give_up_ns = now_ns + WAITED_STARTS_MAX * c.spare.startup_ns
    due = wish.give_up_ns is not None and now_ns >= wish.give_up_ns
    if c.safety.troubled and not (due or c.reader or c.safety.locked):
        return  # a core that reads only for a while is not the one to change; its successor could not write either
    if c.spare.state is SpareState.READY and _is_of_other_code(c.spare, wish):
        dismiss(c, now_ns)
    if c.spare.fit(now_ns):
        c.pending = structs.replace(wish.trouble, fault_ns=now_ns)  # the wait for a spare stopped nobody
        if c.safety.troubled:
            _count(c, wish, now_ns)
            c.switching = None
            fire(c, Trigger.RESTART, now_ns, wish.reason)
        else:
            wish.drains += 1
            fire(c, Trigger.SWITCH, now_ns, wish.reason)
    elif due or (_is_stuck(c) if wish.updates else _hopeless(c)):
        _give_up(c, wish, now_ns)


def _is_over(c: Course, wish: Switching) -> bool:
    """Whether what a switch was to help is over by itself: a part that stood still goes on."""
    stalled = Diagnosis.COMPONENT_STALLED
    return wish.trouble.death.diagnosis is stalled and c.verdict.diagnosis is not stalled


def _is_time(c: Course, wish: Switching, now_ns: int) -> bool:
    """Whether a switch that nobody asked for may be done now; one that was begun is gone on with."""
    if wish.drains or c.calm.is_now(now_ns):
        return True
    near = wish.limit_ns is not None and wish.limit_ns - now_ns <= NEAR_NS
    return near and now_ns >= wish.patience_ns


def _is_of_other_code(spare: Spare, wish: Switching) -> bool:
    """Whether other code was asked for than this spare runs. One that was begun after the asking runs what lay there
    by then: the files may still have been changing.
    """
    return spare.life <= wish.born and wish.build not in {"", spare.build}


def _is_stuck(c: Course) -> bool:
    return c.behind is not None and c.behind.stuck


def _hopeless(c: Course) -> bool:
    """Whether no spare is going to be kept. As long as nobody has looked at the memory that is not known.

    Beside a core whose ledger a person has to look at there is none, however long that takes.
    """
    return _is_stuck(c) or c.safety.locked or not (c.spare.comes or c.spare.unknown)


def _keeps(c: Course) -> bool:
    """Whether this is a time to have a spare: none beside a core that only reads, none while an old one is there.

    One that has to show whether new code starts is had beside any core.
    """
    tries = c.switching is not None and c.switching.updates
    proven = c.phase in _KEEPING and (tries or (c.reader is None and not c.safety.locked))
    return proven and c.wanted is not Wanted.DOWN and c.behind is None


def _give_up(c: Course, wish: Switching, now_ns: int) -> None:
    """No spare will come: what was a mere restart is done the cold way, and an update is not done at all.

    Nor is anything that a spare has just failed at: a core that is started the cold way runs the same code.
    """
    if wish.updates or c.spare.fault:
        late = "an old core is still there" if _is_stuck(c) else "no spare was ready in time"
        why = c.spare.fault or late
        text = f"The code that lies on the disk was not seen to start ({why}). The core that serves goes on."
        _refuse(c, why, text, now_ns)
        return
    _count(c, wish, now_ns)
    c.switching = None
    c.pending = structs.replace(wish.trouble, fault_ns=now_ns)  # the wait for a spare stopped nobody
    fire(c, Trigger.RESTART, now_ns, wish.reason)


def _refuse(c: Course, why: str, text: str, now_ns: int) -> None:
    """The wish is not done: the core that serves goes on."""
    if c.switching is not None and c.switching.ours:
        c.relief_pause_ns = min(2 * c.relief_pause_ns or RELIEF_AGAIN_NS, DAY_NS)
        c.relief_after_ns = now_ns + c.relief_pause_ns
    c.switching, c.switch_fault = None, why
    telling.close_switch(c, why, now_ns)
    telling.alert(c, Diagnosis.PLANNED_SWITCH, text)


def _ended(c: Course, why: str, now_ns: int) -> None:
    life = c.spare.life
    if c.spare.ended(why, now_ns):
        _lost(c, life, now_ns)


def _lost(c: Course, life: int, now_ns: int) -> None:
    """A spare is gone that nobody had asked to go. Only one that was begun for a wish decides about it."""
    if c.spare.lost and not c.spare.told:
        c.spare.told = True
        text = f"Spare cores die again and again ({c.spare.fault}). Without one, a restart takes longer."
        telling.alert(c, Diagnosis.SPARE_LOST, text)
    wish = c.switching
    if wish is not None and wish.updates and life > wish.born:
        _give_up(c, wish, now_ns)
