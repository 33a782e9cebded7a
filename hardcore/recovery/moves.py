"""Drives the table: one trigger, one row, what is done on the way, and what holds on arrival.

Nothing is decided here that the table could decide. The particulars of an order come from the course: which life is
meant, what the store's epoch is, which incident is open.
"""

from typing import assert_never

from hardcore.model import phases
from hardcore.model.actions import (
    Adopt,
    AlertStage,
    Drain,
    Halt,
    Kill,
    KillLeftovers,
    LookAtStore,
    Promote,
    Release,
    SetSafe,
    Spawn,
    Terminate,
)
from hardcore.model.phases import Phase, Wanted
from hardcore.model.recorder import Witness
from hardcore.model.verdicts import GREEN, Diagnosis
from hardcore.recovery import hearing, mandate, plan, telling
from hardcore.recovery.budget import NS_PER_MS, Budget
from hardcore.recovery.course import Course
from hardcore.recovery.curiosity import Curiosity
from hardcore.recovery.policy import Word
from hardcore.recovery.reading import Transition
from hardcore.recovery.repair import Repair
from hardcore.recovery.safety import RETRY_NS_MAX, SLOW, Deed
from hardcore.recovery.spare import Behind, SpareState
from hardcore.recovery.suspicion import Growth
from hardcore.recovery.telling import BOOTING, order
from hardcore.recovery.transitions import ON_ENTRY, Step, Trigger, step
from hardcore.sentinel.verdict import Bench

#: Phases whose time is the core's: it is judged by what it did not do in it.
_ITS_TIME = BOOTING | {Phase.ADOPTING, Phase.DRAINING, Phase.STOPPING, Phase.KILLING}
#: How long a spare's fence waits for the lock of a core that was killed and is still there.
BRIEFLY_MS = 100


def fire(c: Course, trigger: Trigger, now_ns: int, reason: str) -> None:
    """Ask the table, go where it says, then ask what holds on arrival."""
    row = step(c.phase, trigger)
    if row is None:
        return
    before, (after, steps) = c.phase, row
    c.why = c.why or reason
    if trigger is Trigger.WITHHELD and c.story is not None:
        c.story.withheld = True
    for name in steps:
        _do(c, name, after, now_ns)
    if after is not before:
        _enter(c, after, now_ns)
    elif trigger is Trigger.DEADLINE:
        _set_deadline(c, after, now_ns)
    c.transitions.append(Transition(now_ns, before, after, trigger, reason))
    if c.skip_evidence:
        c.skip_evidence = False
        fire(c, Trigger.EVIDENCE_TAKEN, now_ns, "the policy asks for none")
        return
    if after is before and trigger is not Trigger.DEADLINE:
        return
    for question in ON_ENTRY.get(after, ()):
        if _holds(c, question, now_ns):
            fire(c, question, now_ns, _why(c, question))
            return


def ask_again(c: Course, question: Trigger, now_ns: int) -> None:
    """Ask one of the questions of an arrival once more: what it rests on has changed."""
    if _holds(c, question, now_ns):
        fire(c, question, now_ns, _why(c, question))


def heed(c: Course, deed: Deed, now_ns: int, *, asked: bool = False) -> None:
    """Do what the switch between reading only and writing asks for. `asked`: a person wants it."""
    reason = c.safety.goal or c.safety.asked
    match deed:
        case Deed.NOTHING:
            return
        case Deed.ORDER_ON | Deed.ORDER_OFF:
            assert reason is not None, "a switch is turned for a reason"
            order(c, SetSafe(c.life, deed is Deed.ORDER_ON, reason))
        case Deed.LOOK:
            order(c, LookAtStore(c.life))
        case Deed.RENEW if mandate.watches_only(c) and not asked:
            c.safety.due_ns = now_ns + RETRY_NS_MAX  # it would end a core: it is asked for again later
        case Deed.RENEW:
            c.trying, c.consent = reason, True
            fire(c, Trigger.RENEW, now_ns, f"{reason}: whether a core may write again is tried")
        case _:
            assert_never(deed)


def next_life(c: Course) -> int:
    """Return the number of a life that begins."""
    c.born += 1
    return c.born


