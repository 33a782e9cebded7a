"""The core that waits, and the one that was left behind: what is known of both.

A spare has loaded everything, holds its own socket, has read the store and does nothing. One that is silent, slow or
gone is never promoted: a cold start is slower and always there. Its deaths have a budget of their own, because a spare
that dies again and again says something about the store or the code and nothing about the core that serves. Whether
one is to be had at all is answered in words, so that a person can be told why there is none.
"""

from enum import StrEnum

import msgspec

from hardcore.model.looks import ProcessSample
from hardcore.model.observations import SpareReady, StartExtended
from hardcore.model.recorder import Beats
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.budget import NS_PER_MS, NS_PER_S, Budget
from hardcore.recovery.policy import Policy

#: So many deaths of spares in this time are answered with another one.
DEATHS_MAX = 2
WINDOW_NS = 300 * NS_PER_S
#: The pause after a spare that ended unasked, so that one that dies at once costs little.
PAUSE_NS = 2 * NS_PER_S
#: After too many deaths one is tried again so often: whatever ends them may have been mended.
QUIET_NS = 60 * NS_PER_S
#: A spare that has been silent for this long is ended and replaced; until then it is only not promoted.
SILENT_NS = 5 * NS_PER_S
#: What was last seen of a spare holds for this long: our own looks come late on a busy machine.
LOOK_HOLDS_NS = 2 * NS_PER_S


class Lack(StrEnum):
    """Why there is no spare."""

    OFF = "off"
    MEMORY = "memory"
    DIED = "died"


class SpareState(StrEnum):
    """Where the spare is."""

    NONE = "none"
    STARTING = "starting"
    READY = "ready"
    ENDING = "ending"  # told to end, its end not seen yet


