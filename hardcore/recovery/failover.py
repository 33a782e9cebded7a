"""The FailoverManager: drives the table with facts and gives back orders.

Four verbs, as pure machines with time have them: `receive` a fact, `handle_deadline`, ask for the
`next_deadline_ns`, `take_actions`. It holds what the table can't: which life is meant, what the store's epoch
is, how many deaths are on the budget, which incident is open; all of it is one value (`course.py`), which can be
written down and given to another. It asks no clock, rolls no dice and touches nothing: ids and jitter are given, so
the same facts always lead to the same orders.
"""

from collections.abc import Callable, Mapping
from typing import assert_never

from hardcore.model import observations as seen
from hardcore.model import phases, trials
from hardcore.model.actions import Action, Incident, LookAtStore, SampleStacks
from hardcore.model.phases import Phase, StartCause, Wanted
from hardcore.model.verdicts import Colour, Diagnosis, Grade, Testimony, Wish
from hardcore.recovery import (
    asked,
    chronicle,
    foretelling,
    hearing,
    mandate,
    parts,
    plan,
    pressure,
    readiness,
    relief,
    succession,
)
from hardcore.recovery.beginning import begin
from hardcore.recovery.budget import NS_PER_MS
from hardcore.recovery.course import LATER_MAX, Course, Given, course
from hardcore.recovery.moves import ask_again, fire
from hardcore.recovery.policy import Policy
from hardcore.recovery.reading import Reading, Transition
from hardcore.recovery.spare import SpareState
from hardcore.recovery.story import Trouble
from hardcore.recovery.telling import BOOTING, mark, order, suspected_of
from hardcore.recovery.transitions import Trigger
from hardcore.sentinel.deaths import Death, describe, judge_death, last_said, own_fault

#: What kind of proof a core tells that serves reads only.
UNPROVEN = "none"
#: What a core says of its store in the middle of a drain counts if it serves again.
_OF_ITS_STORE = (seen.StoreTold, seen.SafeSwitched, seen.LedgerAudited)
#: What is given to a manager, and what it has said and nobody has taken yet.
_NOT_REMEMBERED = frozenset({"given", "actions", "transitions"})


