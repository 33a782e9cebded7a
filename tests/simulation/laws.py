"""What must be true at the end of every world, whatever befell it: nobody forgotten, nothing lost, no answer false.

A law is a sentence; whoever breaks it is told which. These ask only the world; what depends on the way there is asked
by the checkers, which have seen it.
"""

from typing import TYPE_CHECKING

from hardcore.model.actions import SetSafe
from hardcore.model.phases import Phase, Wanted
from hardcore.model.verdicts import Diagnosis
from tests.simulation.machine import COMMIT_FAILED, CORRUPT, LOCKED, NO_ROOM
from tests.simulation.store import REFUSALS

if TYPE_CHECKING:  # the world owns its checkers, and they ask here
    from tests.simulation.guard import Guard
    from tests.simulation.machine import Life
    from tests.simulation.world import World

#: What a client asks for at the very end.
LAST_ASKED = "quiet-3"


class Broken(AssertionError):  # noqa: N818  # "the law is broken" is what it says
    """An invariant does not hold."""


def hold(truth: object, law: str) -> None:
    """Raise `Broken` with the law in words, unless it holds."""
    if not truth:
        raise Broken(law)


def nobody_is_left(world: "World", guard: "Guard") -> None:
    """A switch is over, one way or the other; nobody is left who is nothing to anybody."""
    told = guard.manager.reading()
    if guard.phase is Phase.RUNNING:
        hold(not told.switch_waits, "a switch that was asked for is done or given up")
    known = {guard.life, guard.numbered(told.spare), guard.numbered(told.behind or 0)}
    for life in world.lives:
        hold(not life.alive or life.in_kernel or life in known, "a core lives that nobody knows of")
        hold(not life.alive or not life.drained or life.in_kernel, "a drained core is left alone")


def writes_again(world: "World", guard: "Guard") -> None:
    """A mode that was entered for a disk's sake is left when the disk is well; a damaged ledger waits."""
    if Diagnosis.STORE_CORRUPT in world.truths:
        return
    if world.disk_wanted is Wanted.SAFE:
        hold(
            guard.life is not None and guard.life.safe, "the operator wants reads only, and writes are taken"
        )
        hold(guard.manager.reading().safe_by == "operator", "who wanted reads only is shown")
        return
    asked = [x for x in world.gateway.requests if x.key == LAST_ASKED]
    hold(all(x.outcome == "done" for x in asked), "who asks in the quiet is served")
    assert guard.life is not None, "it serves"
    hold(not guard.life.safe, "a core goes on reading only, for no reason any more")
    hold(guard.manager.reading().safe is None, "reading only is shown, and everything is served")


def ledger_is_true(world: "World") -> None:
    """Each command once, each epoch one writer's, and each answer as it was."""
    keys = [key for _, _, key in world.store.commits]
    hold(len(keys) == len(set(keys)), "no command is in the ledger twice")
    writers: dict[int, int] = {}
    last = 0
    for epoch, life, _ in world.store.commits:
        hold(writers.setdefault(epoch, life) == life, "one core commits in one epoch")
        hold(epoch >= last, "never back to a lower epoch")
        last = epoch
    hold(not world.gateway.open, "every request has an answer")
    said: dict[str, set[str]] = {}
    for request in world.gateway.requests:
        said.setdefault(request.key, set()).add(request.outcome)
        hold(request.keyed or len(request.decided_in) <= 1, "what has no key runs once")
    for key, outcomes in said.items():
        lied_to = any(request.lied_to for request in world.gateway.requests if request.key == key)
        hold(
            "done" not in outcomes or lied_to or key in world.store.keys,
            f"{key} was acknowledged and is lost",
        )
        hold(outcomes != {"not_done"} or key not in world.store.keys, f"{key} was denied and is there")


def behind(world: "World", life: "Life") -> bool:
    """The truth of a core that was left behind: it has let go of the store, or others write since."""
    guard = world.guard
    if guard.adopts is not None and life.guard != guard.number:
        return life.drained or (life.epoch or world.store.epoch) < world.store.epoch
    told = guard.manager.reading().behind
    if life.guard != world.guard.number or told != life.number:
        return False
    return life.drained or (life.in_kernel and (life.epoch or 0) < world.store.epoch)


def only_tried(world: "World", life: "Life", *, ready: bool) -> bool:
    """Whether it found out that a reason is not over: in a reader's place, or at its fence, where it can't be."""
    if life.exit is not None and life.exit.code in {LOCKED, NO_ROOM} and not ready:
        return True
    if life.exit is not None and life.exit.code == COMMIT_FAILED and world.store.disk in REFUSALS:
        return True  # what a disk refuses no other core tries
    before = world.lives[life.serial - 2] if life.serial > 1 else None
    tried = before is not None and before.unfenced
    return tried and life.exit is not None and life.exit.code in {CORRUPT, NO_ROOM}


def may_be_read_for(world: "World", reason: Diagnosis | None) -> bool:
    """Whether a core may be started to read only for this: it was the matter, or no other one was to be tried."""
    return reason in {None, Diagnosis.CRASH_LOOP, Diagnosis.EXITED} or reason in world.truths


def reads_only_for_a_reason(world: "World", order: SetSafe) -> None:
    """A core is told to read only because a person wants it, or for what was the matter."""
    hold(
        not order.on or order.reason is Diagnosis.OPERATOR or order.reason in world.truths,
        f"a core is told to read only for {order.reason}, which was never the matter",
    )
