"""The guard's shell in the simulation: one sentinel process with the real pure middle in it.

It does what the runtime and the executor do: feeds facts, rings the deadline, carries out orders with
delays, and can be stalled or killed at any moment, also between two orders. Everything it was told is kept,
so that a second manager can be asked the same questions. Facts that waited are heard before the deadline.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING

from msgspec.structs import replace

from hardcore.model import actions as orders
from hardcore.model import observations as seen
from hardcore.model.clocks import Clocks
from hardcore.model.phases import SERVING, Phase, Wanted
from hardcore.model.recorder import Beats, CommandNote, SlotStage
from hardcore.model.verdicts import Colour, Diagnosis
from hardcore.recovery.failover import FailoverManager
from hardcore.recovery.policy import Policy
from hardcore.recovery.spare import Lack
from tests.simulation import hands
from tests.simulation.clock import NS_PER_MS, NS_PER_S
from tests.simulation.conditions import FROZEN, WELL
from tests.simulation.court import Courtroom
from tests.simulation.looks import THREADS, beats, notes, page, parts, process
from tests.simulation.machine import Life, Stage
from tests.simulation.store import Disk
from tests.simulation.surveyor import Surveyor
from tests.simulation.switches import Taking

if TYPE_CHECKING:  # the world starts guards
    from tests.simulation.world import World

#: As the watch of the real guard: threads and commands are looked at only when something waits.
STALE_NS = 80 * NS_PER_MS
LOOK_CLOSER_NS = 200 * NS_PER_MS
IN_FLIGHT_EVERY_TICKS = 5
TICKS_AT_LEAST = 3
#: How often the spare is looked at.
GLANCE_NS = 300 * NS_PER_MS
HANDS_NS = 20 * NS_PER_MS
#: The real guard stamps a fact when it notices it: one that waited longer than this gets a new stamp.
NOTICED_NS = 5 * NS_PER_MS


class Guard:
    """One sentinel process."""

    def __init__(
        self, world: "World", number: int, policy: Policy, wanted: Wanted, deaths_ns: tuple[int, ...]
    ) -> None:
        self.world = world
        self.number = number
        self.policy = policy
        self.born_with = (policy, wanted, deaths_ns)
        self.manager = FailoverManager(policy, wanted, self._new_id, self._jitter, deaths_ns)
        self.alive = True
        self.halted = False
        self.awake_ns = 0
        self.life: Life | None = None
        self.phase = Phase.STOPPED
        self.heard: list[seen.Observation | int] = []
        self.ordered: list[orders.Action] = []
        self.ids: list[str] = []
        self.jitters: list[float] = []
        self._lives: dict[int, Life] = {}
        self._spawning: dict[int, orders.Spawn | orders.SpawnSpare] = {}
        self.adopts: Life | None = None
        self.condemned: set[int] = set()  # serials of cores that it had begun to end or to drain
        self._glanced_ns = self._spare = 0
        self._leftovers: set[int] = set()
        self._was_spawning = False
        self._found: list[Life] = []
        self._waits_for_leftovers = False
        self._surveyor = Surveyor(self)
        self.courtroom = Courtroom(self)
        self._one_is_slow = False
        self._ringing_ns: int | None = None
        self._ticking = False
        self._ticks_left = 0
        self._ticks = 0

    def _new_id(self) -> str:
        self.ids.append(f"g{self.number}-{len(self.ids) + 1}")
        return self.ids[-1]

    def _jitter(self) -> float:
        self.jitters.append(self.world.rng.random())
        return self.jitters[-1]

    @property
    def works(self) -> bool:
        """Whether this sentinel still decides anything."""
        return self.alive and not self.halted

    # ---- hearing ----

    def tell(self, fact: seen.Observation, wait_ns: int = NS_PER_MS) -> None:
        """Have a fact reach the manager, `wait_ns` from now."""
        self.world.clock.after(wait_ns, lambda: self.hear(fact))

    def hear(self, fact: seen.Observation) -> None:
        """Give a fact to the manager, unless we are asleep: then when we wake up."""
        if not self.works:
            return
        if self.world.clock.now_ns < self.awake_ns:
            self.world.clock.at(self.awake_ns, lambda: self.hear(fact))
            return
        if self.world.clock.now_ns - fact.at_ns > NOTICED_NS:
            fact = replace(fact, at_ns=self.world.clock.now_ns)
        self._glance()
        if isinstance(fact, seen.Drained) and not fact.done:
            self._with(fact.life, lambda life: self.condemned.discard(life.serial))
        self.heard.append(fact)
        self.world.checkers.heard(self, fact)
        self.manager.receive(fact)
        self.policy = self.manager.policy
        self._pump()
        if isinstance(fact, seen.CoreExited | seen.SpawnFailed) and self.works:
            self.watch_if_needed()  # it was the spare, or one that was left behind

    def _ring(self, due_ns: int) -> None:
        if not self.works or self.manager.next_deadline_ns() != due_ns:
            return
        now_ns = self.world.clock.now_ns
        if now_ns < self.awake_ns:
            self.world.clock.at(self.awake_ns + 1, lambda: self._ring(due_ns))
            return
        self._glance()
        self.heard.append(now_ns)
        self.manager.handle_deadline(now_ns)
        self._ringing_ns = None
        self._pump()

    def _pump(self) -> None:
        """Take what the manager has to say, in order."""
        given, moves = self.manager.take_actions(), self.manager.take_transitions()
        self.ordered.extend(given)
        if moves:
            self.phase = moves[-1].after
            self.world.checkers.moved(self, moves)
        for action in given:
            if self.world.switches.guard_dies_now():
                self.world.kill_guard()
                return
            self.world.checkers.ordered(self, action)
            self._carry_out(action)
        if moves:
            reading = self.manager.reading()
            self.world.checkers.read(self, reading)
            self.world.gateway.show(reading.face)
            if self.phase in SERVING:
                self.watch_if_needed()
        due_ns = self.manager.next_deadline_ns()
        if due_ns is not None and due_ns != self._ringing_ns and self.works:
            self._ringing_ns = due_ns
            self.world.clock.at(due_ns, lambda: self._ring(due_ns))

    # ---- the watch ----

    def _glance(self) -> None:
        """Look at the spare, as often as the real guard: at quiet times only when something is about to be heard."""
        number, now_ns = self._spare, self.world.clock.now_ns
        life = self._lives.get(number)
        if life is None or not life.alive or now_ns - self._glanced_ns < GLANCE_NS:
            return
        self._glanced_ns = now_ns
        tick = seen.Sampled(now_ns, number, beats(life), THREADS, process(life, closer=False))
        self.heard.append(tick)
        self.manager.receive(tick)

    def watch(self, ticks: int = TICKS_AT_LEAST) -> None:
        """Look at the core every tick, at least so many times, and until it is well."""
        self._ticks_left = max(self._ticks_left, ticks)
        if not self._ticking and self.works:
            self._ticking = True
            self._tick()

    def watch_if_needed(self) -> None:
        """Begin to watch a core that is not well, or that is to have a spare."""
        if self.life is not None and self.life.alive and self.life.condition is not WELL:
            self.watch()
        elif self._wants_spare():
            self.watch(1)

    def _tick(self) -> None:
        now_ns = self.world.clock.now_ns
        if self.works and now_ns < self.awake_ns:
            self.world.clock.at(self.awake_ns, self._tick)
            return
        life = self.life
        self._ticking = self.works and self.phase in SERVING and life is not None and life.alive
        if not self._ticking or life is None:
            return
        self._ticks += 1
        self._surveyor.look(life, self._ticks)
        tick = self._look(life, now_ns)
        self.world.checkers.looks(self, tick)
        self.hear(tick)
        if self.works:
            self.world.checkers.looked(self, tick)
        self._ticks_left -= 1
        if self._is_sick(life) or self._ticks_left > 0 or self._suspects() or self._wants_spare():
            self.world.clock.after(self._interval_ns(), self._tick)
        else:
            self._ticking = False

    def _interval_ns(self) -> int:
        return self.policy.health_check_interval_ms * NS_PER_MS + self.world.switches.late_ns(self._ticks)

    def _suspects(self) -> bool:
        """Whether the guard looks for what is wrong. Some worries never end; but a probation does."""
        if self.phase is Phase.SUSPECT:
            return not (self.world.quiet and self.always_worried)
        unproven = self.phase is Phase.PROBATION
        return unproven and self.manager.reading().verdict.colour is not Colour.GREEN

    def _wants_spare(self) -> bool:
        """Whether a spare is to come, or to be ended."""
        told = self.manager.reading()
        wants = self.policy.spare or told.switch_waits or told.spare
        if not (self.world.warm and wants and self.phase in {Phase.RUNNING, Phase.SUSPECT}):
            return False
        spare = self._lives.get(self._spare)
        if spare is not None and spare.alive:  # its word comes by itself, unless something is the matter
            late = spare.stage is Stage.BORN and (spare.plan.hangs or spare.plan.fence_ns > NS_PER_S)
            return spare.condition is not WELL or late
        never = told.spare_lack in {Lack.OFF, Lack.MEMORY} or told.spare_lost
        may = told.switch_updates or not (never or told.safe not in {None, Diagnosis.OPERATOR})
        return may and told.behind is None and self._spare not in self._spawning

    @property
    def always_worried(self) -> bool:
        """Whether there is something to be worried about to the end of the world: our ticks, or a lost page."""
        life = self.life
        doomed = life is not None and (life.page_lost or (life.safe and self._damaged))
        return bool(self.world.switches.late_every or doomed)

    @property
    def _damaged(self) -> bool:
        """Whether the ledger is known to be, so that nothing goes on before a person comes."""
        told = Diagnosis.STORE_CORRUPT in self.world.truths
        return told and self.manager.reading().safe in {None, Diagnosis.STORE_CORRUPT}

    def _is_sick(self, life: Life) -> bool:
        """Whether the next tick may matter: only then it is simulated.

        A damaged ledger is read until a person comes: no tick changes that.
        """
        world, store = self.world, self.world.store
        open_ = world.checkers.judges.last_incident(self.ids) not in {"", *world.checkers.closed}
        damaged = self._damaged
        return bool(
            life.condition is not WELL
            or life.extra_waiting
            or life.part_stalled_ns
            or life.rss_bytes > self.policy.memory_limit_mb << 20
            or (life.page_lost and not world.quiet)
            or world.clock.now_ns < world.unseen_until_ns
            or life.in_store_ns
            or store.blocked
            or store.disk is not Disk.WELL
            or (not damaged and ((life.safe and world.disk_wanted is not Wanted.SAFE) or open_))
        )

    def _look(self, life: Life, now_ns: int) -> seen.Sampled:
        world, beats = self.world, self.world.spoilt.look(life)
        flying = self._in_flight(life, beats, now_ns)
        closer = (
            beats is None or flying is not None or now_ns - min(beats.loop_ns, beats.thread_ns) > STALE_NS
        )
        clocks = Clocks(now_ns + world.slept_ns, now_ns + world.slept_ns + world.wall_shift_ns)
        unseen = now_ns < world.switches.unseen_until_ns
        sample = None if unseen else process(life, closer=closer)
        witness = None if beats is None else life.witness
        told = seen.Sampled(now_ns, life.number, beats, THREADS, sample, flying, witness, clocks)
        return replace(told, components=parts(life)) if beats is not None else told

    def _in_flight(self, life: Life, beats: Beats | None, now_ns: int) -> tuple[CommandNote, ...] | None:
        """The commands in flight, as often as the real guard reads them."""
        if beats is None or not beats.waiting:
            self._one_is_slow = False
            return None
        due = self._one_is_slow or self._ticks % IN_FLIGHT_EVERY_TICKS == 0
        if not due and now_ns - beats.completed_ns <= LOOK_CLOSER_NS:
            return None
        told = notes(life)
        self._one_is_slow = any(
            note.stage is SlotStage.DECIDING
            and now_ns - max(note.stage_ns, note.progress_ns) > LOOK_CLOSER_NS
            for note in told
        )
        return told

    # ---- the hands ----

    def _carry_out(self, action: orders.Action) -> None:
        soon = self.world.rng.randrange(1, 5) * NS_PER_MS
        match action:
            case orders.Spawn():
                self._spawning[action.life] = action
                self.soon(self.world.switches.spawn_takes_ns(), lambda: self._spawn(action))
            case orders.SpawnSpare():
                self._spare = action.life
                self._spawning[action.life] = action
                self.soon(self.world.switches.spawn_takes_ns(), lambda: self._spawn(action))
            case orders.Promote(life=number):
                self.life, self._spare = self._lives[number], 0
                self.soon(soon, lambda: self._with(number, lambda life: life.promote(action)))
            case orders.Drain(life=number):
                self._condemn(number)
                self.soon(soon, lambda: self._with(number, lambda life: hands.drain(self, life, action)))
            case orders.Adopt():
                self._adopt(action.life)
            case orders.Terminate(life=number):
                self._condemn(number)
                self.soon(soon, lambda: self._with(number, Life.terminate))
            case orders.Kill(life=number):
                self._condemn(number)
                self.soon(soon, lambda: self._with(number, _kill))
            case orders.KillLeftovers():
                self.soon(soon, self._kill_leftovers)
            case orders.TakeEvidence():
                if action.stop and action.living:
                    self._condemn(action.life)
                self.soon(soon, lambda: self._stop_for_evidence(action))
            case orders.Release():
                life = self._lives.get(action.life)
                assert life is not None, "released is a core that exists"
                self.world.gateway.release(action, life)
            case orders.KeepBudget():
                self.world.disk_deaths_ns, self.world.disk_shut = action.deaths_ns, action.shut
            case orders.Halt():
                self._end()
            case orders.SampleStacks(life=number):
                self._with(number, self._surveyor.look_at_stacks)
            case orders.LookAtStore(life=number):
                holder = self.world.store.holder
                told = (holder,) if holder is not None else ()
                self.tell(seen.StoreLooked(self.world.clock.now_ns, number, told), soon)
            case orders.SetSafe(life=number):
                self._with(number, lambda life: hands.set_safe(self, life, action))
            case orders.RestartComponent(life=number):
                self.soon(
                    soon, lambda: self._with(number, lambda life: hands.restart_part(self, life, action.name))
                )
            case orders.CloseIncident() | orders.AddAudit() | orders.Alert():
                pass  # the checkers have looked at it
            case _:
                self.courtroom.carry_out(action)

    def _end(self) -> None:
        """End as asked, but not before the hands have finished."""
        if self._spawning:
            self._was_spawning = True
            self.world.clock.after(HANDS_NS, self._end)
        elif self._was_spawning:  # what was made is heard of, and what is said to that is done
            self._was_spawning = False
            self.world.clock.after(HANDS_NS, self._end)
        elif self.works:
            self.halted = True
            self.world.guard_halted()

    def soon(self, wait_ns: int, deed: Callable[[], None]) -> None:
        """Do it later, if this sentinel lives to do it."""

        def do() -> None:
            if self.alive:
                deed()

        self.world.clock.after(wait_ns, do)

    def _with(self, number: int, deed: Callable[[Life], None]) -> None:
        """Do something to a core; an order for one that was never made is lost, as in the real executor."""
        life = self._lives.get(number)
        if life is not None:
            deed(life)

    def numbered(self, number: int) -> Life | None:
        """A core or a spare of this guard's, by its number."""
        return self._lives.get(number)

    def _condemn(self, number: int) -> None:
        self._with(number, lambda life: self.condemned.add(life.serial))

    def _adopt(self, number: int) -> None:
        life = self.adopts
        assert life is not None, "only a core that was found is adopted"
        self.life = self._lives[number] = life
        life.guard, life.number = self.number, number
        life.asked = life.blamed = False  # what the guard before had in mind nobody knows
        if not life.alive:  # it died in the moment that it was found
            self.died(life)

    def _spawn(self, order: orders.Spawn | orders.SpawnSpare) -> None:
        del self._spawning[order.life]
        now_ns = self.world.clock.now_ns
        if self.world.switches.spawn_fails():
            self.tell(seen.SpawnFailed(now_ns, order.life, "no more processes"))
            return
        if isinstance(order, orders.SpawnSpare):
            life = self.world.make_life(order.life, None, spare=True)
        else:
            life = self.life = self.world.make_life(order.life, order.expected_epoch, order.safe)
        self._lives[order.life] = life
        self.tell(seen.CoreSpawned(now_ns, order.life, 1000 + life.serial))

    def lose_spawns(self) -> list[bool]:
        """This sentinel died; return of each of its spawns that was under way whether it was a spare's."""
        under_way, self._spawning = list(self._spawning.values()), {}
        return [isinstance(order, orders.SpawnSpare) for order in under_way]

    def _kill_leftovers(self) -> None:
        """End what was there before us; told again, the hands kill again, and one waiting is enough."""
        living = [life for life in self.world.lives if life.alive and life.guard != self.number]
        first, self._waits_for_leftovers = not self._waits_for_leftovers, True
        if first:
            self._leftovers, self._found = {life.serial for life in living}, living
        for life in living:
            _kill(life)
        if not living and first:
            self._leftovers_gone()

    def _leftovers_gone(self) -> None:
        pages = [left for life in self._found if (left := page(life)) is not None]
        last = max(pages, key=lambda left: left.beats.epoch, default=None)
        self.tell(seen.CoreExited(self.world.clock.now_ns, 0, seen.Exit(signal=9), last))

    def died(self, life: Life) -> None:
        """A core's pidfd became readable."""
        if life.serial in self._leftovers:
            self._leftovers.discard(life.serial)
            if not self._leftovers:
                self._leftovers_gone()
        elif life.guard == self.number:
            assert life.exit is not None, "a dead core has an end"
            how = seen.Exit() if life.status_lost else life.exit
            now_ns = self.world.clock.now_ns
            self.tell(seen.CoreExited(now_ns, life.number, how, page(life), life.oom_kills))

    def _stop_for_evidence(self, order: orders.TakeEvidence) -> None:
        life = self._lives.get(order.life)
        if life is None:
            self.tell(seen.EvidenceTaken(self.world.clock.now_ns, order.life, complete=False, page=None))
            return
        if order.living and order.stop and life.alive and not life.in_kernel:
            life.befall(FROZEN)
        took_ns = self._evidence_takes_ns(life, order)
        if took_ns is not None:
            self.soon(took_ns, lambda: self._evidence_taken(life, stopped=order.stop))

    def _evidence_takes_ns(self, life: Life, order: orders.TakeEvidence) -> int | None:
        """How long the evidence takes; None: it never comes."""
        rng = self.world.rng
        in_time = rng.randrange(20, order.budget_ms + 1) * NS_PER_MS
        match self.world.switches.taking():
            case Taking.IN_TIME:
                return in_time
            case Taking.LATE:
                return (order.budget_ms + rng.randrange(200, 3000)) * NS_PER_MS
            case Taking.NEVER:
                return None
            case Taking.DIES if order.stop:
                self.world.clock.after(rng.randrange(50) * NS_PER_MS, lambda: life.signal(9))
                return in_time
            case Taking.DIES:
                return in_time

    def _evidence_taken(self, life: Life, *, stopped: bool) -> None:
        now_ns = self.world.clock.now_ns
        fact = seen.EvidenceTaken(now_ns, life.number, complete=True, page=page(life), stopped=stopped)
        self.tell(fact)


def _kill(life: Life) -> None:
    life.asked = True
    life.signal(9)
