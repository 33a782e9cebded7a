"""What the guard weighs while nothing happens and while much does: processor time and memory, from outside.

The numbers are the kernel's, read from /proc over windows of some seconds; the guard's own account of itself
is not asked. Memory is resident memory with everything shared counted in full, the most unfavourable way.
"""

import time
from pathlib import Path

import psutil

from bench.crowd import Crowd
from bench.figures import Figure, Target
from bench.instance import Watched, fill

WINDOWS = 4
SETTLE_S = 2.0
CPU_PERCENT_MAX = 2.0
SENTINEL_MB_MAX = 40
LAUNCHER_MB_MAX = 12
MB = 1e6


def measure(folder: Path, *, quiet_s: float, busy_s: float) -> list[Figure]:
    """Watch the guard for so many seconds in quiet and under load."""
    with Watched(folder / "weight") as instance:
        fill(instance, 0)
        told = instance.running()
        sentinel, launcher = (psutil.Process(told[part]["pid"]) for part in ("sentinel", "launcher"))
        time.sleep(SETTLE_S)
        quiet_percent, quiet_mb = _windows(sentinel, quiet_s)
        with Crowd(instance.address, "busy", 0.0).at_work():
            busy_percent, busy_mb = _windows(sentinel, busy_s)
        launcher_mb = launcher.memory_info().rss / MB
    cpu, memory = Target(CPU_PERCENT_MAX), Target(SENTINEL_MB_MAX)
    return [
        Figure("sentinel in quiet, of one core", "%", quiet_percent, target=cpu),
        Figure("sentinel under load, of one core", "%", busy_percent, target=cpu),
        Figure("sentinel in quiet, resident", "MB", quiet_mb, target=memory),
        Figure("sentinel under load, resident", "MB", busy_mb, target=memory),
        Figure("launcher, resident", "MB", (launcher_mb,), target=Target(LAUNCHER_MB_MAX)),
    ]


def _windows(process: psutil.Process, total_s: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the processor's share in percent and the memory in MB, window by window."""
    percents, sizes = [], []
    for _window in range(WINDOWS):
        began, used = time.monotonic(), _cpu_s(process)
        time.sleep(total_s / WINDOWS)
        percents.append(100 * (_cpu_s(process) - used) / (time.monotonic() - began))
        sizes.append(process.memory_info().rss / MB)
    return tuple(percents), tuple(sizes)


def _cpu_s(process: psutil.Process) -> float:
    """Return the processor time of the process and of all children it has waited for, in seconds."""
    return sum(process.cpu_times()[:4])
