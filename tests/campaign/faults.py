"""What can strike: each fault with whom it may end and what it may be called.

Only what real processes can do to themselves or be done to without a change to the host: signals through pidfds, the
product's own drills, an operator's orders. What a fault *may* end is said here and not found out afterwards: a core
that ends under a fault that ends none was killed by mistake.
"""

import random
import signal
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from hardcore.control import client
from tests.integration.house import House

#: A stop so short that nobody may be ended for it.
SHORT_STOP_S: Final = 0.15
#: A stop that nobody may be ended for either: shorter than the patience with a guard.
LONGER_STOP_S: Final = 2.0
#: A guard that was frozen and thaws: long enough for another to have taken its place (3.5 s of patience, and a start).
THAW_S: Final = 8.0

#: Who of ours may end.
CORE, SPARE, GATEWAY, SENTINEL = "core", "spare", "gateway", "sentinel"


@dataclass
class Struck:
    """What a fault did. `timers` still have something to do (a thaw); `hit`: it found somebody to strike."""

    hit: bool
    timers: list[threading.Timer] = field(default_factory=list)


@dataclass(frozen=True)
class Fault:
    """One fault. `ends`: whose process may end of it; `called`: the diagnoses that an incident of it may have; `thaws`:
    whom it lets go on after a while, whoever has stopped it meanwhile.
    """

    name: str
    strike: Callable[[House, random.Random], Struck]
    ends: frozenset[str] = frozenset()
    called: frozenset[str] = frozenset()
    weight: int = 2
    thaws: str = ""


def signalled(who: str, number: int) -> Callable[[House, random.Random], Struck]:
    """Return the blow that sends this signal to one of ours."""

    def strike(house: House, _: random.Random) -> Struck:
        return Struck(_hit(house, who, number))

    return strike


def stopped_for(who: str, seconds: float) -> Callable[[House, random.Random], Struck]:
    """Return the blow that stops one of ours for a while and lets it go on."""

    def strike(house: House, _: random.Random) -> Struck:
        pid = _pid(house, who)
        if pid is None:
            return Struck(hit=False)
        victim = house.hold_pid(pid)
        victim.hit(signal.SIGSTOP)

        def thaw() -> None:
            if not victim.gone:
                victim.hit(signal.SIGCONT)

        timer = threading.Timer(seconds, thaw)
        timer.start()
        return Struck(hit=True, timers=[timer])

    return strike


def drilled(name: str) -> Callable[[House, random.Random], Struck]:
    """Return the drill of this name; one that is refused now strikes nobody."""

    def strike(house: House, _: random.Random) -> Struck:
        return Struck(_order(house, "drill", fault=name, yes=True))

    return strike


def ordered(verb: str, **particulars: object) -> Callable[[House, random.Random], Struck]:
    """Return an operator's order."""

    def strike(house: House, _: random.Random) -> Struck:
        return Struck(_order(house, verb, reason="campaign", **particulars))

    return strike


def all_killed(house: House, _: random.Random) -> Struck:
    """Kill sentinel, gateway, core and spare at once: only the launcher is left."""
    hits = [_hit(house, who, signal.SIGKILL) for who in (GATEWAY, CORE, SPARE, SENTINEL)]
    return Struck(any(hits))


def _pid(house: House, who: str) -> int | None:
    told = house.status().get(who) or {}
    pid = told.get("pid")
    return pid if isinstance(pid, int) else None


def _hit(house: House, who: str, number: int) -> bool:
    pid = _pid(house, who)
    if pid is None:
        return False
    try:
        house.hold_pid(pid).hit(number)
    except ProcessLookupError:
        return False
    return True


def _order(house: House, verb: str, **particulars: object) -> bool:
    try:
        return house.order(verb, **particulars).get("ok") is True
    except client.Unreachable:
        return False


_CORE = frozenset({CORE})
_HANG = frozenset({"LOOP_BLOCKED", "GIL_HELD", "SPINNING", "DEADLOCK", "NO_PROGRESS", "FROZEN"})
_STALL = _HANG | {"TRANSACTION_TIMEOUT"}

FAULTS: Final = (
    Fault("kill", signalled(CORE, signal.SIGKILL), _CORE, frozenset({"KILLED_FROM_OUTSIDE"}), 4),
    Fault("segv", signalled(CORE, signal.SIGSEGV), _CORE, frozenset({"CRASHED"})),
    Fault("abort", signalled(CORE, signal.SIGABRT), _CORE, frozenset({"CRASHED"}), 1),
    Fault("bus", signalled(CORE, signal.SIGBUS), _CORE, frozenset({"CRASHED"}), 1),
    Fault("term", signalled(CORE, signal.SIGTERM), _CORE, frozenset({"KILLED_FROM_OUTSIDE"})),
    Fault("freeze core", signalled(CORE, signal.SIGSTOP), _CORE, frozenset({"FROZEN"}), 3),
    Fault("short stop", stopped_for(CORE, SHORT_STOP_S), thaws=CORE),
    Fault("drill exit", drilled("exit"), _CORE, frozenset({"EXITED"})),
    Fault("drill block", drilled("block"), _CORE, _HANG),
    Fault("drill spin", drilled("spin"), _CORE, _HANG, 1),
    Fault("drill gil", drilled("gil"), _CORE, _HANG, 1),
    Fault("drill deadlock", drilled("deadlock"), _CORE, _STALL),
    Fault("drill slow-tx", drilled("slow-tx"), _CORE, _STALL, 1),
    Fault("drill gc", drilled("gc")),
    Fault("kill spare", signalled(SPARE, signal.SIGKILL), frozenset({SPARE})),
    Fault("freeze spare", signalled(SPARE, signal.SIGSTOP), frozenset({SPARE})),
    Fault(
        "kill gateway", signalled(GATEWAY, signal.SIGKILL), frozenset({GATEWAY}), frozenset({"GATEWAY_LOST"})
    ),
    Fault(
        "freeze gateway",
        signalled(GATEWAY, signal.SIGSTOP),
        frozenset({GATEWAY}),
        frozenset({"GATEWAY_LOST"}),
    ),
    Fault("stop gateway shortly", stopped_for(GATEWAY, SHORT_STOP_S), thaws=GATEWAY),
    Fault(
        "kill sentinel",
        signalled(SENTINEL, signal.SIGKILL),
        frozenset({SENTINEL}),
        frozenset({"SENTINEL_LOST"}),
        3,
    ),
    Fault(
        "freeze sentinel",
        signalled(SENTINEL, signal.SIGSTOP),
        frozenset({SENTINEL}),
        frozenset({"SENTINEL_LOST"}),
    ),
    Fault(
        "thaw sentinel",
        stopped_for(SENTINEL, THAW_S),
        frozenset({SENTINEL}),
        frozenset({"SENTINEL_LOST"}),
        thaws=SENTINEL,
    ),
    Fault("stop sentinel shortly", stopped_for(SENTINEL, LONGER_STOP_S), thaws=SENTINEL),
    Fault(
        "kill all",
        all_killed,
        frozenset({CORE, SPARE, GATEWAY, SENTINEL}),
        frozenset({"KILLED_FROM_OUTSIDE", "SENTINEL_LOST", "GATEWAY_LOST"}),
        1,
    ),
    Fault("restart", ordered("restart"), _CORE, frozenset({"OPERATOR", "PLANNED_SWITCH"})),
    Fault("restart hard", ordered("restart", hard=True), _CORE, frozenset({"OPERATOR"}), 1),
)
BY_NAME: Final = {fault.name: fault for fault in FAULTS}
