"""Facts: everything that can be told to the FailoverManager, in the past tense.

The whole conversation between the shell and the pure middle fits on this page and on `actions.py`. Each
fact carries the monotonic time at which it was true; what concerns a core carries the number of its
`life` (counted by the guard from 1), so that a late answer is never taken for another core's.
"""

from enum import StrEnum

import msgspec

from hardcore.model.clocks import Clocks
from hardcore.model.looks import Conduct, DiskFacts, LockHolder, LogCounts, ProcessSample, ThreadStack
from hardcore.model.recorder import Beats, CommandNote, ComponentBeat, Page, Threads, Witness
from hardcore.model.trials import CourtMemory, TrialObservation
from hardcore.model.verdicts import Diagnosis


class Exit(msgspec.Struct, frozen=True):
    """How a process ended: `code` or `signal`; both None when nobody could read its status."""

    code: int | None = None
    signal: int | None = None


class Verb(StrEnum):
    """What an operator may ask."""

    STOP = "stop"
    RESTART = "restart"
    RESTART_HARD = "restart-hard"
    RESUME = "resume"
    RESTART_COMPONENT = "restart-component"  # one part of the core alone
    SAFE_ON = "safe-on"  # serve reads only until SAFE_OFF
    SAFE_OFF = "safe-off"


class SentinelBegan(msgspec.Struct, frozen=True):
    """The guard is up. `leftovers`: processes of an earlier guard's were found and may still live (as life 0).
    `page` is the recorder of the last core that committed, if there is one of this boot. `adoptable` is that of a
    core that was found serving: by its page it is ready, under the highest epoch of all pages, and no earlier guard
    had begun to end it; it is not among the leftovers. `suspects`: keys of commands that the earlier guard suspected in
    an incident it left open, or that were being executed in the last core it released, if that is gone or it had begun
    to end it: their requests are with a gateway. `serves_since_ns`: when the adoptable core began; None: long ago.
    """

    at_ns: int
    leftovers: bool = False
    page: Page | None = None
    adoptable: Page | None = None
    suspects: tuple[str, ...] = ()
    serves_since_ns: int | None = None
    court: CourtMemory | None = None
    unwatched_ns: int | None = None  # how long nobody watched before this guard began; None: nobody knows
    found_frozen: bool = (
        False  # the guard before did not die by itself: it was found to stand still, and ended
    )
    drilled: bool = False  # the guard before has ended itself, for a drill
    shut: Diagnosis | None = None  # why the policy had shut the service down; only a person starts it again


class Sampled(msgspec.Struct, frozen=True):
    """One tick of the watch. `in_flight` is read only while commands wait; None: not looked.

    `witness` is the last commit as the page shows it at this tick. `page_fault`: why there are no beats to read;
    `process_fault`: why nobody could look at the process.
    """

    at_ns: int
    life: int
    beats: Beats | None
    threads: Threads
    process: ProcessSample | None
    in_flight: tuple[CommandNote, ...] | None = None
    witness: Witness | None = None
    clocks: Clocks | None = None
    page_fault: str = ""
    process_fault: str = ""
    components: tuple[ComponentBeat, ...] = ()


class StacksSampled(msgspec.Struct, frozen=True):
    """A free look at all stacks, nothing was stopped for it. No stacks: `fault` says why."""

    at_ns: int
    life: int
    stacks: tuple[ThreadStack, ...]
    fault: str = ""


class Probed(msgspec.Struct, frozen=True):
    """The core was asked for its health over its own socket. `answered` False: not within the probe's time.

    `writes`: whether it takes writes; None: it did not say. `safe`: why it serves reads only.
    """

    at_ns: int
    life: int
    asked_ns: int
    answered: bool
    epoch: int | None = None
    seq: int | None = None
    writes: bool | None = None
    safe: Diagnosis | None = None


class StoreLooked(msgspec.Struct, frozen=True):
    """Who holds the store's write lock at this moment, as the kernel's table of locks says."""

    at_ns: int
    life: int
    holders: tuple[LockHolder, ...]


class StoreFault(StrEnum):
    """What a living core says of its store, on the notify socket."""

    FULL = "FULL"
    READ_ONLY = "READ_ONLY"
    OK = "OK"


class StoreTold(msgspec.Struct, frozen=True):
    """The core says that its store took a write no longer, or that it does again."""

    at_ns: int
    life: int
    fault: StoreFault


class SafeSwitched(msgspec.Struct, frozen=True):
    """The core answered an order to serve reads only (`on`) or everything again; `done` False: `reason` says why."""

    at_ns: int
    life: int
    on: bool
    done: bool
    reason: str = ""


class Surveyed(msgspec.Struct, frozen=True):
    """What is looked at once a second, off the loop. `life` is the one looked at; None: not looked."""

    at_ns: int
    life: int
    disk: DiskFacts | None = None
    conduct: Conduct | None = None
    oom_kills: int | None = None  # how often the kernel has killed for memory since this life began
    free_bytes: int | None = None  # memory that could be had now; None: not looked
    log: LogCounts | None = None
    private_bytes: int | None = None  # memory of this life that nobody shares (USS); None: not looked
    fds_limit: int | None = None  # how many descriptors it may have; None: not looked, or nothing limits it


class ComponentRestarted(msgspec.Struct, frozen=True):
    """The core answered an order to start one of its parts anew; `done` False: `reason` says why."""

    at_ns: int
    life: int
    name: str
    done: bool
    reason: str = ""


class CoreSpawned(msgspec.Struct, frozen=True):
    """A core process exists."""

    at_ns: int
    life: int
    pid: int


class SpawnFailed(msgspec.Struct, frozen=True):
    """No core process could be made."""

    at_ns: int
    life: int
    reason: str


