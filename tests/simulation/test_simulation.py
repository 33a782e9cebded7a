import itertools
import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from msgspec import structs

from hardcore.model.observations import Sampled
from hardcore.model.phases import Phase
from hardcore.model.trials import Ordeal, Suspect, TrialAction
from hardcore.model.verdicts import GREEN, Colour, Diagnosis, Verdict
from hardcore.recovery import (
    asked,
    court,
    failover,
    mandate,
    moves,
    plan,
    readiness,
    transitions,
    trial,
)
from hardcore.recovery.budget import Budget
from hardcore.recovery.course import Course
from hardcore.recovery.court import Court
from hardcore.recovery.policy import Policy
from hardcore.recovery.register import Register
from hardcore.recovery.safety import Deed, Safety
from hardcore.recovery.spare import Spare, SpareState
from hardcore.recovery.store import StoreKnowledge
from hardcore.recovery.transitions import Row, Step, Trigger
from hardcore.sentinel import verdict
from hardcore.sentinel.seen_time import SeenTime
from hardcore.sentinel.verdict import Bench, Patience
from hardcore.sentinel.witnesses.own_stall import OwnStall
from tests.simulation import court as courtroom
from tests.simulation.faults import LOAD
from tests.simulation.run import POLICIES, Script, run, write_script

P, T, S = Phase, Trigger, Step

SEEDS = 1_500
FRESH_SEEDS = 300
#: A mutant must be found within so many seeds.
MUTANT_SEEDS = 5000

ROOT = Path(__file__).parents[2]
#: Where the fresh seeds begin in a tree that is no checkout.
UNKNOWN = 1

REGRESSIONS = sorted((Path(__file__).parent / "regressions").glob("*.json"))


