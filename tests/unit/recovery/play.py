"""A manager played by hand: facts told one by one, orders kept, time moved only by its own deadlines."""

from dataclasses import dataclass, field

from hardcore.model import actions as orders
from hardcore.model import observations as seen
from hardcore.model.looks import ProcessSample, ThreadSample
from hardcore.model.phases import Phase, Wanted
from hardcore.model.recorder import (
    Beats,
    CommandNote,
    LastWords,
    LifeState,
    Page,
    SlotStage,
    Threads,
    Witness,
)
from hardcore.recovery.failover import FailoverManager
from hardcore.recovery.policy import Policy

MS = 1_000_000
S = 1000 * MS
PROOF = seen.Proof("witness", 3, 7, "h7")


@dataclass(slots=True)
class Play:
    """A manager, what it ordered, and the time."""

    policy: Policy = field(default_factory=Policy)
    wanted: Wanted = Wanted.UP
    deaths_ns: tuple[int, ...] = ()
    now_ns: int = 100 * S
    ordered: list[orders.Action] = field(default_factory=list)
    manager: FailoverManager = field(init=False)

    def __post_init__(self) -> None:
        ids = iter(range(1, 100))
        self.manager = FailoverManager(
            self.policy, self.wanted, lambda: f"i{next(ids)}", lambda: 0.0, self.deaths_ns
        )

    @property
    def phase(self) -> Phase:
        return self.manager.reading().phase

    @property
    def life(self) -> int:
        return self.manager.reading().life

    def tell(self, *facts: seen.Observation) -> list[orders.Action]:
        """Tell facts; return what was ordered on them."""
        for fact in facts:
            self.manager.receive(fact)
        new = list(self.manager.take_actions())
        self.ordered += new
        return new

    def ring(self) -> list[orders.Action]:
        """Let the time of the present phase be over."""
        due_ns = self.manager.next_deadline_ns()
        assert due_ns is not None, f"{self.phase} has no deadline"
        self.now_ns = due_ns
        self.manager.handle_deadline(due_ns)
        new = list(self.manager.take_actions())
        self.ordered += new
        return new

    def begin(self) -> "Play":
        """The guard is up and a core was ordered."""
        self.tell(seen.SentinelBegan(self.now_ns))
        return self

    def ready(self, epoch: int = 4) -> "Play":
        """The present core is made, fences and is ready."""
        at = self.now_ns
        self.tell(seen.CoreSpawned(at, self.life, 9), seen.EpochRaised(at, self.life, epoch))
        self.tell(seen.CoreReady(at, self.life, epoch, PROOF))
        return self

    def running(self, epoch: int = 4) -> "Play":
        """The present core has outlasted its probation."""
        self.ready(epoch).ring()
        return self

    def spared(self, build: str = "b1") -> "Play":
        """A spare waits beside the present core."""
        look(self, 0)
        self.tell(seen.Surveyed(self.now_ns, self.life, free_bytes=8 << 30))
        look(self, 0)
        at, spare = self.now_ns, self.spare
        self.tell(seen.CoreSpawned(at, spare, 10))
        self.glance()
        self.tell(seen.SpareReady(at, spare, build, 4))
        return self

    @property
    def spare(self) -> int:
        """The life of the spare; 0: none."""
        return self.manager.reading().spare

    def glance(self, silent_ms: int = 0, state: str = "S") -> list[orders.Action]:
        """A look at the spare."""
        beat_ns = self.now_ns - silent_ms * MS
        beats = Beats(loop_ns=beat_ns, thread_ns=beat_ns, state=LifeState.SPARE)
        process = ProcessSample(state, 1, 1 << 20, 3)
        return self.tell(seen.Sampled(self.now_ns, self.spare, beats, Threads(1, 3, 2), process))

    def ask(
        self, verb: seen.Verb, reason: str = "", build: str = "", serves: str = ""
    ) -> list[orders.Action]:
        """The operator speaks."""
        return self.tell(seen.OperatorAsked(self.now_ns, verb, reason, build=build, serves=serves))

    def die(self, how: seen.Exit | None = None, page: Page | None = None) -> list[orders.Action]:
        """The present core ends."""
        return self.tell(seen.CoreExited(self.now_ns, self.life, how or seen.Exit(signal=9), page))

    def spawned(self) -> orders.Spawn:
        """The last order to start a core."""
        return [order for order in self.ordered if isinstance(order, orders.Spawn)][-1]

    def closed(self) -> orders.Incident:
        """The last incident that was closed."""
        return [order for order in self.ordered if isinstance(order, orders.CloseIncident)][-1].incident


def drained(play: Play, *, done: bool = True) -> list[orders.Action]:
    """The present core answers an order to drain."""
    return play.tell(seen.Drained(play.now_ns, play.life, done, 7, "" if done else "it takes too long"))


def raised(play: Play, epoch: int) -> list[orders.Action]:
    """The present core has committed its fence."""
    return play.tell(seen.EpochRaised(play.now_ns, play.life, epoch))


def proven(play: Play, epoch: int, seq: int = 7) -> list[orders.Action]:
    """The present core is ready; its ledger ends at `seq`."""
    proof = seen.Proof("witness", 3, seq, f"h{seq}")
    return play.tell(seen.CoreReady(play.now_ns, play.life, epoch, proof))


#: A loop that waits for something outside: the least conclusive of all silences.
POLLS = ThreadSample("S", 5, "poll_schedule_timeout")


def look(play: Play, silent_ms: int) -> list[orders.Action]:
    """A tick 100 ms later, at which the loop has been silent for so long; a deadline that has come rings first."""
    play.now_ns += 100 * MS
    given: list[orders.Action] = []
    due_ns = play.manager.next_deadline_ns()
    if due_ns is not None and due_ns <= play.now_ns:
        play.manager.handle_deadline(play.now_ns)
        given += play.tell()
    beats = Beats(loop_ns=play.now_ns - silent_ms * MS, thread_ns=play.now_ns, state=LifeState.READY)
    process = ProcessSample("S", 1, 1 << 20, 3, loop=POLLS, writer=POLLS)
    return given + play.tell(seen.Sampled(play.now_ns, play.life, beats, Threads(1, 3, 2), process))


def fall_silent(play: Play, from_ms: int, to_ms: int, first_ms: int = 0) -> None:
    """Look from `first_ms` until `to_ms`; the loop has been silent since `from_ms`."""
    for at_ms in range(first_ms + 100, to_ms + 1, 100):
        look(play, max(0, at_ms - from_ms))


def a_page(epoch: int = 4, *notes: CommandNote, words: str = "", seq: int = 0) -> Page:
    said = LastWords(1, words, "") if words else None
    beats = Beats(epoch=epoch, state=LifeState.READY)
    witness = Witness(seq, epoch, f"h{seq}") if seq else None
    return Page("n", "b", 1, 1, Threads(), beats, witness, said, notes, (), ())


def deciding(key: str) -> CommandNote:
    return CommandNote(SlotStage.DECIDING, f"c{key}", key, "transaction", "", (), 1)


def kinds(given: list[orders.Action]) -> list[str]:
    return [type(order).__name__ for order in given]
