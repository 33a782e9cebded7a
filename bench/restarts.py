"""Does the guard stay what it is: its memory, its descriptors and its share of the processor over many restarts.

The core is killed as often as asked, each time as soon as it serves again. What the sentinel holds is read from
/proc between the kills, so that a leak of a page or a descriptor each time would stand in the figures.
"""

import signal
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import psutil

from bench.figures import Figure, Target
from bench.instance import Watched, fill

MB = 1e6
#: The first lives fill caches that stay; what counts is what comes after them.
WARM_UP = 20
GROWTH_MB_MAX = 4
SAY_EVERY = 100


def measure(folder: Path, *, restarts: int, say: Callable[[str], None]) -> list[Figure]:
    """Kill the core so many times and return how the sentinel has grown."""
    sizes: list[float] = []
    descriptors: list[float] = []
    threads: list[float] = []
    with Watched(folder / "restarts") as instance:
        fill(instance, 10)
        sentinel = psutil.Process(instance.running()["sentinel"]["pid"])
        for number in range(restarts):
            core = instance.core()
            core.hit(signal.SIGKILL)
            core.let_go()
            instance.until(partial(_follows, epoch=core.epoch), "the next core to serve")
            sizes.append(sentinel.memory_info().rss / MB)
            descriptors.append(sentinel.num_fds())
            threads.append(sentinel.num_threads())
            if (number + 1) % SAY_EVERY == 0:
                say(f"{number + 1} restarts: {sizes[-1]:.1f} MB, {descriptors[-1]} descriptors")
    warm = min(WARM_UP, len(sizes) - 1)
    return [
        Figure("sentinel, resident", "MB", tuple(sizes[warm:])),
        Figure(
            f"  growth over {len(sizes) - warm} restarts",
            "MB",
            (_late(sizes[warm:]) - _early(sizes[warm:]),),
            target=Target(GROWTH_MB_MAX),
        ),
        Figure(
            "  descriptors more",
            "",
            (_late(descriptors[warm:]) - _early(descriptors[warm:]),),
            target=Target(0),
        ),
        Figure("  threads more", "", (_late(threads[warm:]) - _early(threads[warm:]),), target=Target(0)),
    ]


def _follows(told: dict[str, Any], epoch: int) -> bool:
    """Tell whether a later core serves and has proven itself."""
    return told["phase"] in {"RUNNING", "SUSPECT"} and (told["core"]["epoch"] or 0) > epoch


def _early(values: list[float]) -> float:
    """Return the least of the first tenth: what it holds between two deeds."""
    return min(values[: max(1, len(values) // 10)])


def _late(values: list[float]) -> float:
    return min(values[-max(1, len(values) // 10) :])
