"""How long a death takes without a spare: until the guard has noticed it, and until a waiting client is answered again.

The moment of the kill is taken right before the system call; guard, killer and client share one monotonic
clock. The client asks right after the kill and waits, as somebody does who has clicked in that very moment. In
turn with each kill the same application is started bare on a copy of the same book. How soon a death can be
noticed at all is up to the kernel, which frees the dead process's memory before it tells anybody: the killer
holds a pidfd of its own, and when that one speaks is the baseline.
"""

import select
import shutil
import signal
import time
from pathlib import Path

from bench.bare import bare_start_ms
from bench.figures import Baseline, Figure, Target
from bench.instance import ONE_ACCOUNT, Watched, fill
from core.journal.store import LEDGER_FILE
from examples.line import Line

NS_PER_MS = 1e6
TRANSACTIONS = 500
#: What a death costs without a spare; with one: the part `switch`.
COLD = {"spare": False}
SEEN_MS_MAX = 5
DEATH_MS_MAX = 10_000
COLD_RATIO_MAX = 1.2
#: Where the time of a cold start goes: process made, older cores fenced off, book proven, first answer.
STEPS = ("spawned", "fenced", "ready", "serving")


def measure(folder: Path, *, kills: int, freezes: int) -> list[Figure]:
    """Kill the core so many times in each of two ways, freeze it so many times, and return what it took."""
    data, copy = folder / "deaths", folder / "bare"
    with Watched(data) as instance:
        fill(instance, TRANSACTIONS)
    copy.mkdir()
    shutil.copy(data / LEDGER_FILE, copy)  # at rest: a ledger that nobody has open is one file
    seen, told, cold, bare, steps = [], [], [], [], []
    with Watched(data, COLD) as instance:
        for _round in range(kills):
            hit_ns, told_ns, seen_ns = noticed(instance)
            told.append((told_ns - hit_ns) / NS_PER_MS)
            seen.append((seen_ns - hit_ns) / NS_PER_MS)
        for _round in range(kills):
            bare.append(bare_start_ms(copy, folder, ONE_ACCOUNT))
            cold.append(out_of_service_ms(instance, signal.SIGKILL))
            instance.quiet()
            steps.append(instance.last_timeline())
        frozen = [out_of_service_ms(instance, signal.SIGSTOP) for _round in range(freezes)]
    kernel = Baseline("the kernel's word to the killer", tuple(told))
    bare_start = Baseline("a bare uvicorn start", tuple(bare))
    return [
        Figure("kill -9 -> noticed", "ms", tuple(seen), kernel, Target(SEEN_MS_MAX)),
        Figure(
            "kill -9 -> serving again", "ms", tuple(cold), bare_start, Target(COLD_RATIO_MAX, of_ratio=True)
        ),
        *(Figure(f"  noticed -> {step}", "ms", tuple(each[step] for each in steps)) for step in STEPS),
        Figure("kill -STOP -> serving again", "ms", tuple(frozen)),
    ]


def noticed(instance: Watched) -> tuple[int, int, int]:
    """Kill the core; return when it was hit, when the kernel told the killer, when the guard saw it (ns)."""
    instance.quiet()
    core = instance.core()
    word = select.poll()
    word.register(core.pidfd, select.POLLIN)
    hit_ns = core.hit(signal.SIGKILL)
    word.poll(DEATH_MS_MAX)
    told_ns = time.monotonic_ns()
    core.let_go()
    instance.quiet()
    return hit_ns, told_ns, instance.last_exit_ns()


def out_of_service_ms(instance: Watched, number: signal.Signals) -> float:
    """Hit the core and ask at once; return how long the good answer took from the blow."""
    instance.quiet()
    with Line(instance.address) as line:
        assert line.get(ONE_ACCOUNT).good, "asked before, so that the connection stands"
        core = instance.core()
        hit_ns = core.hit(number)
        core.let_go()
        answer = line.get(ONE_ACCOUNT)
    assert answer.good, f"a waiting client was told: {answer}"
    return (answer.told_ns - hit_ns) / NS_PER_MS
