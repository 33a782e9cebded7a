"""One run: a world from a seed, a chaos, a quiet, an audit. The same seed is the same run, always."""

import dataclasses
from collections import Counter
from dataclasses import dataclass, field
from functools import partial
from itertools import count
from random import Random

from hardcore.model.actions import Action
from hardcore.model.phases import Phase
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.failover import FailoverManager
from hardcore.recovery.flight import CODEC, orders_told, resume, state_of
from hardcore.recovery.policy import Policy, Word
from hardcore.recovery.transitions import Trigger
from tests.simulation.clock import NS_PER_MS, NS_PER_S
from tests.simulation.faults import FAULTS, LOAD
from tests.simulation.guard import Guard
from tests.simulation.laws import Broken
from tests.simulation.quiet import calm_down
from tests.simulation.world import World

DEEDS_MAX = 10_000
#: So many worlds are of the newer kind: one of the policies there keeps no spare.
WARM = 0.75
#: A world whose core never dies is looked at once in so many deeds.
REST_EVERY = 2_000
#: In one of so many worlds a second manager is asked the same, and takes over what the first remembers in the
#: middle: as dear as the run itself. The moment is one of the first so many facts.
TWIN_EVERY = 8
CHANGES_AT = 200

_TELL = frozenset({Word.SEND_ALERT, Word.REBOOT_PROCESS})

#: Half of all runs use the shipped policy; the others make rare ways common.
POLICIES = (
    Policy(),
    Policy(
        probation_ms=300,
        max_restart_count=2,
        restart_window_sec=15,
        slow_retry_sec=5,
        trial_limit=2,
        startup_timeout_ms=2000,
        memory_image="on_request",
        await_operator_sec=3,
        on_await_timeout=("SEND_ALERT", "REBOOT_PROCESS"),
    ),
    Policy(
        actions=dict.fromkeys((Diagnosis.FROZEN, Diagnosis.LOOP_BLOCKED), _TELL),
        slow_retry_sec=0,
        memory_image="always",
    ),
    Policy(
        restart_delay_ms=200,
        max_restart_count=1,
        spare=False,
        actions={Diagnosis.CRASH_LOOP: frozenset({Word.SEND_ALERT, Word.SAFE_MODE_ENTER})},
        await_operator_sec=4,
        on_await_timeout=("SEND_ALERT", "SAFE_MODE_ENTER"),
        stop_timeout_ms=100,
        kill_timeout_ms=100,
        survey_interval_ms=1900,
    ),
    Policy(
        probation_ms=0,
        await_operator_sec=5,
        on_await_timeout=("SEND_ALERT", "SHUTDOWN"),
        actions={
            Diagnosis.CRASHED: frozenset({Word.SEND_ALERT, Word.AWAIT_OPERATOR}),
            Diagnosis.NO_PROGRESS: frozenset({Word.SEND_ALERT}),
        },
    ),
    Policy(max_restart_count=1000, probation_ms=0),  # no world is of this kind by chance
)


@dataclass(frozen=True, slots=True)
class Script:
    """What will happen to a world: its kind, its policy, and each fault by name with its moment.

    `warm`: a spare may be kept, and a guard goes on with what an earlier one left.
    """

    kind: str
    policy: int
    faults: tuple[tuple[int, str], ...] = ()
    warm: bool = False


@dataclass(slots=True)
class Result:
    """What one run has shown. `broken`: the law that did not hold, or None."""

    seed: int
    script: Script
    broken: str | None = None
    faults: Counter[tuple[str, Phase]] = field(default_factory=Counter)
    rows: set[tuple[Phase, Trigger]] = field(default_factory=set)
    named: Counter[tuple[str, Diagnosis]] = field(default_factory=Counter)
    story: list[str] = field(default_factory=list)
    deaths: int = 0  # from inside, of cores that had served
    unseen: int = 0  # of them, those of which nobody could read how
    convicted: Counter[str] = field(default_factory=Counter)
    letters: int = 0

    def __str__(self) -> str:
        return f"seed {self.seed} ({self.script.kind}): {self.broken}. Again: make simulate SEED={self.seed}"


def write_script(seed: int, only: tuple[str, ...] = ()) -> Script:
    """Return the script of a seed; with `only` a crisis of these faults."""
    rng = Random(f"script {seed}")
    dice = rng.random()
    kind = "crisis" if only else "fault-free" if dice < 0.04 else "load only" if dice < 0.2 else "crisis"
    policy = max(0, rng.randrange(8) - 3)
    warm = rng.random() < WARM
    if kind == "fault-free":
        return Script(kind, policy, warm=warm)
    names = list(only or (FAULTS if kind == "crisis" else LOAD))
    faults, at_ms = [], rng.randrange(1500)
    for _ in range(rng.randrange(1, 8)):
        faults.append((at_ms, rng.choice(names)))
        # Often one fault in the middle of another's recovery, sometimes after it.
        at_ms += rng.choice([5, 60, 400, 1500, 8000]) * rng.randrange(1, 100) // 50
    return Script(kind, policy, tuple(faults), warm)