class FailoverManager:
    """See the module. `new_id` gives incident ids, `jitter` numbers from 0 to 1."""

    def __init__(
        self,
        policy: Policy,
        wanted: Wanted,
        new_id: Callable[[], str],
        jitter: Callable[[], float],
        deaths_ns: tuple[int, ...] = (),
    ) -> None:
        self._course = course(Given(policy, new_id, jitter), wanted, deaths_ns)

    # ---- the four verbs ----

    def receive(self, fact: seen.Observation) -> None:
        """Take in one fact. Facts about another life than the present one are dropped."""
        self._take_in(fact)
        hearing.sit(self._course, fact.at_ns)
        chronicle.note(self._course, fact.at_ns)

    def _take_in(self, fact: seen.Observation) -> None:
        c = self._course
        match fact:
            case seen.SentinelBegan():
                begin(c, fact)
            case seen.OperatorAsked():
                asked.obey(c, fact)
            case seen.DrillStarted():
                if fact.life == c.life:
                    c.drill.start(fact)
                elif fact.life == c.spare.life:
                    c.spare.drilled = bool(fact.fault)
            case seen.GatewayHolding():
                # A dying process closes its sockets before its pidfd wakes us: the gateway may be first.
                c.held_ns = fact.at_ns
                mark(c, "alerted", fact.at_ns)
            case seen.GatewayWitnessed():
                if c.store.knows(fact.witness):
                    c.store.told(fact.witness)
                elif c.store.lacks(fact.witness):
                    relief.lacking(c, fact)
                else:
                    c.store.doubts(fact.witness)
            case seen.FirstServed():
                if fact.epoch == c.epoch:
                    mark(c, "serving", fact.at_ns)
            case seen.RequestsSettled():
                if c.story is not None and fact.incident == c.story.id:
                    c.story.add_requests(fact.requests)
            case seen.GatewayCounted():
                succession.counted(c, fact)
            case seen.PolicyRead():
                mandate.adopt(c, fact)
                if c.phase is Phase.FATAL and not mandate.watches_only(c):
                    ask_again(c, Trigger.READS_ONLY, fact.at_ns)
                if c.phase is Phase.BACKOFF and mandate.withheld(c):
                    fire(c, Trigger.WITHHELD, fact.at_ns, f"mode {c.policy.mode}")
            case (
                trials.CaseFiled()
                | trials.SuspectsSettled()
                | trials.Tried()
                | trials.CourtAtWork()
                | trials.TrialsOver()
                | trials.RuleRemoved()
            ):
                hearing.heard(c, fact)
            case _:
                if succession.heard(c, fact) or succession.behind(c, fact):
                    return
                # Who holds the store's lock is no one life's: a look that was asked for the last core is still true.
                if fact.life == c.life or isinstance(fact, seen.StoreLooked):
                    _receive_of_core(c, fact)

    def handle_deadline(self, now_ns: int) -> None:
        """Ring what has come: the present phase's deadline, or the time of a trouble."""
        c = self._course
        if c.deadline.rings(now_ns):
            if c.phase in BOOTING:
                limit_ms = (now_ns - c.since_ns) // NS_PER_MS
                said = Testimony("start", Colour.RED, f"the core was not ready within {limit_ms} ms")
                c.pending = Trouble(Death(Diagnosis.STARTUP_FAILED, Grade.CERTAIN, (said,)), c.since_ns)
            if c.phase is Phase.PROBATION:
                c.outlasted_ns = now_ns
                _last(c, now_ns)
            elif c.phase is Phase.FATAL and mandate.withheld(c):
                c.left = True
            else:
                fire(c, Trigger.DEADLINE, now_ns, "time is over")
        readiness.ask_again(c, now_ns)
        relief.ring(c, now_ns)
        parts.ring(c, now_ns)
        succession.ring(c, now_ns)
        hearing.sit(c, now_ns)
        chronicle.ring(c, now_ns)
        chronicle.note(c, now_ns)

    def next_deadline_ns(self) -> int | None:
        """Return when `handle_deadline` wants to be called, monotonic; None: not by itself."""
        c = self._course
        due = (
            c.deadline.due_ns,
            c.ask_again_ns,
            relief.next_ns(c),
            parts.next_ns(c),
            succession.next_ns(c),
            c.court.next_ns(),
            chronicle.next_ns(c),
        )
        return min((at_ns for at_ns in due if at_ns is not None), default=None)

    def take_actions(self) -> tuple[Action, ...]:
        """Return the orders given since the last call, in their order."""
        actions, self._course.actions = tuple(self._course.actions), []
        return actions

    def take_transitions(self) -> tuple[Transition, ...]:
        """Return the changes of phase since the last call."""
        taken = tuple(self._course.transitions)
        self._course.transitions.clear()
        return taken

    # ---- what others may know ----

    @property
    def policy(self) -> Policy:
        """The policy in force."""
        return self._course.policy

    @property
    def wanted(self) -> Wanted:
        """What the operator wants."""
        return self._course.wanted

    def open_incident(self) -> Incident | None:
        """Return what is known of the open incident, if there is one."""
        c = self._course
        return c.story.so_far(c.court.register.notes(c.story.id)) if c.story is not None else None

    def state(self) -> Mapping[str, object]:
        """Return all that this manager remembers, by name: plain values, no copies, nothing not yet taken."""
        c = self._course
        return {name: getattr(c, name) for name in c.__struct_fields__ if name not in _NOT_REMEMBERED}

    def resume(self, state: Mapping[str, object]) -> None:
        """Go on from what another manager remembered: all that its `state` named, and nothing else."""
        assert set(state) == set(self.state()), "a state is whole"
        for name, value in state.items():
            setattr(self._course, name, value)

    def reading(self) -> Reading:
        """Return what the present moment means to everybody else."""
        c = self._course
        serving = c.phase in phases.SERVING
        shown = phases.stage(c.phase)
        safe = c.safety.reason if serving else None
        locked = safe is Diagnosis.DB_LOCKED
        trouble = c.safety.trouble if serving else None
        return Reading(
            phase=c.phase,
            state=chronicle.state(c),
            face=phases.face(c.phase, c.wanted),
            stage=max(shown, c.stage_max) if shown is not None else None,
            since_ns=c.since_ns,
            fault_ns=c.story.steps["fault"] if c.story and c.story.down else None,
            wanted=c.wanted,
            life=c.life,
            epoch=c.epoch if serving else None,
            incident=c.story.id if c.story else None,
            planned=c.cause is StartCause.PLANNED,
            verdict=c.verdict,
            waits_for=plan.waits_for(c.phase, c.hopeless, trouble, chronicle.alone(c)),
            late_ticks=c.bench.late_ticks,
            deaths=len(c.budget.deaths_ns),
            audit=c.audit.heard if serving else None,
            safe=safe,
            drill_ns=c.drill.since_ns,
            in_question=asked.in_question(c),
            behind=c.behind.life if c.behind is not None else None,
            spare=c.spare.life,
            spare_ready=c.spare.state is SpareState.READY,
            spare_fault=c.spare.why_not(),
            spare_lack=c.spare.lack,
            spare_lost=c.spare.lost,
            spare_build=c.spare.build,
            switch_waits=c.switching is not None,
            switch_updates=c.switching is not None and c.switching.updates,
            switch_fault=c.switch_fault,
            start_fault="" if serving else c.start_fault,
            locked_by=c.holder.why if c.holder is not None and (locked or not serving) else None,
            mode=c.policy.mode,
            safe_by=_safe_by(c) if serving else None,
            needs_ns=c.needs_ns,
            history=c.history,
            components=c.repair.beats if serving else (),
            forecasts=c.foresight.soonest(c.life),
        )


