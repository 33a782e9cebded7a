"""The FailoverManager: drives the table with facts and gives back orders.

Four verbs, as pure machines with time have them: `receive` a fact, `handle_deadline`, ask for the
`next_deadline_ns`, `take_actions`. It holds what the table can't: which life is meant, what the store's epoch
is, how many deaths are on the budget, which incident is open. It asks no clock, rolls no dice and touches
nothing: ids and jitter are given, so the same facts always lead to the same orders.
"""

from collections import deque
from collections.abc import Callable
from typing import assert_never

from hardcore.model import observations as seen
from hardcore.model import phases
from hardcore.model.actions import (
    Action,
    Alert,
    CloseIncident,
    Halt,
    KeepBudget,
    Kill,
    KillLeftovers,
    Release,
    Spawn,
    TakeEvidence,
    Terminate,
)
from hardcore.model.phases import Phase, StartCause, Wanted
from hardcore.model.recorder import LifeState, Witness
from hardcore.model.verdicts import GREEN, Colour, Diagnosis, Grade, Testimony
from hardcore.recovery import plan
from hardcore.recovery.audit import Audit
from hardcore.recovery.budget import NS_PER_MS, NS_PER_S, Budget
from hardcore.recovery.deadline import Deadline
from hardcore.recovery.drill import PendingDrill
from hardcore.recovery.policy import Policy, Word
from hardcore.recovery.reading import Reading, Transition
from hardcore.recovery.store import StoreKnowledge
from hardcore.recovery.story import Story, Trouble, begin
from hardcore.recovery.transitions import ON_ENTRY, Step, Trigger, step
from hardcore.recovery.worry import Worry
from hardcore.sentinel.deaths import Death, describe, judge_death, own_fault
from hardcore.sentinel.verdict import Bench
from hardcore.sentinel.witnesses.own_stall import LATE_INTERVALS