def _holds(c: Course, question: Trigger, now_ns: int) -> bool:
    match question:
        case Trigger.UNWANTED:
            return c.wanted is Wanted.DOWN
        case Trigger.STUCK:
            return c.behind is not None and c.behind.stuck and not c.behind.fenced
        case Trigger.WITHHELD:
            return mandate.withheld(c)
        case Trigger.READS_ONLY:
            return not c.shut and _may_read(c)
        case Trigger.HOPELESS:
            return c.shut or (c.hopeless is not None and not plan.passes(c.policy, c.hopeless))
        case Trigger.SPARE_READY:
            unhurried = c.phase is Phase.BACKOFF and c.delay_ns > 0
            # One that is still being made has no kill waiting for it: it would begin beside the spare.
            killed = (c.phase is not Phase.UNKILLABLE or c.there) and not mandate.withheld(c)
            return killed and not unhurried and c.behind is None and c.life != 0 and c.spare.fit(now_ns)
        case Trigger.NO_DELAY:
            return c.delay_ns == 0
        case _:
            raise AssertionError(f"{question} is no state-triggered question")


def _why(c: Course, question: Trigger) -> str:
    if question is Trigger.READS_ONLY:
        return f"{_reads_for(c)}: a core may still serve reads"
    if question is Trigger.HOPELESS:
        return f"{c.hopeless}: another try would not help"
    if question is Trigger.WITHHELD:
        return f"mode {c.policy.mode}: what comes next is left to a person"
    if question is Trigger.SPARE_READY:
        return "a spare is ready"
    if question is Trigger.STUCK:
        return "the core that was killed is still there, and nothing has fenced it off"
    return "the operator wants no core" if question is Trigger.UNWANTED else "nothing to wait for"


def _reads_for(c: Course) -> Diagnosis | None:
    """Return why a core could serve reads only, if anything speaks against one that writes."""
    return c.hopeless or (Diagnosis.STORE_CORRUPT if c.safety.locked else None)


def _may_read(c: Course) -> bool:
    """Whether a core is started to read only; after a try to write that failed one reads as before."""
    again = c.trying in SLOW and c.trying is c.hopeless and not c.reader_tried
    return again or plan.may_read(c.policy, _reads_for(c), tried=c.reader_tried)


def _enter(c: Course, phase: Phase, now_ns: int) -> None:
    c.phase, c.since_ns = phase, now_ns
    if phase is Phase.BACKOFF:
        c.delay_ns = hearing.pause_ns(c, plan.pause_ns(c.policy, c.tries, c.given.jitter()), now_ns)
    if phase is Phase.FATAL:
        c.left = mandate.withheld(c) and (c.hopeless is None or plan.passes(c.policy, c.hopeless))
        c.hopeless = c.hopeless or c.blame
    elif phase is not Phase.STOPPED:
        c.left = False
    _set_deadline(c, phase, now_ns)
    c.stage_max = max(c.stage_max, phases.stage(phase) or 0) if c.story else 0
    if phase in phases.SERVING:
        c.stage_max = 0
    elif phase is not Phase.DRAINING:  # a core that can't be drained goes on as it was
        c.verdict = GREEN
        c.worry.forget()
        c.safety.leave()
        c.troubles.look(now_ns, quiet=False)
    if phase is Phase.RUNNING and c.story:
        c.story.down = False


def _set_deadline(c: Course, phase: Phase, now_ns: int) -> None:
    imaged = c.image_asked or c.policy.memory_image == "always"
    never = c.shut or c.left  # only a person starts it again
    wait_ns = plan.limit_ns(c.policy, phase, c.delay_ns, None if never else c.hopeless, imaged=imaged)
    c.deadline.set(now_ns, wait_ns, forgiving=phase in _ITS_TIME)