def run(seed: int, script: Script | None = None, *, tell: bool = False) -> Result:
    """Run one seed, or a script with the chances of this seed; with `tell` the result carries the story."""
    script = script or write_script(seed)
    policy = POLICIES[script.policy]
    if script.kind != "crisis":  # a boot under load has the shipped time, whatever else is made common
        policy = dataclasses.replace(policy, startup_timeout_ms=Policy().startup_timeout_ms)
    if not script.warm:
        policy = dataclasses.replace(policy, spare=False)
    world, result = World(seed, policy, warm=script.warm), Result(seed, script)
    for at_ms, name in script.faults:
        world.clock.after(at_ms * NS_PER_MS, partial(_strike, world, result, name, tell))
    try:
        _play(world, Random(f"play {seed}"))
        world.checkers.at_end()
        if script.kind != "crisis":
            _nobody_was_hurt(world)
        if seed % TWIN_EVERY == 0:
            for guard in world.guards:
                _same_answers(guard, seed // TWIN_EVERY % CHANGES_AT)
    except AssertionError as broken:
        result.broken = f"{type(broken).__name__}: {broken}"
    result.rows, result.named = world.checkers.rows, world.checkers.named
    inside = [life for life in world.lives if life.inside and life.completed_boot]
    result.deaths, result.unseen = len(inside), sum(life.status_lost for life in inside)
    result.convicted, result.letters = world.checkers.judges.convicted, len(world.checkers.judges.letters)
    if tell:
        result.story.extend(_story(world))
    return result


def _strike(world: World, result: Result, name: str, tell: bool) -> None:
    if world.quiet:
        return
    result.faults[name, world.guard.phase] += 1
    if tell:
        result.story.append(f"{_ms(world):>9} ms  ! {name} in {world.guard.phase}")
    FAULTS[name](world)


def _rests_in_vain(world: World) -> bool:
    """The kill of a core that never dies is repeated for ever: that is its rest."""
    return (
        world.quiet
        and world.stuck_for_ever
        and (world.guard.phase is Phase.UNKILLABLE or world.guard.manager.reading().behind is not None)
    )


def _ms(world: World) -> int:
    return (world.clock.now_ns - 1_000 * NS_PER_S) // NS_PER_MS


def _play(world: World, rng: Random) -> None:
    world.begin_guard()
    for number in range(rng.randrange(4, 14)):
        keyed = rng.random() < 0.9
        at_ns = rng.randrange(12_000) * NS_PER_MS
        world.clock.after(at_ns, partial(world.gateway.submit, f"key-{number}", keyed=keyed))
    world.clock.after(rng.randrange(4, 25) * NS_PER_S, partial(calm_down, world))
    for deeds in count():
        if not world.clock.step():
            return
        if deeds % REST_EVERY == 0 and _rests_in_vain(world):
            return
        if deeds > DEEDS_MAX:
            raise Broken(f"no rest after {deeds} deeds, in {world.guard.phase}")


def _nobody_was_hurt(world: World) -> None:
    """Without a fault that hurts, nothing is killed, and nothing is told as an incident."""
    if len([life for life in world.lives if life.completed_boot]) != 1 or world.checkers.closed:
        raise Broken("a core was replaced in a world without a crisis")


def _same_answers(guard: Guard, changes_at: int) -> None:
    """The same facts give the same orders, also of one who was told in the middle what the other remembers."""
    born, wanted, deaths_ns = guard.born_with
    ids, jitters = iter(guard.ids), iter(guard.jitters)

    def another(policy: Policy) -> FailoverManager:
        return FailoverManager(policy, wanted, lambda: next(ids), lambda: next(jitters), deaths_ns)

    twin = another(born)
    given: list[Action] = []
    for number, fact in enumerate(guard.heard):
        if number == changes_at:
            state = CODEC.decode(state_of(twin))
            twin = another(twin.policy)
            if (fault := resume(twin, state)) is not None:
                raise Broken(f"what a manager remembers can't be told to another: {fault}")
        if isinstance(fact, int):
            twin.handle_deadline(fact)
        else:
            twin.receive(fact)
        twin.take_transitions()
        given.extend(twin.take_actions())
    if orders_told(given) != orders_told(
        guard.ordered
    ):  # as a recording tells them: without a core's last words
        raise Broken("the same facts gave other orders")


def _story(world: World) -> list[str]:
    lines = []
    for guard in world.guards:
        lines.append(f"guard {guard.number}: heard")
        lines += [f"    {fact}" for fact in guard.heard]
        lines.append(f"guard {guard.number}: ordered")
        lines += [f"    {action}" for action in guard.ordered]
    return lines