class Spare(msgspec.Struct):
    """The spare, or why there is none. Times are monotonic.

    `wanted`: the policy's word. `build`: the code that it runs. `fault`: what became of the last one, in words, until
    another is ready. `free_bytes`: this machine's memory; None: nobody has said, `surveyed`: though it was asked.
    """

    wanted: bool
    floor_bytes: int
    startup_ns: int
    late_ns: int
    budget: Budget
    state: SpareState = SpareState.NONE
    life: int = 0
    since_ns: int = 0
    build: str = ""
    free_bytes: int | None = None
    surveyed: bool = False
    fault: str = ""
    drilled: bool = False  # its next end is a drill's: it says nothing about it
    told: bool = False  # a person was told that they die again and again
    pause_until_ns: int = 0
    _looked_ns: int = 0
    _heard_ns: int = 0
    _borne_ns: int = 0  # silence from before this was ours: we had not looked
    _runs: bool = False

    @property
    def lost(self) -> bool:
        """Whether spares have died so often that another one is tried only now and then."""
        return self.wanted and self.budget.limit < len(self.budget.deaths_ns)

    @property
    def lack(self) -> Lack | None:
        """Why there is no spare that is ready; None where there is, or where one is only on its way."""
        if self.state is SpareState.READY:
            return None
        if not self.wanted:
            return Lack.OFF
        if self._is_small:
            return Lack.MEMORY
        return Lack.DIED if self.fault else None

    @property
    def unwanted(self) -> bool:
        """Whether one is there that the policy does not want: a wish of a person's had it tried."""
        return not self.wanted and self.life != 0

    @property
    def unknown(self) -> bool:
        """Whether nobody has looked yet if this machine can keep one."""
        return self.wanted and self.free_bytes is None and not self.surveyed

    @property
    def _is_small(self) -> bool:
        return self.free_bytes is not None and self.free_bytes < self.floor_bytes and self.life == 0

    def why_not(self) -> str:
        """Return why there is no spare, in words, or an empty text."""
        match self.lack:
            case None:
                return ""
            case Lack.OFF:
                return "it is turned off"
            case Lack.MEMORY:
                return f"less than {self.floor_bytes >> 20} MB of memory are free"
            case Lack.DIED:
                return self.fault

    @property
    def comes(self) -> bool:
        """Whether there is one or will be soon. Without a look at this machine's memory nobody knows."""
        return self.wanted and self.free_bytes is not None and not self._is_small and not self.lost

    def survey(self, free_bytes: int | None) -> None:
        """Take in a look at this machine's memory; None: it could not be had."""
        self.surveyed = True
        if free_bytes is not None:
            self.free_bytes = free_bytes

    def due(self, now_ns: int) -> bool:
        """Return whether one is to be started now."""
        if self.state is not SpareState.NONE or now_ns < self.pause_until_ns:
            return False
        self.budget = self.budget.at(now_ns)
        self.told = self.told and self.lost
        return self.wanted and self.free_bytes is not None and not self._is_small

    def begin(self, life: int, now_ns: int) -> None:
        """One is being started as `life`."""
        self.state, self.life, self.since_ns = SpareState.STARTING, life, now_ns
        self.build, self.drilled = "", False
        self._looked_ns = self._heard_ns = self._borne_ns = now_ns
        self._runs = False

    def ready(self, fact: SpareReady) -> None:
        """It waits from now on. Its word is no look at it: it may have lain there while we slept."""
        if self.state is SpareState.STARTING:
            self.state, self.build, self.fault = SpareState.READY, fact.build, ""

    def looked(self, now_ns: int, beats: Beats | None, process: ProcessSample | None) -> None:
        """Take in one look at it: both of its beats count, and whether it runs at all."""
        if now_ns - self._looked_ns > LOOK_HOLDS_NS:
            self._borne_ns = now_ns  # we or the whole machine slept: it may not have had the time either
        self._looked_ns = now_ns
        self._runs = process is not None and process.state in {"R", "S"}
        if beats is not None:
            beat_ns = min(beats.loop_ns, beats.thread_ns)
            self._heard_ns = max(self._heard_ns, beat_ns) if beat_ns <= now_ns else self._heard_ns

    def fit(self, now_ns: int) -> bool:
        """Return whether it may take over: ready, running, and not late when it was last looked at."""
        if self.state is not SpareState.READY or not self._runs:
            return False
        return self._looked_ns - self._heard_ns <= self.late_ns and now_ns - self._looked_ns <= LOOK_HOLDS_NS

    def hangs(self, now_ns: int) -> str:
        """Return why it has to be ended, or an empty text."""
        match self.state:
            case SpareState.STARTING if now_ns - self.since_ns > self.startup_ns:
                return f"it was not ready within {self.startup_ns // NS_PER_MS} ms"
            case SpareState.READY if self._silent_ns > SILENT_NS:
                return f"it has been silent for {self._silent_ns // NS_PER_MS} ms"
            case _:
                return ""

    @property
    def _silent_ns(self) -> int:
        return self._looked_ns - max(self._heard_ns, self._borne_ns)

    def extend(self, fact: StartExtended) -> None:
        """It makes progress and asks for more time: each asking is good for one more start at most."""
        if self.state is SpareState.STARTING:
            until_ns = fact.at_ns + min(fact.for_ns, self.startup_ns)
            self.since_ns = max(self.since_ns, until_ns - self.startup_ns)

    def end(self, why: str, now_ns: int, *, unasked: bool) -> None:
        """It is being ended by us, because of this; `unasked`: it has only itself to thank for it."""
        self.state, self.since_ns = SpareState.ENDING, now_ns
        if unasked:
            self.fault = why
            self._count(now_ns)

    def ended(self, why: str, now_ns: int) -> bool:
        """It is gone. Return whether nobody had asked it to."""
        unasked = self.state in {SpareState.STARTING, SpareState.READY}
        if unasked and not self.drilled:
            self.fault = why
            self._count(now_ns)
        self.state, self.life = SpareState.NONE, 0
        return unasked

    def leave(self) -> int:
        """It is the core from now on; return its life."""
        taken = self.life
        self.state, self.life = SpareState.NONE, 0
        return taken

    def _count(self, now_ns: int) -> None:
        self.budget = self.budget.after_death(now_ns)
        self.pause_until_ns = now_ns + (QUIET_NS if self.lost else PAUSE_NS)


def spare(policy: Policy) -> Spare:
    """Return what is known of a spare before there was one."""
    return Spare(
        policy.spare,
        policy.spare_memory_mb << 20,
        policy.startup_timeout_ms * NS_PER_MS,
        policy.health_check_timeout_ms * NS_PER_MS,
        Budget(DEATHS_MAX, WINDOW_NS),
    )


class Behind(msgspec.Struct):
    """A core that lives on behind the fence. Times are monotonic.

    `stuck`: it was killed and is still there, in the kernel; one that is not was drained and is only to leave.
    `fenced`: another core has raised the epoch since, so it can commit nothing any more. `leave_by_ns`: when it is
    killed, or killed again.
    """

    life: int
    stuck: bool
    leave_by_ns: int | None = None
    fenced: bool = False
    blame: Diagnosis = Diagnosis.OPERATOR  # what its end is called