def _do(c: Course, name: Step, after: Phase, now_ns: int) -> None:
    match name:
        case Step.SPAWN | Step.SPAWN_READER:
            _spawn(c, _reads_for(c) if name is Step.SPAWN_READER else None)
        case Step.ADOPT:
            _born(c, next_life(c), None)
            c.there = True
            order(c, Adopt(c.life))
        case Step.DRAIN:
            order(c, Drain(c.life, c.policy.drain_timeout_ms))
        case Step.PROMOTE | Step.PROMOTE_BRIEFLY:
            _promote(c, BRIEFLY_MS if name is Step.PROMOTE_BRIEFLY else None)
            telling.mark(c, "promoted", now_ns)
        case Step.LEAVE_BEHIND:
            _leave_behind(c, now_ns)
        case Step.REJOIN:
            assert c.behind is not None, "somebody was left behind"
            c.life, c.there, c.blame = c.behind.life, True, c.behind.blame
            c.behind = c.hopeless = None
        case Step.RETIRE:
            _retire(c, now_ns)
        case Step.DISMISS:
            dismiss(c, now_ns)
        case Step.TERMINATE:
            order(c, Terminate(c.life))
        case Step.KILL:
            order(c, Kill(c.life) if c.life else KillLeftovers())  # no core of ours yet: an earlier guard's
        case Step.KILL_LEFTOVERS:
            order(c, KillLeftovers())
        case Step.OPEN | Step.OPEN_PLANNED:
            trouble, planned = telling.pending(c), name is Step.OPEN_PLANNED
            telling.open_death(c, now_ns, planned=planned)
            hearing.fell(c, trouble, now_ns, planned=planned)
        case Step.OPEN_UNWATCHED:
            telling.open_unwatched(c, now_ns)
        case Step.OPEN_TROUBLE:
            telling.open_trouble(c, now_ns)
        case Step.EVIDENCE_LIVE | Step.EVIDENCE_DEAD:
            telling.order_evidence(c, living=name is Step.EVIDENCE_LIVE)
        case Step.EVIDENCE_BESIDE:
            telling.order_evidence_beside(c)
        case Step.READ_ONLY:
            _read_only(c, now_ns)
        case Step.RELEASE:
            _release(c, now_ns)
        case Step.RELEASE_AGAIN:
            _release_again(c, now_ns)
        case Step.SETTLED:
            c.tries, c.trying = 0, None
            if c.story is None and not c.safety.troubled:
                c.safety.forget()  # a try to write that nobody was told of has come off
            hearing.settle(c)
        case Step.CLOSE:
            telling.close_if_over(c, now_ns, after)
        case Step.ALERT:
            _alert_about(c, after)
        case Step.FORGET:
            c.tries, c.hopeless, c.safety.locked = 0, None, False
            c.consent, c.shut, c.trying = True, False, None
            telling.keep(c, Budget(c.budget.limit, c.budget.window_ns))
        case Step.HALT:
            dismiss(c, now_ns)
            if c.behind is not None:
                order(c, Kill(c.behind.life))
            order(c, Halt())
        case _:
            assert_never(name)


def _spawn(c: Course, reader: Diagnosis | None) -> None:
    """Start a core. A reader raises no epoch and proves nothing: what is known of the store stays as it is."""
    _born(c, next_life(c), reader)
    c.switching = None  # it runs the code that lies on the disk
    if reader is not None:
        c.challenge = None
        order(c, Spawn(c.life, None, (), safe=reader))
        return
    order(c, Spawn(c.life, *_challenge(c)))


def _promote(c: Course, busy_ms: int | None) -> None:
    if c.switching is not None and c.switching.build in {"", c.spare.build}:
        c.switching = None  # what was asked for is being done
    _born(c, c.spare.leave(), None)
    c.promoted = c.there = True
    order(c, Promote(c.life, *_challenge(c), busy_ms=busy_ms))


def _leave_behind(c: Course, now_ns: int) -> None:
    assert c.behind is None, "one core at most is left behind: there is no spare while one is"
    stuck = c.phase is Phase.UNKILLABLE
    c.behind = Behind(
        c.life, stuck, now_ns + plan.KILL_AGAIN_MS * NS_PER_MS if stuck else None, blame=c.blame
    )


def dismiss(c: Course, now_ns: int) -> None:
    """End the spare, if there is one: it is not its fault."""
    if c.spare.life != 0 and c.spare.state is not SpareState.ENDING:
        c.spare.end("it is not wanted any more", now_ns, unasked=False)
        order(c, Kill(c.spare.life))