class SpareReady(msgspec.Struct, frozen=True):
    """The spare has loaded all it needs, bound its socket and read the store. `build` names the code it runs.

    `schema` is the store's as it read it; `migrates`: it would bring the store up to a newer one when it takes over.
    """

    at_ns: int
    life: int
    build: str
    schema: int
    migrates: bool = False


class PromoteRefused(msgspec.Struct, frozen=True):
    """The spare does not take over, or could not be told to."""

    at_ns: int
    life: int
    reason: str


class Drained(msgspec.Struct, frozen=True):
    """The core answered an order to drain. `done`: everything is answered and the store is let go of, at `seq`.

    Not done: it takes requests again, and `reason` says why.
    """

    at_ns: int
    life: int
    done: bool
    seq: int = 0
    reason: str = ""


class EpochRaised(msgspec.Struct, frozen=True):
    """The core has committed its fence."""

    at_ns: int
    life: int
    epoch: int


class StartExtended(msgspec.Struct, frozen=True):
    """A starting core makes progress and asks for more time."""

    at_ns: int
    life: int
    for_ns: int


class Proof(msgspec.Struct, frozen=True):
    """What the core proved of its ledger before it served: `kind` is "witness" or "chain"."""

    kind: str
    tail: int
    seq: int
    hash: str


class CoreReady(msgspec.Struct, frozen=True):
    """The core has proven its ledger and listens."""

    at_ns: int
    life: int
    epoch: int
    proof: Proof


class LedgerAudited(msgspec.Struct, frozen=True):
    """A serving core has replayed the whole ledger: it is whole up to `seq`, or `fault` says why it is not."""

    at_ns: int
    life: int
    seq: int | None
    fault: str = ""

    @property
    def ok(self) -> bool:
        """Whether the ledger is whole."""
        return not self.fault


class FenceBlocked(msgspec.Struct, frozen=True):
    """The core could not write its fence: somebody holds the store's lock."""

    at_ns: int
    life: int


class TermReceived(msgspec.Struct, frozen=True):
    """The core was sent a TERM by process `sender` (0: unknown)."""

    at_ns: int
    life: int
    sender: int


class CoreExited(msgspec.Struct, frozen=True):
    """The core's process is gone. `page` is its recorder, read right after; None: unreadable.

    `oom_kills` is how often the kernel has killed for memory since this life began; None: nobody can tell.
    """

    at_ns: int
    life: int
    exit: Exit
    page: Page | None
    oom_kills: int | None = None
    said: str = ""  # the end of its log in one line, if it left with a code


class EvidenceTaken(msgspec.Struct, frozen=True):
    """The evidence of a living core is on disk, or what could be had of it. `steps` are timeline steps."""

    at_ns: int
    life: int
    complete: bool
    page: Page | None
    steps: tuple[tuple[str, int], ...] = ()
    stopped: bool = True  # the core was stopped for it, as the order said


class OperatorAsked(msgspec.Struct, frozen=True):
    """An operator's word, taken from the control socket or a signal."""

    at_ns: int
    verb: Verb
    reason: str = ""
    accept_ledger: bool = False  # RESUME: what stands in the store is right, whoever says otherwise
    image: bool = False  # RESTART, RESTART_HARD: with an image of the old core's memory, if the policy allows
    build: str = ""  # RESTART: the code that lies on the disk now; empty: nobody looked
    serves: str = ""  # RESTART: the code of the core that serves, as it says itself; empty: it did not say
    component: str = ""  # RESTART_COMPONENT: which


class DrillStarted(msgspec.Struct, frozen=True):
    """The core `life` was told to break itself: its next death is a drill. An empty `fault` takes that back."""

    at_ns: int
    fault: str
    life: int


class GatewayHolding(msgspec.Struct, frozen=True):
    """The gateway has begun to hold requests."""

    at_ns: int


class GatewayWitnessed(msgspec.Struct, frozen=True):
    """The highest commit that the gateway has passed on to a client in an answer of 2xx."""

    at_ns: int
    witness: Witness


class FirstServed(msgspec.Struct, frozen=True):
    """The first answer of this epoch came through the gateway."""

    at_ns: int
    epoch: int


class RequestOutcome(msgspec.Struct, frozen=True):
    """What became of one request that met an outage."""

    method: str
    path: str
    key_hash: str
    outcome: str
    status: int
    held_ms: int


class RequestsSettled(msgspec.Struct, frozen=True):
    """Every request that met the outage has an outcome."""

    at_ns: int
    incident: str
    requests: tuple[RequestOutcome, ...]


class GatewayCounted(msgspec.Struct, frozen=True):
    """How much the gateway has to do: what it holds, who is connected, and what it has forwarded since its start."""

    at_ns: int
    connections: int
    held: int
    forwarded: int


class PolicyRead(msgspec.Struct, frozen=True):
    """A policy was read whole and found right: from now on it holds. `text` is its JSON, every number named."""

    at_ns: int
    text: str


#: Facts about one life of the core.
CoreObservation = (
    Sampled
    | ComponentRestarted
    | CoreSpawned
    | SpawnFailed
    | SpareReady
    | PromoteRefused
    | Drained
    | EpochRaised
    | StartExtended
    | CoreReady
    | LedgerAudited
    | FenceBlocked
    | TermReceived
    | CoreExited
    | EvidenceTaken
    | StacksSampled
    | Probed
    | StoreLooked
    | StoreTold
    | SafeSwitched
    | Surveyed
)

Observation = (
    SentinelBegan
    | OperatorAsked
    | DrillStarted
    | GatewayHolding
    | GatewayWitnessed
    | FirstServed
    | RequestsSettled
    | GatewayCounted
    | PolicyRead
    | TrialObservation
    | CoreObservation
)
