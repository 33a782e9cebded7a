"""One run: a plan from a seed, its faults on a living house under load, and quiet again afterwards.

A house goes through many runs, as a household's server does: what one leaves behind (a descriptor, a rule, a lock) the
next one meets. Whatever a seed chooses is chosen before the first blow, so the same seed strikes the same way; what
the machine makes of it may differ, and what was met is written down.
"""

import contextlib
import http.client
import random
import threading
import time
from dataclasses import dataclass, field
from typing import Final

from hardcore.control import client
from tests.campaign.audit import Audit, Broken
from tests.campaign.faults import BY_NAME, FAULTS, Fault
from tests.campaign.moments import PHASES, STAGES, Feed, Moment, reached
from tests.integration.clients import at_work
from tests.integration.house import House

#: Strikes of one run.
STRIKES: Final = (1, 2, 2, 3)
GAP_S_MAX: Final = 1.2
CLIENTS: Final = 3
#: It has to work again, or to say that it needs a person, by then.
QUIET_S: Final = 90.0
#: Rest counts when it has lasted longer than a hang takes to be confirmed: a fault may not show before.
REST_S: Final = 2.0
_LOOK_S: Final = 0.05


@dataclass(frozen=True)
class Strike:
    """One fault, and when."""

    fault: Fault
    moment: Moment
    gap_s: float


@dataclass(frozen=True)
class Told:
    """What one run was and what came of it."""

    seed: int
    strikes: tuple[str, ...]
    met: tuple[tuple[str, str], ...]  # fault and moment, of those that struck somebody
    broken: tuple[str, ...]
    manual: int
    asked: int
    took_s: float
    incidents: tuple[tuple[str, int | None, int | None], ...] = ()  # diagnosis, detected, outage


@dataclass
class Runs:
    """A house that is struck again and again."""

    house: House
    audit: Audit
    done: list[Told] = field(default_factory=list)

    def run(self, seed: int) -> Told:
        """Carry out one seed; what is broken is told and raises nothing."""
        began, chance = time.monotonic(), random.Random(f"campaign-{seed}")
        planned = plan(chance)
        met: list[tuple[str, str]] = []
        manual, asked = 0, 0
        broken: tuple[str, ...] = ()
        incidents: list[tuple[str, int | None, int | None]] = []
        before = self.audit.before()
        try:
            with at_work(self.house, CLIENTS, f"run{seed}") as clients, Feed(self.house) as feed:
                struck = [self._strike(feed, one, chance, met) for one in planned]
                for timer in (timer for timers in struck for timer in timers):
                    timer.join()
                manual = quiet(self.house)
                clients.stop.set()
            asked = len(clients.told)
            hit = [BY_NAME[name] for name, _ in met]
            incidents = self.audit.after(before, hit, clients)
        except (Broken, AssertionError, OSError, http.client.HTTPException, client.Unreachable) as error:
            broken = (f"{type(error).__name__}: {error}",)
        names = tuple(f"{one.fault.name} at {one.moment}" for one in planned)
        told = Told(
            seed, names, tuple(met), broken, manual, asked, time.monotonic() - began, tuple(incidents)
        )
        self.done.append(told)
        return told

    def _strike(
        self, feed: Feed, one: Strike, chance: random.Random, met: list[tuple[str, str]]
    ) -> list[threading.Timer]:
        threading.Event().wait(one.gap_s)
        where = reached(self.house, feed, one.moment)
        struck = one.fault.strike(self.house, chance)
        if struck.hit:
            met.append((one.fault.name, where))
        return struck.timers


def plan(chance: random.Random) -> tuple[Strike, ...]:
    """Return the strikes of a run: the first in peace, the others more often in the middle of what it began."""
    strikes = []
    for number in range(chance.choice(STRIKES)):
        fault = chance.choices(FAULTS, [fault.weight for fault in FAULTS])[0]
        moments = [Moment.ANY, Moment.ANY, *STAGES] if not number else [Moment.ANY, *sorted(PHASES), *STAGES]
        moment = chance.choice(moments)
        gap_s = chance.uniform(0, GAP_S_MAX) if moment is Moment.ANY else 0.0
        strikes.append(Strike(fault, moment, gap_s))
    return tuple(strikes)


def quiet(house: House) -> int:
    """Wait until it works and nothing is open; say `resume` where it waits for a person, and return how often."""
    give_up_at, asked, pause = time.monotonic() + QUIET_S, 0, threading.Event()
    rested_s = time.monotonic()
    while True:
        told = house.status()
        if not (told and _at_rest(told)):
            rested_s = time.monotonic()
        elif time.monotonic() - rested_s >= REST_S:
            return asked
        if told.get("state") == "MANUAL_INTERVENTION":
            asked += 1
            with contextlib.suppress(client.Unreachable):
                house.order("resume")
        if time.monotonic() > give_up_at:
            raise Broken(f"not quiet after {QUIET_S:g} s: {told}")
        pause.wait(_LOOK_S)


def _at_rest(told: dict[str, object]) -> bool:
    gateway, core = told.get("gateway") or {}, told.get("core") or {}
    assert isinstance(gateway, dict), told
    assert isinstance(core, dict), told
    serves = bool(core.get("ready")) and gateway.get("pid") is not None
    return serves and told.get("phase") == "RUNNING" and told.get("incident") is None