def _fresh_seed() -> int:
    """Of the commit that is tested, so that each change also meets seeds nobody has seen; else UNKNOWN."""
    # Whoever owns the checkout: a machine that tests often is not its owner, and git would say nothing.
    asked = ["git", "-c", "safe.directory=*", "rev-parse", "HEAD"]
    try:
        said = subprocess.run(asked, cwd=ROOT, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return UNKNOWN
    return int(said.stdout[:8], 16)


def _broken(seeds: range) -> list[str]:
    return [str(result) for seed in seeds if (result := run(seed)).broken]


@pytest.mark.timeout(180)
def test_every_law_holds_in_the_worlds_of_the_fixed_seeds() -> None:
    assert _broken(range(SEEDS)) == []


def test_a_checkout_has_seeds_of_its_own() -> None:
    assert (_fresh_seed() != UNKNOWN) == (ROOT / ".git").exists()


@pytest.mark.timeout(180)
def test_every_law_holds_in_worlds_that_nobody_has_seen() -> None:
    first = _fresh_seed()
    assert _broken(range(first, first + FRESH_SEEDS)) == []


@pytest.mark.parametrize("path", REGRESSIONS, ids=lambda path: path.stem)
def test_what_once_broke_holds(path: Path) -> None:
    told = json.loads(path.read_text())
    script = Script(
        told["kind"],
        told["policy"],
        tuple((at_ms, name) for at_ms, name in told["faults"]),
        told.get("warm", False),
    )
    assert run(told["seed"], script).broken is None, told["story"]


def test_the_same_seed_is_the_same_run() -> None:
    assert run(7, tell=True).story == run(7, tell=True).story


# A world that is too kind finds nothing. Each mutant below is a guard with one thing wrong, and some world
# among the first seeds must say so.

Mutation = Callable[[pytest.MonkeyPatch], None]


def _table(phase: Phase, trigger: Trigger, row: Row | None) -> Mutation:
    """One cell of the table is another, or STAY."""

    def mutate(patch: pytest.MonkeyPatch) -> None:
        rows = {**transitions.TABLE[phase]}
        if row is None:
            del rows[trigger]
        else:
            rows[trigger] = row
        patch.setattr(transitions, "TABLE", {**transitions.TABLE, phase: rows})

    return mutate


def _without(question: Trigger) -> Mutation:
    """A question is never asked on entering a phase."""
    asked = {p: tuple(t for t in all_of if t is not question) for p, all_of in transitions.ON_ENTRY.items()}
    return lambda patch: patch.setattr(moves, "ON_ENTRY", asked)


def _no_evidence(patch: pytest.MonkeyPatch) -> None:
    judged = (P.KILLING, (S.OPEN, S.KILL))
    table = {p: {t: judged if S.EVIDENCE_LIVE in r[1] else r for t, r in rows.items()} for p, rows in _rows()}
    patch.setattr(transitions, "TABLE", table)


def _rows() -> list[tuple[Phase, dict[Trigger, Row]]]:
    return [(phase, dict(rows)) for phase, rows in transitions.TABLE.items()]


def _instead(room: object, name: str, answer: object) -> Mutation:
    """A function of a room gives another answer."""
    return lambda patch: patch.setattr(room, name, answer)


def _always(value: object) -> Callable[..., object]:
    """A function that answers the same whatever it is asked."""
    return lambda *asked, **named: (value, asked, named)[0]


def _hold_who_was_not_tried(
    court: Court, one: Suspect, why: str, now_ns: int, new_id: Callable[[], str]
) -> list[TrialAction]:
    return court._hold(one, Ordeal.UNTRIED, why, now_ns, new_id)


def _kill_what_is_only_late(patch: pytest.MonkeyPatch) -> None:
    judge = Bench.judge

    def harsh(self: Bench, tick: Sampled) -> Verdict:
        said = judge(self, tick)
        if said.testimonies and said.diagnosis is None:
            return structs.replace(said, colour=Colour.RED, diagnosis=Diagnosis.LOOP_BLOCKED)
        return said

    patch.setattr(Bench, "judge", harsh)


def _trust_an_old_epoch(store: StoreKnowledge, page: object) -> None:
    del page
    store.epoch = 3


def _dice_of_its_own(patch: pytest.MonkeyPatch) -> None:
    dice = itertools.count()
    pause_ns = plan.pause_ns
    patch.setattr(plan, "pause_ns", lambda policy, tries, _: pause_ns(policy, tries, next(dice) % 97 / 97))


def _disk_before_silence(patch: pytest.MonkeyPatch) -> None:
    last = [row for row in verdict.TABLE if row[0] is Diagnosis.NO_PROGRESS]
    patch.setattr(verdict, "TABLE", (*(row for row in verdict.TABLE if row not in last), *last))


def _end_it_while_it_lives(patch: pytest.MonkeyPatch) -> None:
    _table(P.KILLING, T.DEADLINE, (P.BACKOFF, ()))(patch)


def _nobody_ends_the_spare(patch: pytest.MonkeyPatch) -> None:
    for room in (moves, asked):
        patch.setattr(room, "dismiss", _always(None))


def _proven_by_time(patch: pytest.MonkeyPatch) -> None:
    def last(c: Course, now_ns: int) -> None:
        if c.phase is P.PROBATION and c.outlasted_ns is not None:
            moves.fire(c, T.LASTED, now_ns, "its time is over")

    patch.setattr(failover, "_last", last)


def _serve_at_once(patch: pytest.MonkeyPatch) -> None:
    def serve(c: Course, now_ns: int) -> None:
        if c.awaits is not None:
            readiness.serve(c, c.awaits, now_ns)

    patch.setattr(readiness, "ask_again", serve)


MUTANTS: dict[str, Mutation] = {
    "START from UNKILLABLE": _table(P.UNKILLABLE, T.RESTART_HARD, (P.STARTING, (S.FORGET, S.SPAWN))),
    "START while the old one is being killed": _end_it_while_it_lives,
    "START beside a leftover": _table(P.ADOPTING, T.DEADLINE, (P.STARTING, (S.SPAWN,))),
    "STOP forgotten in BACKOFF": _table(P.BACKOFF, T.STOP, None),
    "STOP forgotten in RUNNING": _table(P.RUNNING, T.STOP, None),
    "STOP forgotten on the way": _without(T.UNWANTED),
    "RELEASE before READY": _table(P.STARTING, T.EPOCH_RAISED, (P.PROBATION, (S.RELEASE,))),
    "death in PROBATION not noticed": _table(P.PROBATION, T.EXITED, None),
    "death while asked to leave not noticed": _table(P.STOPPING, T.EXITED, None),
    "no KILL after TERM": _table(P.STOPPING, T.DEADLINE, None),
    "no CLOSE after PROBATION": _table(P.PROBATION, T.LASTED, (P.RUNNING, (S.SETTLED,))),
    "CLOSE before PROBATION": _table(P.PROVING, T.READY, (P.PROBATION, (S.RELEASE, S.CLOSE))),
    "verdict without effect": _table(P.SUSPECT, T.LOST, None),
    "no deadline for the evidence": _table(P.SNAPSHOT_LIVE, T.DEADLINE, None),
    "late birth not noticed": _table(P.KILLING, T.SPAWNED, None),
    "failed birth not noticed": _table(P.STARTING, T.SPAWN_FAILED, None),
    "HALT without a stop": _table(P.FATAL, T.RESUME, (P.STOPPED, (S.HALT,))),
    "no evidence": _no_evidence,
    "budget forgotten": _instead(Budget, "after_death", Budget.at),
    "never gives up": _instead(plan, "hopeless", _always(None)),
    "suspects replayed": _instead(trial, "touched", _always(())),
    "whoever is killed on trial is a poison": _instead(court, "is_its_own", _always(value=True)),
    "nobody is ever tried": _instead(Court, "_try", lambda *_: []),
    "who can't be tried is held": _instead(Court, "_untried", _hold_who_was_not_tried),
    "who is beyond the limit is held": _instead(Court, "_untried", _hold_who_was_not_tried),
    "what is remembered without a rule stays so": _instead(courtroom, "unruled", _always(())),
    "a new guard forgets who is suspect": _instead(Register, "inherit", lambda *_: None),
    "own stall held against the core": _instead(OwnStall, "look", _always(value=False)),
    "no patience": _instead(plan, "patience", _always(Patience(100, 100, 110, 120))),
    "lateness alone is a verdict": _kill_what_is_only_late,
    "an old epoch trusted": _instead(StoreKnowledge, "saw", _trust_an_old_epoch),
    "dice of its own": _dice_of_its_own,
    "silence explained by a disk": _disk_before_silence,
    "what can't be seen is well": _instead(Bench, "_judge_what_remains", _always(GREEN)),
    "a pause held against a command": _instead(SeenTime, "_missed_since", _always(0)),
    "late for ever excuses all": _instead(
        OwnStall, "excused", property(lambda stall: bool(stall.late_ticks))
    ),
    "a probation ends by itself": _proven_by_time,
    "a lock is waited for by nobody": _instead(plan, "passes", _always(value=False)),
    "reads only for ever": _instead(Safety, "_plan", _always(None)),
    "PROMOTE beside a core that writes": _table(
        P.RUNNING, T.SWITCH, (P.SWITCHING, (S.OPEN_PLANNED, S.LEAVE_BEHIND, S.PROMOTE))
    ),
    "a drained core is kept": _table(P.PROVING, T.READY, (P.PROBATION, (S.RELEASE,))),
    "a sick spare is promoted": _instead(Spare, "fit", lambda spare, _: spare.state is SpareState.READY),
    "a stuck core is forgotten": _without(T.STUCK),
    "what a client was told is not asked for": _instead(StoreKnowledge, "misses", _always(value=False)),
    "the spare outlives its guard": _nobody_ends_the_spare,
    "no release after a drain in vain": _table(P.DRAINING, T.NOT_DRAINED, (P.RUNNING, (S.CLOSE,))),
    "a drain without an end": _table(P.DRAINING, T.DEADLINE, None),
    "a spare that does not take over is waited for": _table(P.SWITCHING, T.DEADLINE, None),
    "a mode keeps nobody from a start": _instead(mandate, "withheld", _always(value=False)),
    "a mode keeps nobody from a kill": _instead(mandate, "watches_only", _always(value=False)),
    "whoever is ready is sent clients": _serve_at_once,
    "a new guard forgets that reads only are wanted": _instead(Safety, "_hold", _always(Deed.NOTHING)),
}


#: What shows only where rare things meet is looked for where they do.
WHERE_IT_SHOWS = {
    "START from UNKILLABLE": ("unkillable", "operator changes his mind", "operator restarts hard"),
    "START beside a leftover": ("unkillable", "guard dies", "guard dies at an order"),
    "STOP forgotten in BACKOFF": ("crash loop", "boot crashes", "operator stops", "spawns fail"),
    "STOP forgotten on the way": ("frozen", "operator stops", "spawn is slow"),
    "verdict without effect": ("frozen", "blocked in a timer", "spinning"),
    "CLOSE before PROBATION": ("SIGSEGV", "exit 1", "boot crashes", "frozen"),
    "no CLOSE after PROBATION": ("SIGSEGV", "exit 1"),
    "HALT without a stop": ("crash loop", "operator resumes"),
    "STOP forgotten in RUNNING": ("operator stops",),
    "suspects replayed": ("poison crashes", "poison exits", "poison blocks"),
    "whoever is killed on trial is a poison": ("cores on trial are killed",),
    "nobody is ever tried": ("poison crashes",),
    "who can't be tried is held": ("court tries nobody", "court dies"),
    "who is beyond the limit is held": ("a full batch dies",),
    "what is remembered without a rule stays so": ("rule waits for the disk",),
    "a new guard forgets who is suspect": ("guard dies in court",),
    "own stall held against the core": tuple(LOAD),
    "no patience": tuple(LOAD),
    "lateness alone is a verdict": tuple(LOAD),
    "failed birth not noticed": ("spawns fail", "spawn is slow"),
    "late birth not noticed": ("spawn is slow", "operator stops", "operator restarts hard"),
    "dice of its own": ("boot crashes", "boot exits", "crash loop"),
    "silence explained by a disk": ("deaf core", "disk read-only", "disk fills"),
    "reads only for ever": ("disk fills", "disk read-only", "disk flickers"),
    "what can't be seen is well": ("page unreadable for long", "kernel says nothing"),
    "a pause held against a command": ("machine paused amid commands",),
    "late for ever excuses all": ("ticks always late", "frozen", "blocked on a lock"),
    "a probation ends by itself": ("silent at the end of probation",),
    "a lock is waited for by nobody": ("ledger locked at the fence",),
    "PROMOTE beside a core that writes": ("operator switches",),
    "a drained core is kept": ("operator switches",),
    "a sick spare is promoted": ("spare silent, then the core",),
    "a stuck core is forgotten": ("stuck with the store's lock",),
    "what a client was told is not asked for": ("gateway says too much",),
    "the spare outlives its guard": ("operator stops", "operator switches"),
    "no release after a drain in vain": ("drain refused",),
    "a drain without an end": ("drain never answered",),
    "a spare that does not take over is waited for": ("promotion hangs before its fence",),
    "a mode keeps nobody from a start": ("mode changes",),
    "a mode keeps nobody from a kill": ("mode changes", "frozen", "blocked in a timer"),
    "whoever is ready is sent clients": ("operator reads only", "SIGKILL"),
    "a new guard forgets that reads only are wanted": ("operator reads only", "guard dies"),
}


@pytest.mark.timeout(120)
@pytest.mark.parametrize("name", MUTANTS)
def test_a_guard_with_one_thing_wrong_is_found_out(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    MUTANTS[name](monkeypatch)
    faults = WHERE_IT_SHOWS.get(name, ())
    found = (run(seed, write_script(seed, faults)).broken for seed in range(MUTANT_SEEDS))
    assert any(found), f"{MUTANT_SEEDS} worlds were too kind"


def test_the_shipped_policy_is_among_those_simulated() -> None:
    assert POLICIES[0] == Policy()
