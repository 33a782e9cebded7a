"""Who watches the watcher: the sentinel is killed or stopped, and it is measured how long nobody watched.

It is watched again when the next sentinel's own page shows the first beat of the loop that decides: from then on a core
that dies is seen. Three ways: the launcher starts it, the agents in gateway and core do because there is no launcher, and
the agents end one that stands still. Each loss is to be the first: a sentinel that lived for a moment only is followed after a pause, and the
agents act a few times in a minute only. Meanwhile a client asks all the time; it may not notice, and the core stays.
"""

import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from bench.figures import Figure, Target
from bench.instance import ONE_ACCOUNT, Watched, fill
from examples.guarded import GuardError, Held
from examples.line import Line
from hardcore.host.sentinel_page import SentinelBeat, read_page
from hardcore.launcher import SHORT_LIFE_S

NS_PER_MS = 1e6
WATCHED_MS_MAX = 1000
OVER_S = 60.0
LOOK_EVERY_S = 0.001
ASK_EVERY_S = 0.02


@dataclass(slots=True)
class Asked:
    """What a client was answered all the while."""

    answers: int = 0
    failed: int = 0


def measure(folder: Path, *, kills: int, alone: int, stops: int) -> list[Figure]:
    """Lose the sentinel so many times in each way, and return how long nobody watched."""
    with Watched(folder / "watchers") as instance:
        fill(instance, 10)
        core, gateway = instance.running()["core"]["pid"], instance.status()["gateway"]["pid"]
        with _client(instance) as asked:
            launcher = _hold(instance.status()["launcher"]["pid"])
            launcher.hit(signal.SIGSTOP)  # as good as gone, and it can still end everything afterwards
            by_agents = [_unwatched_ms(instance, signal.SIGKILL) for _ in range(alone)]
            launcher.hit(signal.SIGCONT)
            launcher.let_go()
            stopped = [_unwatched_ms(instance, signal.SIGSTOP) for _ in range(stops)]
            killed = [_unwatched_ms(instance, signal.SIGKILL) for _ in range(kills)]
        # A guard that has just begun says so before it has found the gateway of the one before.
        instance.until(lambda told: told["gateway"]["pid"] is not None, "a gateway", OVER_S)
        told = instance.running()
        changed = (told["core"]["pid"] != core) + (told["gateway"]["pid"] != gateway)
    return [
        Figure("sentinel killed -> watched again", "ms", tuple(killed), target=Target(WATCHED_MS_MAX)),
        Figure("  without a launcher", "ms", tuple(by_agents)),
        Figure("sentinel stopped -> watched again", "ms", tuple(stopped)),
        Figure(f"  failed requests meanwhile, of {asked.answers}", "", (asked.failed,), target=Target(0)),
        Figure("  another core or gateway", "", (changed,), target=Target(0)),
    ]


def _unwatched_ms(instance: Watched, number: signal.Signals) -> float:
    """Lose the sentinel once; return how long it took until another one's loop beat."""
    instance.quiet()
    before = _page(instance)
    assert before is not None, "one that answers at its door has a page"
    time.sleep(max(0.0, SHORT_LIFE_S - (time.monotonic_ns() - before.began_ns) / 1e9))
    sentinel = _hold(before.pid)
    hit_ns = sentinel.hit(number)
    sentinel.let_go()
    give_up_at = time.monotonic() + OVER_S
    while True:
        found = _page(instance)
        if found is not None and found.pid != before.pid and found.loop_ns:
            return (found.loop_ns - hit_ns) / NS_PER_MS
        if time.monotonic() > give_up_at:
            raise GuardError(f"Nobody watches {OVER_S:g} s after signal {number}.")
        time.sleep(LOOK_EVERY_S)


def _hold(pid: int) -> Held:
    return Held(pid, os.pidfd_open(pid), 0)


def _page(instance: Watched) -> SentinelBeat | None:
    return read_page(instance.folders.sentinel_page)


@contextmanager
def _client(instance: Watched) -> Iterator[Asked]:
    """Ask all the while on a connection of its own."""
    asked, over = Asked(), threading.Event()

    def ask_on() -> None:
        with Line(instance.address) as line:
            while not over.wait(ASK_EVERY_S):
                answer = line.get(ONE_ACCOUNT)
                asked.answers += 1
                asked.failed += not answer.good

    client = threading.Thread(target=ask_on)
    client.start()
    try:
        yield asked
    finally:
        over.set()
        client.join()