def _safe_by(c: Course) -> str | None:
    """Return who has the core read only, if it does."""
    if c.safety.reason is None:
        return None
    return "operator" if c.safety.held or c.safety.trouble is None else "policy"


# ---- facts ----


def _receive_of_core(c: Course, fact: seen.CoreObservation) -> None:
    match fact:
        case seen.CoreSpawned():
            c.there = True
            mark(c, "spawned", fact.at_ns)
            fire(c, Trigger.SPAWNED, fact.at_ns, "it was told to leave before it was there")
        case seen.SpawnFailed():
            _not_born(c, fact)
        case seen.EpochRaised():
            if c.reader is None:
                readiness.raised(c, fact.epoch, fact.at_ns)
                fire(c, Trigger.EPOCH_RAISED, fact.at_ns, f"epoch {fact.epoch}")
        case seen.StartExtended():
            if c.phase in BOOTING:
                # Each asking is good for one more start at most: no core can ask for ever at once.
                most_ns = c.policy.startup_timeout_ms * NS_PER_MS
                c.deadline.extend(fact.at_ns + min(fact.for_ns, most_ns))
        case seen.CoreReady():
            readiness.ready(c, fact)
        case seen.PromoteRefused():
            fire(c, Trigger.REFUSED, fact.at_ns, fact.reason)
        case seen.Drained():
            succession.drained(c, fact)
            if c.phase in phases.SERVING:
                told, c.later = c.later, ()
                for one in told:
                    _receive_of_core(c, one)
        case seen.SpareReady():
            pass  # it was promoted meanwhile
        case seen.StoreLooked():
            relief.looked(c, fact)
        case seen.FenceBlocked():
            if c.phase in BOOTING:
                order(c, LookAtStore(c.life))
        case seen.TermReceived():
            c.term_sent = True
        case seen.CoreExited():
            _exited(c, fact)
        case seen.EvidenceTaken():
            _evidence(c, fact)
        case seen.SafeSwitched() if c.awaits is not None:
            if fact.on and fact.done:
                readiness.serve(c, c.awaits, fact.at_ns)
                relief.switched(c, fact)
        case _:
            if c.phase in phases.SERVING:
                _receive_of_serving(c, fact)
            elif c.phase is Phase.DRAINING and isinstance(fact, _OF_ITS_STORE):
                c.later = (*c.later, fact)[-LATER_MAX:]


def _receive_of_serving(
    c: Course,
    fact: seen.Sampled
    | seen.ComponentRestarted
    | seen.LedgerAudited
    | seen.StacksSampled
    | seen.Probed
    | seen.StoreTold
    | seen.SafeSwitched
    | seen.Surveyed,
) -> None:
    apart = seen.Sampled | seen.LedgerAudited | seen.SafeSwitched | seen.ComponentRestarted
    if not isinstance(fact, apart):
        c.bench.hear(fact)
    match fact:
        case seen.Sampled():
            _watch(c, fact)
        case seen.ComponentRestarted():
            parts.restarted(c, fact)
        case seen.LedgerAudited():
            relief.audited(c, fact)
        case seen.StacksSampled():
            c.curiosity.answered(Wish.STACKS)
        case seen.StoreTold():
            relief.told(c, fact)
        case seen.SafeSwitched():
            relief.switched(c, fact)
        case seen.Surveyed():
            relief.surveyed(c, fact)
            foretelling.surveyed(c, fact)
            c.spare.survey(fact.free_bytes)
        case seen.Probed():
            relief.probed(c, fact)
        case _:
            assert_never(fact)


def _not_born(c: Course, fact: seen.SpawnFailed) -> None:
    c.drill.cancel()
    told = Testimony("spawn", Colour.RED, f"no process could be started: {fact.reason}")
    c.pending = Trouble(Death(Diagnosis.STARTUP_FAILED, Grade.CERTAIN, (told,)), fact.at_ns)
    fire(c, Trigger.SPAWN_FAILED, fact.at_ns, fact.reason)


def _last(c: Course, now_ns: int) -> None:
    """End the probation if its time is over and the core is well.

    A worry that no patience makes a verdict of (a machine that is busy for ever) ends it too, but never silence.
    """
    if c.phase is not Phase.PROBATION or c.outlasted_ns is None:
        return
    if c.looked_ns - c.heard_ns > c.policy.health_check_timeout_ms * NS_PER_MS:
        return  # also where its silence is forgiven: an amnesty proves nothing
    if c.verdict.colour is Colour.GREEN:
        fire(c, Trigger.LASTED, now_ns, "it has served for its probation")
    elif now_ns - c.outlasted_ns >= plan.patience_max_ns(c.policy):
        fire(
            c, Trigger.LASTED, now_ns, "it has served for its probation, and what worries has come to nothing"
        )


