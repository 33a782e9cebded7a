"""The looks of the simulated guard that are taken beside the watch: the disk, the memory, whether the core answers.

They come in their own pace, may be late, and one of them may never come back.
"""

import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING

from hardcore.model import observations as seen
from hardcore.model.looks import Conduct, DiskFacts
from hardcore.senses import PROBE_S
from tests.simulation.clock import NS_PER_MS
from tests.simulation.looks import stacks
from tests.simulation.machine import Life
from tests.simulation.store import REFUSALS, Disk
from tests.simulation.switches import Looking

if TYPE_CHECKING:  # the guard owns its surveyor
    from tests.simulation.guard import Guard

#: A probe that is not answered is given up after its time.
PROBE_NS = int(PROBE_S * 1000) * NS_PER_MS
#: A survey waits so long for its own write before it says that it is under way.
OWN_WRITE_NS = 200 * NS_PER_MS
#: One that is under way is looked at again so soon.
PENDING_MS = 500
#: A look at stacks takes up to so long.
LOOKING_MS = 60


@dataclass(slots=True)
class OwnWrite:
    """The guard's small write to the ledger's disk: one at a time, and the next survey tells of it."""

    began_ns: int | None = None

    @property
    def again_ms(self) -> int:
        """How soon it is looked at again at most: how long it took is known only from looking."""
        return PENDING_MS if self.began_ns is not None else sys.maxsize

    def look(self, now_ns: int, takes_ns: int | None) -> tuple[int | None, int]:
        """Return what it took and for how long it has been under way. `takes_ns` None: it does not come back."""
        if self.began_ns is None:
            self.began_ns = now_ns - OWN_WRITE_NS
        under_way_ns = now_ns - self.began_ns
        if takes_ns is None or takes_ns > under_way_ns:
            return None, under_way_ns
        self.began_ns = None
        return max(takes_ns, NS_PER_MS), 0


class Surveyor:
    """See the module."""

    def __init__(self, guard: "Guard") -> None:
        self.guard = guard
        self._own_write = OwnWrite()

    def look(self, life: Life, ticks: int) -> None:
        """Now and then: the disk, the counters, and whether the core answers."""
        world, now_ns = self.guard.world, self.guard.world.clock.now_ns
        world.note_truths()
        every_ms = self.guard.policy.health_check_interval_ms
        survey_ms = min(self.guard.policy.survey_interval_ms, self._own_write.again_ms)
        first = world.warm and ticks == 1  # without a look at the memory no spare is had
        if first or ticks % max(1, survey_ms // every_ms) == 0:
            self._disk(life, now_ns)
        if ticks % (self.guard.policy.probe_interval_ms // every_ms) == 0:
            self._probe(life, now_ns)

    def _disk(self, life: Life, now_ns: int) -> None:
        store = self.guard.world.store
        stalled = store.disk is Disk.STALLED
        took_ns, pending_ns = self._own_write.look(
            now_ns, None if stalled else self.guard.world.switches.own_write_ns
        )
        disk = DiskFacts(
            free_bytes=0 if store.disk is Disk.FULL else 1 << 34,
            read_only=store.disk is Disk.READ_ONLY,
            write_ns=took_ns,
            pending_ns=pending_ns,
            fault=store.disk.value if store.disk in REFUSALS else "",
        )
        free = self.guard.world.free_bytes if self.guard.world.warm else None
        self.guard.tell(seen.Surveyed(now_ns, life.number, disk, Conduct(), life.oom_kills, free))

    def _probe(self, life: Life, now_ns: int) -> None:
        if life.condition.loop_works:
            head = len(self.guard.world.store.commits)
            self.guard.tell(seen.Probed(now_ns, life.number, now_ns, True, life.epoch, head))
        else:
            self.guard.soon(PROBE_NS, lambda: self._probe_is_over(life, now_ns))

    def _probe_is_over(self, life: Life, asked_ns: int) -> None:
        """A probe's time is over: an answer that came late is still one."""
        if life.alive:
            answers = life.condition.loop_works
            self.guard.tell(seen.Probed(self.guard.world.clock.now_ns, life.number, asked_ns, answers), 0)

    def look_at_stacks(self, life: Life) -> None:
        """Somebody wants to know where its threads stand."""
        looking, now_ns = self.guard.world.switches.looking, self.guard.world.clock.now_ns
        if looking is Looking.NEVER:
            return
        wait_ns = self.guard.world.rng.randrange(10, LOOKING_MS) * NS_PER_MS
        denied = looking is Looking.DENIED
        self.guard.tell(
            seen.StacksSampled(
                now_ns, life.number, () if denied else stacks(life), "may not be traced" if denied else ""
            ),
            wait_ns,
        )
