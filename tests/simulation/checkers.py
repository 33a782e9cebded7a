"""The invariants: what must be true of every order, every move and every end.

The checkers know the truth of the world, which the guard does not: whether a process lives, whether a hang
was one, whether a command was being decided when its core died. They never ask the guard's own books.
"""

from collections import Counter
from typing import TYPE_CHECKING

from hardcore.model import actions as orders
from hardcore.model import observations as seen
from hardcore.model.phases import SERVING, Phase, Wanted
from hardcore.model.trials import SetAside
from hardcore.model.verdicts import Colour, Diagnosis
from hardcore.recovery import transitions, trial
from hardcore.recovery.budget import NS_PER_MS, NS_PER_S
from hardcore.recovery.policy import Word
from hardcore.recovery.reading import Reading, Transition
from hardcore.recovery.transitions import Step, Trigger
from tests.simulation import laws
from tests.simulation.conditions import WELL
from tests.simulation.consent import Consent
from tests.simulation.judges import Judges
from tests.simulation.laws import Broken, hold
from tests.simulation.looks import BEAT_NS, seen_of
from tests.simulation.machine import Life, Stage

if TYPE_CHECKING:  # the world owns its checkers
    from tests.simulation.guard import Guard
    from tests.simulation.workload import Request
    from tests.simulation.world import World

OUTCOMES = frozenset({"recovered", "manual", "safe_mode", "assist"})
#: What a restart would not help: the core lives on, and perhaps reads only.
TROUBLES = frozenset(
    {
        Diagnosis.DB_LOCKED,
        Diagnosis.DISK_FULL,
        Diagnosis.DISK_READ_ONLY,
        Diagnosis.DISK_STALLED,
        Diagnosis.STORE_CORRUPT,
    }
)
#: A death is counted when it is judged and checked when it is heard of: this much may lie between.
SLACK_NS = 3 * NS_PER_S
#: A fact is told so long after it became true.
HEARING_NS = 10 * NS_PER_MS
#: A core that can't be seen for so long is told to be so.
TOLD_NS = NS_PER_S
#: Whoever is sent away by these was judged by nobody.
_CHANGED = frozenset({Trigger.RENEW, Trigger.RESTART, Trigger.SHUTDOWN})
_BY_ITSELF = frozenset({Trigger.NO_DELAY, Trigger.DEADLINE})
#: The spare is looked at so often, and something may befall it in between.
SPARE_SEEN_MS = 400
DRILL_NS = 15 * NS_PER_S
#: A trouble that was over for so long is not told as a new one.
STALE_NS = 10 * NS_PER_S