TRANSITIONS_MAX = 1024
#: A gateway that began to hold this shortly before the death was known held because of it.
HELD_EARLY_NS = NS_PER_S
_BOOTING = frozenset({Phase.STARTING, Phase.PROVING})
#: Phases whose time is the core's: it is judged by what it did not do in it.
_ITS_TIME = _BOOTING | {Phase.ADOPTING, Phase.STOPPING, Phase.KILLING}


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
        self.policy = policy
        self.wanted = wanted
        self._new_id = new_id
        self._jitter = jitter
        self._phase = Phase.STOPPED
        self._since_ns = 0
        self._deadline = Deadline(int(policy.health_check_interval_ms * NS_PER_MS * LATE_INTERVALS))
        self._delay_ns = 0
        self._cause = StartCause.FIRST
        self._life = 0
        self._store = StoreKnowledge()
        self._budget = Budget(policy.max_restart_count, policy.restart_window_sec * NS_PER_S, deaths_ns)
        self._tries = 0
        self._hopeless: Diagnosis | None = None
        self._given: Witness | None = None
        self._blame = Diagnosis.OPERATOR  # what the end of the present life is called
        self._bench = Bench(plan.patience(policy))
        self._verdict = GREEN
        self._worry = Worry(policy.degraded_after_ms, policy.clean_after_ms)
        self._alerted: Diagnosis | None = None
        self._story: Story | None = None
        self._trouble: Trouble | None = None
        self._stage_max = 0
        self._drill = PendingDrill()
        self._audit = Audit()
        self._held_ns: int | None = None
        self._term_sent = self._skip_evidence = False
        self._actions: list[Action] = []
        self._transitions: deque[Transition] = deque(maxlen=TRANSITIONS_MAX)

    # ---- the four verbs ----

    def receive(self, fact: seen.Observation) -> None:
        """Take in one fact. Facts about another life than the present one are dropped."""
        match fact:
            case seen.SentinelBegan():
                self._begin(fact)
            case seen.OperatorAsked():
                self._obey(fact)
            case seen.DrillStarted():
                self._drill.start(fact)
            case seen.GatewayHolding():
                # A dying process closes its sockets before its pidfd wakes us: the gateway may be first.
                self._held_ns = fact.at_ns
                self._mark("alerted", fact.at_ns)
            case seen.FirstServed():
                if fact.epoch == self._store.epoch:
                    self._mark("serving", fact.at_ns)
            case seen.RequestsSettled():
                if self._story is not None and fact.incident == self._story.id:
                    self._story.add_requests(fact.requests)
            case _:
                if fact.life == self._life:
                    self._receive_of_core(fact)

    def handle_deadline(self, now_ns: int) -> None:
        """Ring the present phase's deadline if it has come."""
        if not self._deadline.rings(now_ns):
            return
        if self._phase in _BOOTING:
            limit_ms = (now_ns - self._since_ns) // NS_PER_MS
            fact = Testimony("start", Colour.RED, f"the core was not ready within {limit_ms} ms")
            self._trouble = Trouble(Death(Diagnosis.STARTUP_FAILED, Grade.CERTAIN, (fact,)), self._since_ns)
        self._fire(Trigger.DEADLINE, now_ns, "time is over")

    def next_deadline_ns(self) -> int | None:
        """Return when `handle_deadline` wants to be called, monotonic; None: not by itself."""
        return self._deadline.due_ns

    def take_actions(self) -> tuple[Action, ...]:
        """Return the orders given since the last call, in their order."""
        actions, self._actions = tuple(self._actions), []
        return actions

    def take_transitions(self) -> tuple[Transition, ...]:
        """Return the changes of phase since the last call."""
        taken = tuple(self._transitions)
        self._transitions.clear()
        return taken

    def reading(self) -> Reading:
        """Return what the present moment means to everybody else."""
        shown, yellow = phases.stage(self._phase), self._worry.shown or self._audit.worries
        return Reading(
            phase=self._phase,
            state=phases.ha_state(self._phase, self.wanted, self._cause, yellow=yellow),
            face=phases.face(self._phase, self.wanted),
            stage=max(shown, self._stage_max) if shown is not None else None,
            since_ns=self._since_ns,
            fault_ns=self._story.steps["fault"] if self._story else None,
            wanted=self.wanted,
            life=self._life,
            epoch=self._store.epoch if self._phase in phases.SERVING else None,
            incident=self._story.id if self._story else None,
            planned=self._cause is StartCause.PLANNED,
            verdict=self._verdict,
            waits_for=plan.waits_for(self._phase, self._hopeless),
            late_ticks=self._bench.late_ticks,
            deaths=len(self._budget.deaths_ns),
            audit=self._audit.heard if self._phase in phases.SERVING else None,
        )

    # ---- facts ----

    def _begin(self, fact: seen.SentinelBegan) -> None:
        self._budget = self._budget.at(fact.at_ns)
        self._store.saw(fact.page)
        self._store.certain = False  # a core of the earlier guard may have raised it since
        if self.wanted is Wanted.DOWN and not fact.leftovers:
            self._fire(Trigger.STOP, fact.at_ns, "the operator wants no core")
        elif fact.leftovers or (fact.page is not None and fact.page.beats.state is LifeState.READY):
            why = (
                "the core of a guard that is gone was found" if fact.leftovers else "guard and core are gone"
            )
            found = Testimony("run folder", Colour.RED, why)
            death = Death(Diagnosis.SENTINEL_LOST, Grade.CERTAIN, (found,))
            self._trouble = Trouble(death, fact.at_ns)
            self._fire(Trigger.FOUND, fact.at_ns, "processes of an earlier guard were found")
        else:
            self._fire(Trigger.START, fact.at_ns, "the guard is up")

    def _obey(self, fact: seen.OperatorAsked) -> None:
        why = fact.reason or "the operator asked for it"
        match fact.verb:
            case seen.Verb.STOP:
                self.wanted = Wanted.DOWN
                self._fire(Trigger.STOP, fact.at_ns, why)
            case seen.Verb.RESUME:
                if fact.accept_ledger:
                    self._store.forget()
                self._fire(Trigger.RESUME, fact.at_ns, why)
            case seen.Verb.RESTART | seen.Verb.RESTART_HARD:
                asked = Testimony("operator", Colour.GREEN, fact.reason or "no reason was given")
                self._trouble = Trouble(Death(Diagnosis.OPERATOR, Grade.CERTAIN, (asked,)), fact.at_ns)
                hard = fact.verb is seen.Verb.RESTART_HARD
                self._fire(Trigger.RESTART_HARD if hard else Trigger.RESTART, fact.at_ns, why)
            case _:
                assert_never(fact.verb)

    def _receive_of_core(self, fact: "seen.CoreObservation") -> None:
        match fact:
            case seen.Sampled():
                self._watch(fact)
            case seen.CoreSpawned():
                self._mark("spawned", fact.at_ns)
                self._fire(Trigger.SPAWNED, fact.at_ns, "it was told to leave before it was there")
            case seen.SpawnFailed():
                self._drill.cancel()
                told = Testimony("spawn", Colour.RED, f"no process could be started: {fact.reason}")
                death = Death(Diagnosis.STARTUP_FAILED, Grade.CERTAIN, (told,))
                self._trouble = Trouble(death, fact.at_ns)
                self._fire(Trigger.SPAWN_FAILED, fact.at_ns, fact.reason)
            case seen.EpochRaised():
                self._raised(fact.epoch, fact.at_ns)
                self._fire(Trigger.EPOCH_RAISED, fact.at_ns, f"epoch {fact.epoch}")
            case seen.StartExtended():
                if self._phase in _BOOTING:
                    # Each asking is good for one more start at most: no core can ask for ever at once.
                    most_ns = self.policy.startup_timeout_ms * NS_PER_MS
                    self._deadline.extend(fact.at_ns + min(fact.for_ns, most_ns))
            case seen.CoreReady():
                self._ready(fact)
            case seen.LedgerAudited():
                if self._phase in phases.SERVING:
                    self._actions += self._audit.take(fact, self._story)
            case seen.FenceBlocked():
                if self._story:
                    blocked = Testimony("core", Colour.RED, "the store is locked by somebody else")
                    self._story.add_evidence((blocked,))
            case seen.TermReceived():
                self._term_sent = True
            case seen.CoreExited():
                self._exited(fact)
            case seen.EvidenceTaken():
                self._evidence(fact)
            case _:
                assert_never(fact)

    def _raised(self, epoch: int, now_ns: int) -> None:
        self._store.epoch, self._store.certain = epoch, True
        self._mark("fenced", now_ns)

    def _ready(self, fact: seen.CoreReady) -> None:
        self._store.witness = Witness(fact.proof.seq, fact.epoch, fact.proof.hash, fact.at_ns)
        if self._phase not in _BOOTING:
            return  # it is being ended: what it has proven serves nobody
        if self._phase is Phase.STARTING:
            self._raised(fact.epoch, fact.at_ns)
        self._mark("ready", fact.at_ns)
        self._mark("verified", fact.at_ns)
        if self._story:
            self._story.proof, self._story.next_epoch = fact.proof, fact.epoch
            self._story.witness = self._given
        self._fire(Trigger.READY, fact.at_ns, f"proof: {fact.proof.kind}, {fact.proof.tail} events")

    def _watch(self, tick: seen.Sampled) -> None:
        if self._phase not in phases.SERVING:
            return
        self._budget = self._budget.at(tick.at_ns)
        self._verdict = verdict = self._bench.judge(tick)
        self._worry.look(verdict.colour, tick.at_ns)
        if verdict.colour is Colour.GREEN:
            self._alerted = None
            self._fire(Trigger.ON_TIME, tick.at_ns, "the beats are back")
            return
        why = "; ".join(t.why for t in verdict.testimonies if t.colour is not Colour.GREEN)
        if verdict.diagnosis is None:
            self._fire(Trigger.LATE, tick.at_ns, why)
        elif self.policy.asks(verdict.diagnosis, Word.REBOOT_PROCESS):
            death = Death(verdict.diagnosis, verdict.grade, verdict.testimonies)
            self._trouble = Trouble(death, verdict.fault_ns)
            self._fire(Trigger.LOST, tick.at_ns, f"{verdict.diagnosis}: {why}")
        else:
            self._fire(Trigger.LATE, tick.at_ns, why)
            if self._alerted is not verdict.diagnosis:
                self._alerted = verdict.diagnosis
                self._alert(verdict.diagnosis, f"{why}. The policy says not to restart.")

    def _exited(self, fact: seen.CoreExited) -> None:
        self._store.saw(fact.page)
        how = describe(fact.exit)
        if self._phase in _BOOTING | phases.SERVING:
            words = fact.page.last_words if fact.page else None
            ready = self._phase in phases.SERVING
            death = judge_death(fact.exit, words, was_ready=ready, term_sent=self._term_sent)
            self._trouble = Trouble(death, self._silent_since(fact), fact.exit, fact.page)
        elif self._story:
            self._mark("killed", fact.at_ns)
            self._story.exit = self._story.exit or fact.exit
            self._story.add_page(fact.page, own_fault(fact.exit) or self._blame)
        self._fire(Trigger.EXITED, fact.at_ns, f"the core {how}")

    def _silent_since(self, fact: seen.CoreExited) -> int:
        """Return when this death began: the wake-up, or the last beat if that was long before it.

        A guard that overslept, or a core that had hung before it was killed: people waited since the beat.
        """
        beat_ns = fact.page.beats.loop_ns if fact.page else 0
        late_ns = self.policy.health_check_timeout_ms * NS_PER_MS
        silent = self._phase in phases.SERVING and beat_ns and fact.at_ns - beat_ns > late_ns
        return beat_ns if silent else fact.at_ns

    def _evidence(self, fact: seen.EvidenceTaken) -> None:
        if self._story:
            for name, at_ns in fact.steps:
                self._mark(name, at_ns)
            self._story.add_page(fact.page, self._blame)
        if self._phase is Phase.SNAPSHOT_LIVE:
            self._fire(Trigger.EVIDENCE_TAKEN, fact.at_ns, "whole" if fact.complete else "in part")

    # ---- the table ----

    def _fire(self, trigger: Trigger, now_ns: int, reason: str) -> None:
        """Ask the table, go where it says, then ask what holds on arrival."""
        row = step(self._phase, trigger)
        if row is None:
            return
        before, (after, steps) = self._phase, row
        for name in steps:
            self._do(name, after, now_ns)
        if after is not before:
            self._enter(after, now_ns)
        elif trigger is Trigger.DEADLINE:
            self._set_deadline(after, now_ns)
        self._transitions.append(Transition(now_ns, before, after, trigger, reason))
        if self._skip_evidence:
            self._skip_evidence = False
            self._fire(Trigger.EVIDENCE_TAKEN, now_ns, "the policy asks for none")
            return
        if after is before:
            return
        for question in ON_ENTRY.get(after, ()):
            if self._holds(question):
                self._fire(question, now_ns, self._why(question))
                return

    def _holds(self, question: Trigger) -> bool:
        match question:
            case Trigger.UNWANTED:
                return self.wanted is Wanted.DOWN
            case Trigger.HOPELESS:
                return self._hopeless is not None
            case Trigger.NO_DELAY:
                return self._delay_ns == 0
            case _:
                raise AssertionError(f"{question} is no state-triggered question")

    def _why(self, question: Trigger) -> str:
        if question is Trigger.HOPELESS:
            return f"{self._hopeless}: another try would not help"
        return "the operator wants no core" if question is Trigger.UNWANTED else "nothing to wait for"

    def _enter(self, phase: Phase, now_ns: int) -> None:
        self._phase, self._since_ns = phase, now_ns
        if phase is Phase.BACKOFF:
            self._delay_ns = plan.pause_ns(self.policy, self._tries, self._jitter())
        self._set_deadline(phase, now_ns)
        self._stage_max = max(self._stage_max, phases.stage(phase) or 0) if self._story else 0
        if phase not in phases.SERVING:
            self._verdict = GREEN
            self._worry.forget()

    def _set_deadline(self, phase: Phase, now_ns: int) -> None:
        wait_ns = plan.limit_ns(self.policy, phase, self._delay_ns, self._hopeless)
        self._deadline.set(now_ns, wait_ns, forgiving=phase in _ITS_TIME)

    # ---- what is done on the way ----

    def _do(self, name: Step, after: Phase, now_ns: int) -> None:
        match name:
            case Step.SPAWN:
                self._spawn()
            case Step.TERMINATE:
                self._actions.append(Terminate(self._life))
            case Step.KILL:
                self._actions.append(Kill(self._life))
            case Step.KILL_LEFTOVERS:
                self._actions.append(KillLeftovers())
            case Step.OPEN | Step.OPEN_PLANNED:
                self._open(now_ns, planned=name is Step.OPEN_PLANNED)
            case Step.EVIDENCE_LIVE | Step.EVIDENCE_DEAD:
                self._order_evidence(living=name is Step.EVIDENCE_LIVE)
            case Step.RELEASE:
                self._release()
            case Step.SETTLED:
                self._tries = 0
            case Step.CLOSE:
                self._close(now_ns, recovered=after is Phase.RUNNING)
            case Step.ALERT:
                self._alert_about(after)
            case Step.FORGET:
                self._tries, self._hopeless = 0, None
                self._keep(Budget(self._budget.limit, self._budget.window_ns))
            case Step.HALT:
                self._actions.append(Halt())
            case _:
                assert_never(name)

    def _spawn(self) -> None:
        self._life += 1
        self._drill.cancel()  # a drill is one life's
        self._blame = Diagnosis.OPERATOR
        self._hopeless = None
        self._term_sent = False
        expected = self._store.epoch if self._store.certain else None
        self._given = self._store.witness  # what this core has to prove its ledger against
        self._store.certain = False
        self._actions.append(Spawn(self._life, expected, self._store.witness))

    def _release(self) -> None:
        self._bench = Bench(plan.patience(self.policy))
        self._held_ns = None
        assert self._store.epoch is not None, "a core that is ready has said its epoch"
        suspects = self._story.suspects if self._story else ()
        incident = self._story.id if self._story else None
        self._audit.begin(incident)
        self._actions.append(Release(self._life, self._store.epoch, suspects, incident))

    def _open(self, now_ns: int, *, planned: bool) -> None:
        trouble, self._trouble = self._trouble, None
        assert trouble is not None, "an incident is opened only for a trouble that was named"
        death = trouble.death
        self._blame = death.diagnosis
        drill = self._drill.take(now_ns)
        if self._phase is Phase.PROBATION:
            self._close(now_ns, recovered=True)  # a proven core had served: what comes now is another story
        if self._story is None or self._story.planned:
            known = self._story.id if self._story else self._new_id()
            epoch = self._store.epoch or 0
            self._story = begin(known, self._story, trouble, self._life, epoch, now_ns, planned=planned)
            self._story.drill = drill
            if self._held_ns is not None and now_ns - self._held_ns <= HELD_EARLY_NS:
                self._story.mark("alerted", now_ns)
        self._story.add_evidence(death.evidence)
        self._story.exit = self._story.exit or trouble.exit
        self._story.add_page(trouble.page, death.diagnosis)
        if planned:
            self._cause = StartCause.PLANNED
            return
        if drill is None:
            self._alert(death.diagnosis, f"{death.evidence[0].why}. Recovery has begun.")
        self._story.add_death(death.diagnosis, trouble.exit, trouble.fault_ns)
        if self._cause is not StartCause.FIRST or self._phase in phases.SERVING:
            self._cause = StartCause.UNPLANNED
        if death.diagnosis is not Diagnosis.SENTINEL_LOST:
            self._count(death.diagnosis, now_ns, free=drill is not None)

    def _count(self, diagnosis: Diagnosis, now_ns: int, *, free: bool) -> None:
        """Put an unplanned death on the budget and judge whether another try makes sense."""
        if self._phase in _BOOTING or self._phase is Phase.PROBATION:
            self._tries += 1
        if not free:
            self._keep(self._budget.after_death(now_ns))
        self._hopeless = plan.hopeless(self.policy, diagnosis, spent=self._budget.spent(now_ns))

    def _keep(self, budget: Budget) -> None:
        self._budget = budget
        self._actions.append(KeepBudget(budget.deaths_ns))

    def _order_evidence(self, *, living: bool) -> None:
        assert self._story is not None, "evidence belongs to an incident"
        wanted = self.policy.asks(self._blame, Word.SNAPSHOT)
        if not wanted:
            self._skip_evidence = living
            return
        self._actions.append(TakeEvidence(self._life, self._story.id, living, self.policy.snapshot_budget_ms))

    def _close(self, now_ns: int, *, recovered: bool) -> None:
        if self._story is None:
            return
        # A stop in the middle of the probation does not undo a recovery: a proven core had served.
        served = self.wanted is Wanted.DOWN and self._story.proof is not None
        outcome = "recovered" if recovered or served else "manual"
        waits_for = None if recovered else self._hopeless
        self._actions.append(CloseIncident(self._story.told(outcome, now_ns, waits_for)))
        self._story = None
        self._stage_max = 0

    def _mark(self, name: str, at_ns: int) -> None:
        if self._story:
            self._story.mark(name, at_ns)

    def _alert(self, diagnosis: Diagnosis, text: str) -> None:
        if self.policy.asks(diagnosis, Word.SEND_ALERT):
            self._actions.append(Alert(diagnosis, text))

    def _alert_about(self, after: Phase) -> None:
        if after is Phase.UNKILLABLE:
            about = self._story.diagnosis if self._story else Diagnosis.OPERATOR
            text = (
                "The core was killed and is still there. No other is started beside it; the kill is repeated."
            )
            self._actions.append(Alert(about, text))
            return
        assert self._hopeless is not None, "FATAL is entered for a reason"
        self._alert(self._hopeless, "Automatic recovery has stopped. `hardcore resume` tries again.")
