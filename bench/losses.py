"""Whether anything is lost or doubled: many kills and freezes at random instants, under clients that book all the time.

Each blow is the start of a switch to a spare where one is ready by then, and of a cold start where it is not, so both
ways are met. The clients and the audit are those of the crowd.
"""

import random
import signal
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

from bench.crowd import NONE, SEED, Crowd
from bench.figures import Figure
from bench.instance import Watched, fill
from examples.line import Line
from examples.reading import read_ledger

BETWEEN_S_MAX = 1.5
FREEZE_EVERY = 3


def measure(folder: Path, *, blows: int, say: Callable[[str], None]) -> list[Figure]:
    """Hit the core so many times, every third time with SIGSTOP; return what failed, was lost, was doubled."""
    with Watched(folder / "losses") as instance:
        fill(instance, 0)
        crowd = Crowd(instance.address, "losses", 0.0)
        chance = random.Random(SEED)
        promoted = 0
        with crowd.at_work():
            for number in range(blows):
                time.sleep(chance.uniform(0, BETWEEN_S_MAX))
                promoted += bool((instance.status().get("spare") or {}).get("ready"))
                core = instance.core()
                core.hit(signal.SIGSTOP if number % FREEZE_EVERY == 0 else signal.SIGKILL)
                core.let_go()
                instance.until_later(core.epoch)
        instance.running()
        with Line(instance.address) as line:
            booked = Counter(str(event["key"]) for event in read_ledger(line).events)
        verdict = instance.hardcore("verify")
    for failure in crowd.failures[:5]:
        say(f"  {failure}")
    lost = [key for key in crowd.confirmed if not booked[key]]
    doubled = [key for key, times in booked.items() if times > 1]
    under = f"{blows} blows, {promoted} with a spare ready"
    return [
        Figure(f"client errors of {crowd.asked:,}, {under}", "", (len(crowd.failures),), target=NONE),
        Figure(f"lost, {len(crowd.confirmed):,} confirmed", "", (len(lost),), target=NONE),
        Figure("doubled, by key", "", (len(doubled),), target=NONE),
        Figure("faults found by `hardcore verify`", "", (0 if verdict.get("ok") else 1,), target=NONE),
    ]