class Checkers:
    """Looks at everything; raises `Broken` with the law in words."""

    def __init__(self, world: "World") -> None:
        self.world = world
        self.rows: set[tuple[Phase, Trigger]] = set()
        self.named: Counter[tuple[str, Diagnosis]] = Counter()
        self.closed: dict[str, str] = {}
        self.given_up: set[str] = set()
        self._deaths_ns: list[int] = []
        self._drill_ns = -DRILL_NS
        self.judges = Judges(world)
        self._forget_guard()

    def _forget_guard(self) -> None:
        self._phase = Phase.STOPPED
        self._spawned_ns = 0
        self._newest = 0
        self._ready: set[int] = set()
        self._spares: set[int] = set()
        self._undrained: set[int] = set()
        self._found = False  # this guard began with a core that it found serving
        self._exited: set[int] = set()
        self._evidence: dict[int, int] = {}
        self._taken: set[int] = set()
        self._judged: dict[int, Diagnosis] = {}
        self._sent_away: set[int] = set()
        self._renewed: set[int] = set()
        self._handed_over: set[int] = set()
        self._tick_ns = self._forgiven_ns = self._unseen_ns = self._silent_ns = 0
        self._counts = False  # whether the last end was an accident
        self._asked_by_operator = False
        self._consent = Consent()
        self._passed_on_seq = self._released = self._released_ns = 0
        self._way_in: Transition | None = None
        self._last: Trigger | None = None

    # ---- guards come and go ----

    def began(self, guard: "Guard") -> None:
        """A sentinel begins: nothing of its predecessor's is held against it but what is on disk."""
        del guard
        self.judges.began()
        self._forget_guard()

    def guard_died(self) -> None:
        """A sentinel died: its open incidents died with it, and perhaps the last line of its budget."""
        for guard in self.world.guards:
            self.given_up |= {name for name in guard.ids if name not in self.closed}
        kept = len(self.world.disk_deaths_ns)
        self._deaths_ns = self._deaths_ns[-kept:] if kept else []

    # ---- what the guard hears ----

    def heard(self, guard: "Guard", fact: seen.Observation) -> None:
        """Remember what the guard has been told."""
        match fact:
            case seen.CoreReady():
                self._ready.add(fact.life)
            case seen.CoreExited():
                self._heard_exit(guard, fact)
            case seen.SpawnFailed() if fact.life not in self._spares:
                self._counts = fact.life not in self._sent_away or fact.life in self._judged
                if self._counts and fact.life not in self._judged:
                    self._deaths_ns.append(fact.at_ns)
            case seen.EvidenceTaken():
                self._taken.add(fact.life)
            case seen.DrillStarted():
                self._drill_ns = fact.at_ns
            case seen.OperatorAsked():
                self._asked_by_operator = True
                self._consent.heard(fact)
                if fact.accept_ledger:
                    self._passed_on_seq = 0
            case seen.GatewayWitnessed():
                if self._phase in SERVING or self._phase not in {Phase.FATAL, Phase.STOPPED}:
                    self._passed_on_seq = max(self._passed_on_seq, fact.witness.seq)
            case _:
                self.judges.heard(fact)

    def _heard_exit(self, guard: "Guard", fact: seen.CoreExited) -> None:
        hold(fact.life not in self._exited, "a core ends once")
        self._exited.add(fact.life)
        life = guard.life
        if life is None or life.number != fact.life:
            return
        drilled = fact.at_ns - self._drill_ns < DRILL_NS
        by_itself = fact.life not in self._sent_away or fact.life in self._judged
        self._counts = (
            by_itself
            and not drilled
            and not laws.only_tried(self.world, life, ready=life.number in self._ready)
        )
        if self._counts and fact.life not in self._judged:  # a judged one was counted by its verdict
            self._deaths_ns.append(fact.at_ns)

    def looks(self, guard: "Guard", tick: seen.Sampled) -> None:
        """What the guard is about to be told of its core is remembered for the laws below."""
        gap_ns, self._tick_ns = tick.at_ns - self._tick_ns, tick.at_ns
        interval_ns = guard.policy.health_check_interval_ms * NS_PER_MS
        if gap_ns > 2 * interval_ns:  # what was before a tick of ours that came late says nothing
            self._forgiven_ns = tick.at_ns
        seen_ = tick.beats is not None and tick.process is not None
        self._unseen_ns = 0 if seen_ else self._unseen_ns or tick.at_ns
        loop_ns = tick.beats.loop_ns if tick.beats is not None else tick.at_ns
        self._silent_ns = tick.at_ns - max(loop_ns, self._forgiven_ns, self._released_ns)

    def looked(self, guard: "Guard", tick: seen.Sampled) -> None:
        """What can't be seen is told."""
        if self._unseen_ns and tick.at_ns - max(self._unseen_ns, self._forgiven_ns) >= TOLD_NS:
            blind = guard.phase in SERVING and guard.manager.reading().verdict.colour is Colour.GREEN
            hold(not blind, "a core that can't be seen is called well")

    # ---- where the guard goes ----

    def moved(self, guard: "Guard", moves: tuple[Transition, ...]) -> None:
        """Each change of phase is in the table, follows from the one before, and has a reason."""
        for move in moves:
            row = transitions.TABLE[move.before].get(move.trigger)
            if row is None or row[0] is not move.after:
                raise Broken(f"{move} is not in the table")
            if move.before is not self._phase:
                raise Broken(f"{move} does not follow from {self._phase}")
            hold(move.reason, "each move has a reason")
            self.rows.add((move.before, move.trigger))
            self._phase, self._last = move.after, move.trigger
            if move.after is not move.before:
                self._way_in = move
            if Step.FORGET in row[1]:
                self._deaths_ns.clear()
            if move.trigger is Trigger.NOT_DRAINED and guard.life is not None:
                self._undrained.add(guard.life.number)
            if move.trigger in _CHANGED and guard.life is not None:
                self._renewed.add(guard.life.number)
            if move.trigger is Trigger.TROUBLED:
                self._troubled(guard, Diagnosis(move.reason.split(":")[0]))
            self._consent.moved(guard.policy.mode, move)
            if move.trigger is Trigger.LOST:
                self._lost(guard, move)
            elif move.trigger is Trigger.UNPROVEN:
                self._judged[self._newest] = Diagnosis.STORE_CORRUPT
                self._count_verdict(move.at_ns)
            elif move.trigger is Trigger.DEADLINE and move.before in {Phase.STARTING, Phase.PROVING}:
                self._too_slow(guard)
            elif move.before is Phase.PROBATION and move.after is Phase.RUNNING:
                self._proven(guard)

    def _lost(self, guard: "Guard", move: Transition) -> None:
        """No core is judged that only was late: the truth must be a hang, and have lasted."""
        life = guard.life
        hold(life is not None and life.alive, "a verdict needs a living core")
        assert life is not None, "held just now"
        row = seen_of(life)
        needed_ms = row.judged.needs_ms(guard.policy)
        lasted_ns = move.at_ns - life.since_ns + BEAT_NS
        # Of the time before a look that came late, a tick's is counted; and a claim is told with the look before it.
        if self._forgiven_ns >= life.began_ns or life.condition.lies:
            lasted_ns += guard.policy.health_check_interval_ms * NS_PER_MS
        hold(
            needed_ms is not None and lasted_ns >= needed_ms * NS_PER_MS,
            f"a core that was {life.condition.name} for {lasted_ns // NS_PER_MS} ms was judged: {move.reason}",
        )
        diagnosis = Diagnosis(move.reason.split(":")[0])
        self.named[life.condition.name, diagnosis] += 1
        hold(
            diagnosis in row.right,
            f"a core that was {life.condition.name} was called {diagnosis}: {move.reason}",
        )
        self._judged[life.number] = diagnosis
        self._count_verdict(move.at_ns)
        life.asked, life.blamed = True, diagnosis in trial.FROM_INSIDE

    def _proven(self, guard: "Guard") -> None:
        silent_ms = self._silent_ns // NS_PER_MS
        borne_ms = guard.policy.health_check_timeout_ms + 2 * guard.policy.health_check_interval_ms
        hold(silent_ms < borne_ms, f"a core that has been silent for {silent_ms} ms has proven itself")

    def _troubled(self, guard: "Guard", diagnosis: Diagnosis) -> None:
        """A trouble is told only while it is there, or reads only are served; of one nobody may restart, too."""
        self.world.note_truths()
        name = guard.life.condition.name if guard.life is not None else "gone"
        right = guard.life.condition.right if guard.life is not None else frozenset()
        self.named[name if diagnosis in right else "its store", diagnosis] += 1
        since_ns = self.world.clock.now_ns - self.world.truths.get(diagnosis, -STALE_NS)
        hold(
            diagnosis in right or since_ns < STALE_NS or (guard.life is not None and guard.life.safe),
            f"{diagnosis} is told of a core that is {name}, {since_ns // NS_PER_MS} ms after it was so",
        )

    def _too_slow(self, guard: "Guard") -> None:
        waited_ns = self.world.clock.now_ns - self._spawned_ns
        needed_ns = guard.policy.startup_timeout_ms * NS_PER_MS - HEARING_NS
        hold(waited_ns >= needed_ns, "a boot has its whole time")
        self._judged[self._newest] = Diagnosis.STARTUP_FAILED
        self._count_verdict(self.world.clock.now_ns)
        if guard.life is not None and guard.life.number == self._newest:
            guard.life.asked = True

    def _count_verdict(self, at_ns: int) -> None:
        if at_ns - self._drill_ns >= DRILL_NS:
            self._deaths_ns.append(at_ns)

    def read(self, guard: "Guard", reading: Reading) -> None:
        """What is shown is true as far as the guard was told."""
        if reading.phase in SERVING:
            hold(reading.life in self._ready, "a phase that serves has a core that is ready")
            hold(reading.life not in self._exited, "a phase that serves has a living core")
            assert guard.life is not None, "held just now"
            hold(reading.epoch == guard.life.epoch, "the epoch shown is the serving core's")
        if reading.phase in {Phase.STOPPED, Phase.BACKOFF, Phase.FATAL}:
            hold(not self._living(), f"{reading.phase} is shown while a core lives")

    # ---- what the guard orders ----

    def ordered(self, guard: "Guard", action: orders.Action) -> None:
        """Each order is right at the moment it is given."""
        self.judges.ordered(action)
        self._consent.ordered(action)
        match action:
            case orders.Spawn():
                self._spawn(guard, action)
            case SetAside() if not action.letter.held and self._deaths_ns:
                self._deaths_ns.pop()  # what it explains is not held against anybody
            case orders.SpawnSpare():
                self._spawn_spare(guard, action)
            case orders.Promote():
                self._promote(guard, action)
            case orders.Adopt():
                self._ready.add(action.life)
                self._found = True
            case orders.Drain():
                self._renewed.add(action.life)
            case orders.Kill():
                self._kill(guard, action)
            case orders.Terminate():
                self._terminate(guard, action)
            case orders.TakeEvidence(living=True):
                self._evidence[action.life] = self.world.clock.now_ns
                if action.stop:
                    self._sent_away.add(action.life)  # it is stopped for good: its end is asked for
            case orders.SetSafe():
                laws.reads_only_for_a_reason(self.world, action)
            case orders.Release():
                self._release(guard, action)
            case orders.CloseIncident():
                self._close(guard, action.incident)
            case orders.Halt():
                hold(self.world.disk_wanted is Wanted.DOWN, "the guard ends only when nothing is wanted")
                hold(self._phase is Phase.UNKILLABLE or not self._living(), "it ends after its core")
            case _:
                pass

    def _living(self) -> list[Life]:
        """Who may write: no spare that waits, and nobody behind the fence."""
        return [
            life
            for life in self.world.lives
            if life.alive and not life.waits and not laws.behind(self.world, life)
        ]

    def _terminate(self, guard: "Guard", order: orders.Terminate) -> None:
        self._sent_away.add(order.life)
        core, spare = guard.numbered(order.life), self.world.spare
        if self._phase not in SERVING or guard.manager.wanted is Wanted.DOWN or core is None or core.unfenced:
            return
        starts = self.world.build not in self.world.bad_builds or core.build == self.world.build
        shown = spare is not None and spare.stage is Stage.WARM
        hold(starts or shown or core.drained, "no core makes room for code that does not start")

    def _spawn_spare(self, guard: "Guard", order: orders.SpawnSpare) -> None:
        own = [x for x in self.world.lives if x.alive and x.waits and x.guard == guard.number]
        hold(not own, "one spare at most")
        hold(guard.manager.wanted is not Wanted.DOWN, "no spare is started against the operator's will")
        hold(order.life not in self._exited | self._ready, "each life has a number of its own")
        self._spares.add(order.life)

    def _promote(self, guard: "Guard", order: orders.Promote) -> None:
        spare = guard.numbered(order.life)
        hold(spare is not None and spare.waits, "only a spare is promoted")
        assert spare is not None, "held just now"
        hold(spare.stage is Stage.WARM or not spare.alive, "only a spare that is ready is promoted")
        sick_ns = self.world.clock.now_ns - spare.since_ns if not spare.condition.loop_beats else 0
        borne_ms = guard.policy.health_check_timeout_ms + SPARE_SEEN_MS
        hold(sick_ns < borne_ms * NS_PER_MS, f"a spare that is {spare.condition.name} is promoted")
        stuck = [life for life in self._living() if life is not spare]
        hurried = order.busy_ms is not None
        hold(not stuck or (hurried and all(x.asked for x in stuck)), "nobody else is the core")
        hold(guard.manager.wanted is not Wanted.DOWN, "no core takes over against the operator's will")
        self._challenged(order.expected_epoch)
        self._spawned_ns, self._newest = self.world.clock.now_ns, order.life

    def _challenged(self, expected: int | None) -> None:
        known = expected in {None, self.world.store.epoch} or self.world.stranger_raised
        hold(known, f"a core is told to expect epoch {expected}")

    def _spawn(self, guard: "Guard", order: orders.Spawn) -> None:
        hold(not self._living(), "no core is started while another may live")
        hold(guard.life is None or order.life > guard.life.number, "each life has a number of its own")
        hold(guard.manager.wanted is not Wanted.DOWN, "no core is started against the operator's will")
        self._challenged(order.expected_epoch)
        self._consent.starts(guard.policy.mode)
        way = self._way_in
        by_itself = way is not None and way.before is Phase.BACKOFF and way.trigger in _BY_ITSELF
        if by_itself and self._counts:
            since_ns = self.world.clock.now_ns - guard.policy.restart_window_sec * NS_PER_S + SLACK_NS
            recent = [at_ns for at_ns in self._deaths_ns if at_ns > since_ns]
            hold(len(recent) <= guard.policy.max_restart_count, "restarts stay within the budget")
        reads = laws.may_be_read_for(self.world, order.safe) or self._consent.reads(order.safe)
        hold(reads, f"{order.safe} was never the matter")
        self._spawned_ns, self._newest = self.world.clock.now_ns, order.life

    def _kill(self, guard: "Guard", order: orders.Kill) -> None:
        life = guard.life
        self._sent_away.add(order.life)
        if life is None or life.number != order.life or not life.alive:
            return
        if (diagnosis := self._judged.get(order.life)) is None:
            served_nobody = life.spare and life.stage is not Stage.READY  # it did not take over
            word = self._asked_by_operator or self.world.disk_shut is not None  # the policy's shut it
            changed = order.life in self._renewed or served_nobody
            hold(word or changed, "a living core is killed for a verdict, by a word, or to be changed")
            return
        if not guard.policy.asks(diagnosis, Word.SNAPSHOT):
            return
        at_ns = self._evidence.get(order.life)
        hold(at_ns is not None, "evidence comes before the kill")
        waited_ns = self.world.clock.now_ns - (at_ns or 0)
        spent = waited_ns >= guard.policy.snapshot_budget_ms * NS_PER_MS
        hold(order.life in self._taken or spent, "evidence has its whole budget")

    def _release(self, guard: "Guard", order: orders.Release) -> None:
        life = guard.life
        self._silent_ns = self._unseen_ns = 0  # of another core
        self._released_ns = self.world.clock.now_ns
        hold(life is not None and life.number == order.life, "the newest core is released")
        assert life is not None, "held just now"
        hold(order.life in self._ready and life.completed_boot, "a core is released after its proof")
        hold(order.life not in self._exited, "no dead core is released")
        hold(order.epoch == life.epoch, "a core is released with the epoch it raised")
        hold(not life.drained, "a core that has let go of the store serves nobody")
        newest = life.epoch == self.world.store.epoch or self.world.stranger_raised
        hold(newest or not life.alive, "a core is released under the store's epoch")
        again = order.life == self._released
        hold(
            life.safe or again or self._found or guard.manager.wanted is not Wanted.SAFE,
            "nobody is sent to a core that takes writes while the operator wants reads only",
        )
        self._consent.serves(again=order.life == self._released)
        told = life.unfenced or self._passed_on_seq <= len(self.world.store.commits)
        again, self._released = order.life == self._released, order.life
        hold(told or again, "no ledger is served that lacks what a client was told of")
        hold([x for x in self._living() if x is not life] == [], "one core at a time")

    def _close(self, guard: "Guard", told: orders.Incident) -> None:
        hold(told.id in guard.ids, f"{told.id} was never opened")
        hold(told.id not in self.closed, f"{told.id} is closed twice")
        hold(told.outcome in OUTCOMES, f"{told.outcome!r} is no outcome")
        aside = told.planned and not told.deaths and any(one.witness == "parts" for one in told.evidence)
        hold(aside or self._last is not Trigger.READY, "nothing is over the moment that a core is ready")
        # What a person is needed for is handed over while reads are served.
        reads = told.outcome == "safe_mode" and told.waits_for is not None
        handed_over = reads or told.waits_for is Diagnosis.STORE_CORRUPT
        over = handed_over or self._phase in {Phase.FATAL, Phase.STOPPED, Phase.UNKILLABLE}
        hold(
            told.outcome in {"recovered", "safe_mode", "assist"} or over,
            "nothing is given up while somebody still tries",
        )
        # A core that was proven and released ends the story too, even if it dies before it has lasted: its
        # death is the next one.
        restarts = guard.policy.asks(told.diagnosis, Word.REBOOT_PROCESS)
        unwatched = told.diagnosis is Diagnosis.SENTINEL_LOST and not told.deaths and self._found
        troubled = not (told.deaths or told.planned) and (unwatched or not restarts)
        same = aside or (told.planned and not told.deaths and told.life in self._undrained)
        left = told.outcome == "assist"
        served = (
            troubled
            or same
            or left
            or (told.outcome in {"recovered", "safe_mode"} and told.next_epoch is not None)
        )
        hold(over or served, "an incident is over when a proven core has served")
        steps = dict(told.timeline)
        hold({"fault", "detected", "closed"} <= set(steps), "each incident says when it began and ended")
        hold(steps["fault"] <= steps["detected"] <= steps["closed"], "nothing is found before it is there")
        if told.diagnosis in TROUBLES:
            hold(told.diagnosis in self.world.truths, f"{told.diagnosis} was never the matter")
        if told.outcome == "recovered" and not same and (told.deaths or told.planned):
            hold(told.proof is not None and told.next_epoch, "recovered means proven, in a new epoch")
            hold(bool(self._ready - {told.life}), "recovered means that a successor served")
        hold(
            told.planned or told.deaths or troubled or left or self._consent.shut,
            "an incident nobody planned has a death or a trouble",
        )
        self.closed[told.id] = told.outcome
        if told.diagnosis is Diagnosis.STORE_CORRUPT and not (told.deaths or told.planned):
            hold(told.life not in self._handed_over, "one damage is told once of one core")
        if handed_over and guard.life is not None:
            self._handed_over.add(guard.life.number)

    # ---- the ledger and its clients ----

    def replayed(self, request: "Request") -> None:
        """The gateway runs a lost request again."""
        hold(not request.suspect or request.excused, f"suspect {request.command_id} is run again")

    def forwarded(self, request: "Request") -> None:
        """The gateway sends a request to a core."""
        self.judges.forwarded(request)

    def at_end(self) -> None:
        """In the quiet at the end everything is as wanted, told and true."""
        self.judges.at_end()
        world, guard = self.world, self.world.guard
        living = self._living()
        if world.disk_wanted is Wanted.DOWN:
            hold(guard.halted, "a guard that is not wanted ends")
            waiting = any(life.alive and life.waits for life in world.lives)
            hold(not (living or waiting) or world.stuck_for_ever, "a core that is not wanted ends")
        elif guard.phase is Phase.RUNNING or (guard.phase is Phase.SUSPECT and guard.always_worried):
            well = guard.life is not None and guard.life.alive and guard.life.condition is WELL
            hold(well and guard.life is not None and guard.life.stage is Stage.READY, "what runs, serves")
            laws.writes_again(world, guard)
        elif guard.phase is Phase.UNKILLABLE:
            hold(world.stuck_for_ever and living, "UNKILLABLE lasts only while a core does not die")
        else:
            hold(guard.phase is Phase.FATAL, f"the guard came to rest in {guard.phase}")
            hold(self._way_in is not None and self._way_in.reason, "FATAL has a reason")
            waits_for = guard.manager.reading().waits_for
            hold(waits_for != Diagnosis.DB_LOCKED, "a lock that was let go is waited for for ever")
        laws.nobody_is_left(world, guard)
        self._incidents_at_end()
        laws.ledger_is_true(world)

    def _incidents_at_end(self) -> None:
        for guard in self.world.guards:
            for name in [one for one in guard.ids if one not in self.judges.letters]:
                done = name in self.closed or name in self.given_up
                here = guard is self.world.guard
                damaged = guard.phase in SERVING and Diagnosis.STORE_CORRUPT in self.world.truths
                still = here and (guard.phase is Phase.UNKILLABLE or damaged)
                hold(done or still, f"incident {name} is open in the quiet")
