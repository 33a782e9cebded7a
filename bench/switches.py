"""What a client sees when the core is changed for the spare: after a kill, after each kind of hang, and as planned.

A client asks every 5 ms on a fresh connection, as in the contest with the peers. For a kill and for a planned switch the
longest request counts, for a hang the time from the fault to the next good answer. Each round begins when the last
incident is told and a spare is ready. The order of the hangs is fixed, and each is counted apart and all together.
"""

import asyncio
import time
from pathlib import Path

from bench.faults import percentile
from bench.figures import Figure, Target
from bench.instance import Watched, fill
from bench.peers.asking import Asking, Blow
from bench.peers.contest import Guarded, asking_at
from examples.guarded import GuardError
from hardcore.control import client

TRANSACTIONS = 500
CONCLUSIVE = ("deadlock", "block", "freeze")
OTHERS = ("spin", "gil", "slow-tx")
POLICY = {"transaction_timeout_ms": 1000}
OVER_S = 30.0
LOOK_EVERY_S = 0.02
SETTLE_S = 1.2
CRASH_MS, CRASH_P95_MS = 60, 120
PLANNED_MS = 100
CONCLUSIVE_MS = 1000
HANG_P95_MS = 2500


def measure(folder: Path, *, kills: int, hangs: int, switches: int) -> list[Figure]:
    """Change the core for the spare so many times in each way; return what the client saw."""
    with Watched(folder / "switches", POLICY) as instance:
        fill(instance, TRANSACTIONS)
        return asyncio.run(_measure(instance, kills, hangs, switches))


async def _measure(instance: Watched, kills: int, hangs: int, switches: int) -> list[Figure]:
    async with asking_at(instance.address) as asking:
        crashes = [await _blow(instance, asking, "kill") for _round in range(kills)]
        planned = [await _blow(instance, asking, "restart") for _round in range(switches)]
        hung = {
            fault: [await _blow(instance, asking, fault) for _round in range(hangs)]
            for fault in (*CONCLUSIVE, *OTHERS)
        }
    failed = sum(blow.failed for blow in (*crashes, *planned))
    longest = [blow.longest_ms for blow in crashes]
    every = [_outage(blow) for blows in hung.values() for blow in blows]
    return [
        Figure("kill -9: longest request", "ms", tuple(longest), target=Target(CRASH_MS)),
        Figure("  p95", "ms", (percentile(longest, 95),), target=Target(CRASH_P95_MS)),
        Figure("planned switch: longest request", "ms", tuple(blow.longest_ms for blow in planned), target=Target(PLANNED_MS)),
        Figure("failed requests, kills and switches", "", (failed,), target=Target(0)),
        *(
            Figure(
                f"{fault}: fault -> serving", "ms", tuple(map(_outage, blows)),
                target=Target(CONCLUSIVE_MS) if fault in CONCLUSIVE else None,
            )
            for fault, blows in hung.items()
        ),
        Figure("any hang, p95", "ms", (percentile(every, 95),), target=Target(HANG_P95_MS)),
    ]  # fmt: skip


def _outage(blow: Blow) -> float:
    if blow.outage_ms is None:
        raise GuardError("Nobody served again after a hang.")
    return blow.outage_ms


async def _blow(instance: Watched, asking: Asking, fault: str) -> Blow:
    guarded = Guarded(instance, spare=True)
    await guarded.at_rest()
    before = instance.core()
    before.let_go()
    if fault == "kill":
        last = await asking.well(OVER_S)
        assert last is not None, "it is at rest"
        hit_ns = await guarded.crash(last)
    else:
        hit_ns = await _order(instance, fault)
    await _over(instance, before.epoch)
    await asyncio.sleep(SETTLE_S)
    return asking.blow(hit_ns, time.monotonic_ns())


async def _order(instance: Watched, fault: str) -> int:
    order: dict[str, object] = {"verb": "restart", "reason": "bench"}
    if fault != "restart":
        order = {"verb": "drill", "fault": fault, "yes": True}
    hit_ns = time.monotonic_ns()
    told = await asyncio.to_thread(client.ask, instance.folders.control, order)
    if told.get("ok") is not True:
        raise GuardError(f"{fault} was refused: {told}")
    return hit_ns


async def _over(instance: Watched, epoch: int) -> None:
    give_up_at = time.monotonic() + OVER_S
    while True:
        told = await asyncio.to_thread(instance.status)
        core = told["core"]
        if (core["epoch"] or 0) > epoch and core["ready"] and told["incident"] is None:
            return
        if time.monotonic() > give_up_at:
            raise GuardError(f"No other core serves after {OVER_S:g} s: {told['phase']}.")
        await asyncio.sleep(LOOK_EVERY_S)