def _watch(c: Course, tick: seen.Sampled) -> None:
    now_ns = tick.at_ns
    # Where no beat can be read there is no silence to be heard: others have to say how it is. A beat from the
    # future is none, and must not hide the silence after it.
    beat_ns = tick.beats.loop_ns if tick.beats is not None else now_ns
    c.heard_ns = max(c.heard_ns, beat_ns) if beat_ns <= now_ns else c.heard_ns
    c.looked_ns = now_ns
    c.budget = c.budget.at(now_ns)
    c.store.shown(tick.witness)
    c.repair.beats = tick.components or c.repair.beats
    if tick.process is not None:
        c.growth.look(now_ns, tick.process.rss_bytes)
    verdict = c.bench.judge(tick)
    c.worry.look(verdict.colour, now_ns)
    for wish in c.curiosity.ask(verdict.wishes, now_ns):
        order(c, SampleStacks(c.life) if wish is Wish.STACKS else LookAtStore(c.life))
    why = "; ".join(t.why for t in verdict.testimonies if t.colour is not Colour.GREEN)
    if verdict.colour is Colour.RED and verdict.diagnosis is not None:
        if plan.ends(c.policy, verdict.diagnosis) and not mandate.watches_only(c):
            death = Death(verdict.diagnosis, verdict.grade, verdict.testimonies)
            c.verdict = verdict
            c.pending = Trouble(death, verdict.fault_ns, blamed=verdict.blamed)
            fire(c, Trigger.LOST, now_ns, f"{verdict.diagnosis}: {why}")
            return
        if verdict.diagnosis is Diagnosis.COMPONENT_STALLED:
            parts.judged(c, verdict, now_ns, why)
        else:
            relief.judged(c, verdict, now_ns, why)
    c.verdict = verdict
    relief.settle(c, now_ns)
    _last(c, now_ns)
    pressure.watch(c, tick)
    foretelling.sampled(c, tick)
    succession.tend(c, now_ns)
    if verdict.colour is Colour.GREEN:
        fire(c, Trigger.ON_TIME, now_ns, "the beats are back")
    else:
        fire(c, Trigger.LATE, now_ns, why)


def _exited(c: Course, fact: seen.CoreExited) -> None:
    if c.reader is None:
        c.store.saw(fact.page)
        # Of an earlier guard's cores the one that raised the epoch last may have died before we began.
        c.store.certain = c.store.certain and c.life != 0
    how = describe(fact.exit)
    if c.phase in BOOTING | phases.SERVING | {Phase.DRAINING}:
        words = fact.page.last_words if fact.page else None
        ready = c.phase not in BOOTING
        death = judge_death(
            fact.exit,
            words,
            was_ready=ready,
            term_sent=c.term_sent,
            oom_kills=fact.oom_kills,
            disk=c.safety.disk if ready else None,
            said="" if ready else fact.said,
        )
        c.start_fault = "" if ready else last_said(fact)
        c.pending = Trouble(death, _silent_since(c, fact), fact.exit, fact.page)
    elif c.story:
        mark(c, "killed", fact.at_ns)
        c.story.exit = c.story.exit or fact.exit
        blame = own_fault(fact.exit) or suspected_of(c)
        c.story.add_page(fact.page, blame, c.growth)
        hearing.read(c, fact.page, blame, c.life, fact.at_ns, c.growth)
    fire(c, Trigger.EXITED, fact.at_ns, f"the core {how}")


def _silent_since(c: Course, fact: seen.CoreExited) -> int:
    """Return when this death began: the wake-up, or the last beat if that was long before it.

    A guard that overslept, or a core that had hung before it was killed: people waited since the beat.
    """
    beat_ns = fact.page.beats.loop_ns if fact.page else 0
    late_ns = c.policy.health_check_timeout_ms * NS_PER_MS
    silent = c.phase in phases.SERVING and beat_ns and fact.at_ns - beat_ns > late_ns
    return beat_ns if silent else fact.at_ns


def _evidence(c: Course, fact: seen.EvidenceTaken) -> None:
    if c.story:
        for name, at_ns in fact.steps:
            mark(c, name, at_ns)
        c.story.add_page(fact.page, suspected_of(c), c.growth)
        hearing.read(c, fact.page, suspected_of(c), c.life, fact.at_ns, c.growth)
    if c.phase is Phase.SNAPSHOT_LIVE and fact.stopped:
        fire(c, Trigger.EVIDENCE_TAKEN, fact.at_ns, "whole" if fact.complete else "in part")