def _retire(c: Course, now_ns: int) -> None:
    """Have the core that was left behind leave; it is ended if it does not. A stuck one has been killed already."""
    if c.behind is not None and not c.behind.stuck and c.behind.leave_by_ns is None:
        c.behind.leave_by_ns = now_ns + c.policy.stop_timeout_ms * NS_PER_MS
        order(c, Terminate(c.behind.life))


def _born(c: Course, life: int, reader: Diagnosis | None) -> None:
    """Let `life` be the core from now on: what was known of the one before is over."""
    c.life, c.promoted, c.there, c.later = life, False, False, ()
    c.drill.cancel()  # a drill is one life's
    c.blame, c.unseen = Diagnosis.OPERATOR, False
    if plan.passes(c.policy, c.hopeless):
        c.trying = c.hopeless
    c.hopeless = None
    c.term_sent = c.image_asked = False
    c.growth, c.curiosity, c.repair = Growth(), Curiosity(), Repair()
    c.offered = c.pressed_ns = c.awaits = c.ask_again_ns = None
    c.reader, c.reader_tried = reader, reader is not None


def _challenge(c: Course) -> tuple[int | None, tuple[Witness, ...]]:
    """Return the epoch that the next core has to find, if it is certain, and the commits that it has to show."""
    expected = c.store.epoch if c.store.certain else None
    shown = c.store.witnesses()
    c.challenge = max(shown, key=lambda witness: witness.seq, default=None)
    c.store.certain = False
    return expected, shown


def _release(c: Course, now_ns: int) -> None:
    c.trying = c.trying if c.trying in SLOW and c.reader is None else None
    c.outlasted_ns = None
    c.switch_fault = ""  # it was about a core that is gone
    c.audit.begin(c.story.id if c.story else None)
    heed(c, c.safety.begin(c.reader, now_ns), now_ns)
    c.consent = False  # what a person asked for is done
    c.holder = c.holder if c.reader else None
    if c.story and c.reader:
        c.story.safe = True
    c.troubles.look(now_ns, quiet=not c.safety.troubled)
    _release_again(c, now_ns)


def _release_again(c: Course, now_ns: int) -> None:
    """Have requests go to the core, which is watched from now on; what is known of it stays known."""
    assert c.epoch is not None, "a core that is ready has said its epoch"
    if c.safety.held and not c.safety.on:
        # It was asked for while the core was being drained.
        heed(c, c.safety.want(now_ns, reads_only=True), now_ns)
    elif not c.safety.held and c.safety.goal is Diagnosis.OPERATOR:
        # Taken back in that time.
        heed(c, c.safety.want(now_ns, reads_only=False), now_ns)
    c.bench = Bench(plan.patience(c.policy))
    c.held_ns = None
    c.heard_ns = c.looked_ns = now_ns
    hearing.serves(c, now_ns)
    order(
        c,
        Release(
            c.life,
            c.epoch,
            tuple(one.name for one in c.court.register.suspected()),
            c.story.id if c.story else None,
        ),
    )


def _read_only(c: Course, now_ns: int) -> None:
    assert c.troubled is not None, "reading only is a remedy for a trouble that was named"
    if c.policy.asks(c.troubled, Word.SAFE_MODE_ENTER) and not mandate.watches_only(c):
        heed(c, c.safety.enter(c.troubled, now_ns), now_ns)


def _alert_about(c: Course, after: Phase) -> None:
    if after is Phase.UNKILLABLE:
        about = c.story.diagnosis if c.story else Diagnosis.OPERATOR
        text = "The core was killed and is still there. Only a fence may let another one write; the kill is repeated."
        telling.say(c, about, text, AlertStage.WAITS)
        return
    about = c.hopeless or c.blame
    if mandate.withheld(c):
        text = f"The core is gone, and mode {c.policy.mode} leaves it so. `hardcore resume` starts another."
        telling.say(c, about, text, AlertStage.WAITS)
        return
    text = "Automatic recovery has stopped. `hardcore resume` tries again."
    telling.alert(c, about, text, AlertStage.WAITS)
