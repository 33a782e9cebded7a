"""Judges a gateway that lives, by the same witnesses as a core.

What makes a silence a verdict does not depend on who is silent: beats of its own and the kernel's word must agree, both
must have lasted in time that we were there to see, and a busy machine, a long garbage collection or a suspended
computer explain a lot. So its page is read as a core's and the same judge is asked; only what can be said of a gateway
is believed. It has no commands of a core's, and what it holds for its clients is no queue of its own.
Rules of its own, simpler ones, were not chosen: each false alarm that the core's judge has learned to leave alone would
have had to be learned once more.
"""

from dataclasses import dataclass, field

from msgspec import structs

from hardcore.model.clocks import Clocks
from hardcore.model.gateway import GatewayPulse
from hardcore.model.looks import ProcessSample
from hardcore.model.observations import Sampled
from hardcore.model.recorder import Beats, LifeState, Threads
from hardcore.model.verdicts import GREEN, Colour, Diagnosis, Verdict
from hardcore.sentinel.patience import Patience
from hardcore.sentinel.verdict import Bench

#: What a gateway can be found to be.
_OF_A_GATEWAY = frozenset(
    {Diagnosis.FROZEN, Diagnosis.GIL_HELD, Diagnosis.SPINNING, Diagnosis.LOOP_BLOCKED, Diagnosis.DEADLOCK}
)
#: Of one that has not written its page, the kernel alone speaks: nothing is inferred from beats that never were.
_WITHOUT_A_PAGE = frozenset({Diagnosis.FROZEN})


@dataclass(slots=True)
class GatewayBench:
    """The judge of one gateway. `due_ns`: from then on a gateway that has not begun to beat is late."""

    patience: Patience
    due_ns: int
    _bench: Bench = field(init=False)

    def __post_init__(self) -> None:
        # Whoever restarts a gateway cuts every connection: nothing is so conclusive that it could not wait.
        slower = structs.replace(
            self.patience, conclusive_ms=self.patience.hang_ms, transaction_ms=0, disk_floor_bytes=0
        )
        self._bench = Bench(slower)

    def judge(
        self, at_ns: int, pulse: GatewayPulse | None, process: ProcessSample | None, clocks: Clocks
    ) -> Verdict:
        """Return what this look says: red only where the gateway has to be ended. Without its process nobody is."""
        if process is None or (pulse is None and at_ns < self.due_ns):
            return GREEN
        beats = _beats(pulse) if pulse is not None else Beats(loop_ns=self.due_ns, thread_ns=self.due_ns)
        threads = Threads(pulse.loop_thread, 0, pulse.beat_thread) if pulse is not None else Threads()
        found = self._bench.judge(Sampled(at_ns, 0, beats, threads, process, clocks=clocks))
        believed = _OF_A_GATEWAY if pulse is not None else _WITHOUT_A_PAGE
        if found.colour is Colour.RED and found.diagnosis not in believed:
            return structs.replace(GREEN, colour=Colour.YELLOW, testimonies=found.testimonies)
        return found


def _beats(pulse: GatewayPulse) -> Beats:
    return Beats(
        loop_ns=pulse.loop_ns,
        loop_count=pulse.loop_count,
        thread_ns=pulse.thread_ns,
        gc_since_ns=pulse.gc_since_ns,
        state=LifeState.READY,
    )
