"""Clients that go on working, and the gateway between them and the core.

The gateway here keeps the promises of the real one: it holds what it can't forward, after a death it
replays nothing before a release, replays only what has a key and is no suspect, looks suspects up, and
gives every request one answer. So what is wrong in the ledger at the end was caused by the guard's orders.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import Enum
from functools import partial
from typing import TYPE_CHECKING

from hardcore.model import observations as seen
from hardcore.model.actions import Release
from hardcore.model.phases import Face
from hardcore.model.recorder import Witness
from hardcore.model.trials import CaseFiled, SuspectsSettled
from tests.simulation.clock import NS_PER_MS, NS_PER_S
from tests.simulation.conditions import BLOCKED_TIMER
from tests.simulation.harms import Harm
from tests.simulation.machine import TOUCHED, Life

if TYPE_CHECKING:  # the world owns the gateway
    from tests.simulation.world import World

HOLD_NS = 10 * NS_PER_S
UPSTREAM_NS = 30 * NS_PER_S
REQUESTS_MAX = 64
LATER_NS = 150 * NS_PER_MS


class At(Enum):
    """Where a request is."""

    HELD = "held"
    FORWARDED = "forwarded"
    LOST = "lost"
    ON_TRIAL = "on trial"
    SETTLED = "settled"


@dataclass(slots=True, eq=False)
class Request:
    """One request of one client. `outcome`: done, not_done, unknown, gone."""

    number: int
    key: str
    keyed: bool
    harm: Harm = Harm.NONE
    at: At = At.HELD
    outcome: str = ""
    life: Life | None = None
    suspect: bool = False
    excused: bool = False  # nobody could know that it is a suspect
    lied_to: bool = False  # a core said that it was done, and it was not
    refused: bool = False  # by the core that it was sent to
    tries: int = 0
    decided_in: list[int] = field(default_factory=list)

    @property
    def command_id(self) -> str:
        """Each try is a command of its own."""
        return f"c{self.number}"

    @property
    def key_hash(self) -> str:
        """What the recorder shows of the key, or the name that the gateway made for it."""
        return f"hash of {self.key}" if self.keyed else f"name of {self.number}"

    @property
    def kind(self) -> str:
        """Its kind of command."""
        return "transaction"

    def decided(self, life: Life) -> None:
        """A core takes it up; a poisonous one does its harm."""
        self.decided_in.append(life.serial)
        match self.harm:
            case Harm.CRASH:
                life.die(seen.Exit(signal=11))
            case Harm.EXIT:
                life.die(seen.Exit(code=1))
            case Harm.BLOCK:
                life.befall(BLOCKED_TIMER)
                life.world.worry()
            case Harm.NONE | Harm.WRITE | Harm.LATER | Harm.LOG:
                pass

    def written(self, life: Life) -> None:
        """A core writes it."""
        if self.harm is Harm.WRITE:
            life.die(seen.Exit(signal=11))

    def finished(self, life: Life) -> None:
        """A core answers it."""
        if self.harm is Harm.LATER:
            life.world.clock.after(LATER_NS, lambda: life.die(seen.Exit(signal=11)))
        elif self.harm is Harm.LOG and not self.lied_to:
            life.world.store.lethal.add(life.world.store.keys[self.key])


class Gateway:
    """Owns every client's connection."""

    def __init__(self, world: "World") -> None:
        self.world = world
        self.face = Face.HOLD
        self.serving: Life | None = None
        self.released = False  # any face but FORWARD takes it back
        self.requests: list[Request] = []
        self.open: list[Request] = []
        self.suspects: set[str] = set()
        self.nameless: list[Request] = []

    # ---- clients ----

    def submit(self, key: str, *, keyed: bool = True, harm: Harm = Harm.NONE) -> None:
        """A client sends a request."""
        if len(self.requests) >= REQUESTS_MAX:
            return
        request = Request(len(self.requests), key, keyed, harm)
        self.requests.append(request)
        self.open.append(request)
        self._route(request)

    def _route(self, request: Request) -> None:
        if self.face in {Face.REFUSE, Face.CLOSED}:
            self.settle(request, "not_done")
        elif request.key_hash in self.world.set_aside:
            self.settle(request, "set_aside")
        elif self.released and request.key_hash in self.suspects:
            self._bring_to_court(request)  # it came again
        elif self.released and self.serving is not None and self.serving.alive:
            self._forward(request)
        else:
            request.at = At.HELD
            self.world.clock.after(HOLD_NS, lambda: self._hold_is_over(request))

    def _forward(self, request: Request) -> None:
        assert self.serving is not None, "nothing is forwarded to nobody"
        life = self.serving
        self.world.checkers.forwarded(request)
        request.tries += 1
        request.at, request.life = At.FORWARDED, life
        life.on_loop(lambda: self._arrives(request, life))
        self.world.clock.after(UPSTREAM_NS, lambda: self._upstream_is_over(request, life))

    def _arrives(self, request: Request, life: Life) -> None:
        if request.at is At.FORWARDED and request.life is life:
            life.accept(request)

    def _hold_is_over(self, request: Request) -> None:
        if request.at is At.HELD:
            self.settle(request, "not_done")
        elif request.at is At.LOST:
            self.settle(request, "unknown")
        elif request.at is At.ON_TRIAL:
            self.settle(request, "not_done")  # it was looked up, and is not run any more

    def _upstream_is_over(self, request: Request, life: Life) -> None:
        if request.at is At.FORWARDED and request.life is life:
            self.settle(request, "unknown")

    def settle(self, request: Request, outcome: str) -> None:
        """Give a request its answer; some clients try again."""
        if outcome == "not_done" and request.life is not None and not (request.suspect or request.refused):
            outcome = "unknown"  # it once was with a core: only a look-up could say more
        request.at, request.outcome = At.SETTLED, outcome
        self.open.remove(request)
        rng = self.world.rng
        again = outcome in {"not_done", "unknown"} and request.keyed and request.harm is Harm.NONE
        if again and not self.world.quiet and rng.random() < 0.3:
            self.world.clock.after(rng.randrange(2 * NS_PER_S), lambda: self.submit(request.key))

    # ---- the core's side ----

    def answered(self, life: Life, request: Request) -> None:
        """A core has answered; only the serving one is believed."""
        if life is self.serving and request.at is At.FORWARDED and request.life is life:
            if self.world.warm and not request.lied_to:
                self._witness(life, request)
            self.settle(request, "done")

    def _witness(self, life: Life, request: Request) -> None:
        """Say what was passed on: its commit, if it is one of the serving epoch's."""
        seq = self.world.store.keys[request.key]
        epoch, _, _ = self.world.store.commits[seq - 1]
        if epoch == life.epoch:
            now_ns = self.world.clock.now_ns
            told = seen.GatewayWitnessed(now_ns, Witness(seq, epoch, f"{seq:x}"))
            self.world.clock.after(
                self.world.rng.randrange(100) * NS_PER_MS, lambda: self.world.to_guard(told)
            )

    def postponed(self, life: Life, request: Request) -> None:
        """A core that is drained has not run it: it waits as if it had never been sent."""
        if request.at is At.FORWARDED and request.life is life:
            request.tries -= 1
            request.life, request.at = None, At.HELD
            self.world.clock.after(HOLD_NS, lambda: self._hold_is_over(request))

    def refused(self, life: Life, request: Request) -> None:
        """A core that reads only, or whose store takes no write, has said that nothing was done."""
        if request.at is At.FORWARDED and request.life is life:
            request.refused = request.tries == 1  # what an earlier core did with it, this one can't know
            self.settle(request, "not_done")

    def died(self, life: Life) -> None:
        """A core's connections broke."""
        inside = life.inside
        for slot in life.slots.values():
            if inside and slot.stage in TOUCHED:
                slot.request.suspect = True
                slot.request.excused = life.page_lost or life.status_lost
        for request in [r for r in self.open if r.at is At.FORWARDED and r.life is life]:
            if request.keyed:
                request.at = At.LOST
                self.world.clock.after(HOLD_NS, partial(self._hold_is_over, request))
            else:
                self.settle(request, "unknown")
                self.nameless.append(request)  # tried, and never run again

    # ---- the feed ----

    def show(self, face: Face) -> None:
        """The guard says what is to be done with requests."""
        if face is self.face:
            return
        self.face = face
        self.released = self.released and face is Face.FORWARD
        if face is Face.HOLD:
            self.world.to_guard(seen.GatewayHolding(self.world.clock.now_ns + NS_PER_MS))
        elif face is not Face.FORWARD:
            for request in list(self.open):
                if request.at is not At.FORWARDED:
                    self.settle(request, "unknown" if request.at is At.LOST else "not_done")

    def release(self, order: Release, life: Life) -> None:
        """The guard says that this core serves: what was held and lost goes on."""
        self.serving, self.face, self.released = life, Face.FORWARD, True
        for request in list(self.open):
            if request.at is At.LOST:
                self._after_death(request, order)
            elif request.at is At.ON_TRIAL:
                self._bring_to_court(request)  # who began the court may be gone
            elif request.at is At.HELD:
                self._route(request)
        for request in self.nameless:
            if request.key_hash in order.suspects:
                self._file(request)
        self.nameless.clear()
        at_ns = self.world.clock.now_ns + 3 * NS_PER_MS
        if life.alive:
            self.world.to_guard(seen.FirstServed(at_ns, order.epoch))
        if order.incident is not None:
            told = tuple(seen.RequestOutcome("POST", "/", r.key_hash, r.outcome, 0, 0) for r in self.requests)
            self.world.to_guard(seen.RequestsSettled(at_ns, order.incident, told))

    def _after_death(self, request: Request, order: Release) -> None:
        if request.key_hash in order.suspects:
            self._bring_to_court(request)
            return
        self.world.checkers.replayed(request)
        self._route(request)

    # ---- suspects ----

    def _bring_to_court(self, request: Request) -> None:
        """Look a suspect up; if the ledger lacks it, its case is filed, and it waits."""
        request.suspect = True  # looked up after the fence: the answer is true for ever
        now_ns = self.world.clock.now_ns
        if request.key in self.world.store.keys:
            self.settle(request, "done")
            self.suspects.discard(request.key_hash)
            self.world.to_guard(SuspectsSettled(now_ns, (request.key_hash,)))
            return
        if request.at is not At.ON_TRIAL:
            request.at = At.ON_TRIAL
            self.world.clock.after(HOLD_NS, partial(self._hold_is_over, request))
        self._file(request)

    def _file(self, request: Request) -> None:
        self.world.cases[request.key_hash] = request
        self.world.to_guard(CaseFiled(self.world.clock.now_ns, request.key_hash, f"peer:{request.key}"))

    def suspected(self, names: Iterable[str]) -> None:
        """The guard says who is suspect; each is so until it says what becomes of it."""
        self.suspects |= set(names)

    def acquitted(self, name: str, *, run: bool) -> None:
        """The guard says what becomes of a suspect."""
        self.suspects.discard(name)
        for request in [r for r in self.open if r.key_hash == name and r.at is At.ON_TRIAL]:
            if run:
                request.at, request.suspect = At.HELD, False
                self._route(request)
            else:
                self.settle(request, "not_done")

    def set_aside(self, name: str) -> None:
        """The guard says that this is refused from now on."""
        self.suspects.discard(name)
        for request in [r for r in self.open if r.key_hash == name]:
            if request.at in {At.ON_TRIAL, At.HELD}:
                self.settle(request, "set_aside")

    def renewed(self) -> None:
        """A new guard has ended this gateway and started another: its clients lost their connections."""
        for request in list(self.open):
            self.settle(request, "gone")
        self.face, self.serving, self.released = Face.HOLD, None, False
        self.suspects = set()  # it is told anew
