"""One look: everything that the witnesses found at one tick, as one value that every diagnosis reads.

A diagnosis is a function of a look and of the policy's patience. Whatever has to be remembered from tick to tick
is remembered by the witness whose matter it is, so that no diagnosis keeps a state of its own and their order is a
table that can be read.
"""

import msgspec

from hardcore.model.looks import ProcessSample
from hardcore.model.recorder import Threads
from hardcore.model.verdicts import Colour, Diagnosis, Grade, Testimony, Verdict
from hardcore.sentinel.lasting import NS_PER_MS
from hardcore.sentinel.witnesses.answers import Unkept
from hardcore.sentinel.witnesses.beats import BeatAges
from hardcore.sentinel.witnesses.clocks import ClockFacts
from hardcore.sentinel.witnesses.collection import CollectionFacts
from hardcore.sentinel.witnesses.components import Stalled
from hardcore.sentinel.witnesses.disk import DiskFindings
from hardcore.sentinel.witnesses.probe import Unanswered
from hardcore.sentinel.witnesses.process_state import ProcessFacts
from hardcore.sentinel.witnesses.processor import ProcessorFacts
from hardcore.sentinel.witnesses.progress import Stuck
from hardcore.sentinel.witnesses.stacks import StackFacts
from hardcore.sentinel.witnesses.store import StoreFindings
from hardcore.sentinel.witnesses.transactions import Deciding


class Look(msgspec.Struct, frozen=True):
    """What was found at `at_ns`. `alone`: the thread's beat goes on without the loop's, two looks agree.

    `in_store_ns`: for how long the writer has waited in the store while no command was being decided there.
    `late_often`: our own ticks come late again and again.
    """

    at_ns: int
    threads: Threads
    sample: ProcessSample
    ages: BeatAges
    alone: bool
    process: ProcessFacts
    processor: ProcessorFacts
    collection: CollectionFacts
    stuck: Stuck | None
    deciding: tuple[Deciding, ...]
    unkept: Unkept | None
    unanswered: Unanswered | None
    clocks: ClockFacts
    disk: DiskFindings
    store: StoreFindings
    stacks: StackFacts
    in_store_ns: int
    late_often: bool
    stalled: Stalled | None = None


def red(
    diagnosis: Diagnosis, grade: Grade, fault_ns: int, *facts: str, blamed: tuple[str, ...] = ()
) -> Verdict:
    """Return a verdict that something must be done, with the facts that settled it; the witnesses' are added."""
    settled = tuple(Testimony("judge", Colour.RED, fact) for fact in facts)
    return Verdict(Colour.RED, diagnosis, grade, fault_ns, settled, blamed=blamed)


def yellow(diagnosis: Diagnosis, fact: str) -> Verdict:
    """Return a verdict that is only told."""
    return Verdict(Colour.YELLOW, diagnosis, testimonies=(Testimony("machine", Colour.YELLOW, fact),))


def ms(time_ns: int) -> int:
    """Return a time in whole milliseconds, as people are told it."""
    return time_ns // NS_PER_MS


def lasted(time_ns: int, limit_ms: int) -> bool:
    """Return whether a time has reached a limit."""
    return time_ns >= limit_ms * NS_PER_MS
