"""Does it leave a healthy core alone: load of every kind for as long as asked, and not one kill.

Sixteen processes that only compute, a disk that is written and flushed without a pause, the core stopped for 200
ms again and again, and full garbage collections over three million objects in it: each of them makes a core late,
none makes it ill. Clients go on meanwhile, so that an outage would also be seen from outside. One kill is a
failure of the whole part, whatever its reason.
"""

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from bench.crowd import Crowd
from bench.figures import Figure, Target
from bench.instance import Watched, fill
from hardcore.control import client

SPINNERS = 16
FLOOD_BYTES = 8 << 20
FLOOD_FILES = 8
STOP_S = 0.2
STOP_EVERY_S = 3.0
COLLECT_EVERY_S = 20.0
SAY_EVERY_S = 60.0
PACE_S = 0.1
NONE = Target(0)


def measure(folder: Path, *, seconds: float, say: Callable[[str], None]) -> list[Figure]:
    """Load the machine for so long and return what became of the core."""
    with Watched(folder / "peace") as instance, ExitStack() as load:
        fill(instance, 50)
        first = instance.running()
        crowd = Crowd(instance.address, "peace", PACE_S)
        for _ in range(SPINNERS):
            load.enter_context(_beside(_spin))
        load.enter_context(_beside(_flood, folder))
        stops = load.enter_context(_again(STOP_EVERY_S, lambda: _stop(instance)))
        collections = load.enter_context(_again(COLLECT_EVERY_S, lambda: _collect(instance)))
        load.enter_context(crowd.at_work())
        until = time.monotonic() + seconds
        while (left_s := until - time.monotonic()) > 0:
            time.sleep(min(left_s, SAY_EVERY_S))
            told = instance.status()
            say(
                f"{max(0.0, until - time.monotonic()):.0f} s to go: {told['state']}, {len(stops)} stops, "
                f"{len(collections)} collections, {crowd.asked} requests, {len(crowd.failures)} not answered well, "
                f"late ticks {told['sentinel']['late_ticks']}"
            )
            if told["core"]["pid"] != first["core"]["pid"]:
                break
        last = instance.status()
    kills = last["core"]["epoch"] - first["core"]["epoch"] if last["core"]["epoch"] else 1
    return [
        Figure(f"kills in {seconds / 60:.1f} minutes of load", "", (kills,), target=NONE),
        Figure("incidents", "", (int(last["last_incident"] != first["last_incident"]),), target=NONE),
        Figure("requests under load", "", (crowd.asked,)),
        Figure("  not answered well", "", (len(crowd.failures),)),
        Figure("  stops of 200 ms", "", (len(stops),)),
        Figure("  collections over 3 million objects", "", (len(collections),)),
        Figure("  ticks of the guard that came late", "", (last["sentinel"]["late_ticks"],)),
    ]


@contextmanager
def _beside(work: Callable[..., None], *given: object) -> Iterator[None]:
    """Have a process of its own do this until the end."""
    process = multiprocessing.get_context("spawn").Process(target=work, args=given, daemon=True)
    process.start()
    try:
        yield
    finally:
        process.kill()
        process.join()


def _spin() -> None:
    while True:
        pass


def _flood(folder: Path) -> None:
    """Write and flush, over and over, in a few files."""
    block = os.urandom(FLOOD_BYTES)
    number = 0
    while True:
        with (folder / f"flood-{number % FLOOD_FILES}").open("wb") as file:
            file.write(block)
            file.flush()
            os.fsync(file.fileno())
        number += 1


@contextmanager
def _again(every_s: float, deed: Callable[[], bool]) -> Iterator[list[float]]:
    """Do something again and again on a thread; give the list of when it was done."""
    done: list[float] = []
    over = threading.Event()

    def work() -> None:
        while not over.wait(every_s):
            if deed():
                done.append(time.monotonic())

    thread = threading.Thread(target=work)
    thread.start()
    try:
        yield done
    finally:
        over.set()
        thread.join()


def _stop(instance: Watched) -> bool:
    """Stop the core for a moment, as a debugger or a suspended shell would."""
    core = instance.core()
    try:
        core.hit(signal.SIGSTOP)
        time.sleep(STOP_S)
    finally:
        core.hit(signal.SIGCONT)
        core.let_go()
    return True


def _collect(instance: Watched) -> bool:
    """Have the core collect garbage over three million objects; refused while it is not well just now."""
    return (
        client.ask(instance.folders.control, {"verb": "drill", "fault": "gc", "yes": True}).get("ok") is True
    )
