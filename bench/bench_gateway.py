"""What the gateway costs: reads per second and the time of one, beside the same core alone and one nginx worker.

Two cores stand behind it in turn: the real ledger, which is what people wait for, and the smallest one that answers,
which shows the gateway's own cost and nothing else. All ways are measured by the same client, in turn, several rounds.
"""

import asyncio
from collections.abc import Callable
from contextlib import AbstractContextManager, AsyncExitStack
from pathlib import Path

import uvloop

from bench import ways
from bench.figures import Baseline, Figure, Target
from bench.loader import Load, load, request

CONNECTIONS = 32
#: Of the ledger's reads per second, beside the core alone and beside nginx; and what a request may wait longer.
LEAST_RATIO = Target(0.8, of_ratio=True, least=True)
ADDED_MS = Target(0.3)

Core = Callable[[Path], AbstractContextManager[tuple[Path, int, str]]]


def measure(folder: Path, *, rounds: int, seconds: float, say: Callable[[str], None]) -> list[Figure]:
    """Measure every way to both cores."""
    if ways.nginx() is None:
        say("  There is no nginx here (apt-get install nginx-light): nothing is measured beside it.")
    with asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner:
        real = runner.run(_rounds(folder, ways.ledger, rounds, seconds))
        small = runner.run(_rounds(folder, ways.smallest, rounds, seconds))
    return [
        *_figures("of the ledger", real, judged=True),
        *_figures("of the smallest core", small, judged=False),
    ]


async def _rounds(folder: Path, core: Core, rounds: int, seconds: float) -> dict[str, dict[int, list[Load]]]:
    """The loads by way and number of connections."""
    found: dict[str, dict[int, list[Load]]] = {}
    async with AsyncExitStack() as stack:
        path, epoch, asked = stack.enter_context(core(folder))
        places: dict[str, Path | int] = {"straight": path}
        places["gateway"] = await stack.enter_async_context(ways.gateway(folder, path, epoch))
        if ways.nginx() is not None:
            places["nginx"] = stack.enter_context(ways.worker(folder, path))
        for _ in range(rounds):
            for connections in (CONNECTIONS, 1):
                for way, place in places.items():
                    one = await load(place, request(asked), connections, seconds)
                    found.setdefault(way, {}).setdefault(connections, []).append(one)
    return found


def _figures(whose: str, found: dict[str, dict[int, list[Load]]], *, judged: bool) -> list[Figure]:
    """Throughput beside the core alone and beside nginx, and the time that is added to one request."""
    least = LEAST_RATIO if judged else None
    rates = {way: tuple(one.per_second for one in by[CONNECTIONS]) for way, by in found.items()}
    medians = {way: tuple(one.median_ms for one in by[1]) for way, by in found.items()}
    name = f"reads {whose}, {CONNECTIONS} connections"
    beside = [("straight", "straight to it")] + ([("nginx", "one nginx worker")] if "nginx" in found else [])
    figures = [
        Figure(name, "/s", rates["gateway"], Baseline(words, rates[way]), least) for way, words in beside
    ]
    for way, words in {"gateway": "added to a read", "nginx": "added by nginx"}.items():
        if way in medians:
            pairs = zip(medians[way], medians["straight"], strict=True)
            added = tuple(through - straight for through, straight in pairs)
            target = ADDED_MS if way == "gateway" else None
            figures.append(Figure(f"{words} {whose}, 1 connection", "ms", added, target=target))
    return figures
