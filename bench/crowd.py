"""A crowd of clients over a core that is killed: what each was told, and what is in the book afterwards.

Twice: paced clients that read and book at a steady rate, as people do, and clients that book as fast as they
are answered, so that every kill meets a batch in the making. All are patient for the ten seconds that a gateway
may hold them, ask each thing once and count every answer that is not the good one. The book is then read key by
key: what was confirmed has to be there, once.
"""

import random
import signal
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from bench.figures import Figure, Target
from bench.instance import ONE_ACCOUNT, TRANSACTIONS, Watched, fill, transaction
from examples.line import Line
from examples.reading import read_ledger

CLIENTS = 4
PACE_S = 0.02
BETWEEN_S_MAX = 0.3
SEED = 7
NONE = Target(0)


@dataclass(slots=True)
class Crowd:
    """Clients at work. `pace_s` is the time between two requests of one client; 0: as fast as it is answered."""

    address: tuple[str, int]
    name: str
    pace_s: float
    confirmed: list[str] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)
    asked: int = 0
    _lock: threading.Lock = field(default_factory=threading.Lock)
    _over: threading.Event = field(default_factory=threading.Event)

    @contextmanager
    def at_work(self) -> Iterator[None]:
        """Let the clients work; in the end each has its last answer."""
        threads = [threading.Thread(target=self._work, args=(number,)) for number in range(CLIENTS)]
        for thread in threads:
            thread.start()
        try:
            yield
        finally:
            self._over.set()
            for thread in threads:
                thread.join()

    def _work(self, client: int) -> None:
        number = 0
        with Line(self.address) as line:
            while not self._over.wait(self.pace_s):
                number += 1
                if self.pace_s and number % 2:
                    self._note(None, line.get(ONE_ACCOUNT))
                else:
                    key = f"{self.name}-{client}-{number}"
                    self._note(key, line.post(TRANSACTIONS, transaction(key), key))

    def _note(self, key: str | None, answer: object) -> None:
        with self._lock:
            self.asked += 1
            if not getattr(answer, "good", False):
                self.failures.append(f"{key or 'a read'}: {answer}")
            elif key is not None:
                self.confirmed.append(key)


def measure(folder: Path, *, paced_kills: int, kills: int, say: Callable[[str], None]) -> list[Figure]:
    """Kill the core under paced clients and under hurried ones; return what failed, was lost, was doubled."""
    with Watched(folder / "crowd") as instance:
        fill(instance, 0)
        paced = Crowd(instance.address, "paced", PACE_S)
        _under_kills(instance, paced, paced_kills)
        hurried = Crowd(instance.address, "hurried", 0.0)
        _under_kills(instance, hurried, kills)
        instance.running()
        with Line(instance.address) as line:
            booked = Counter(str(event["key"]) for event in read_ledger(line).events)
        verdict = instance.hardcore("verify")
    for failure in (paced.failures + hurried.failures)[:5]:
        say(f"  {failure}")
    confirmed = paced.confirmed + hurried.confirmed
    lost = [key for key in confirmed if not booked[key]]
    doubled = [key for key, times in booked.items() if times > 1]
    under = f"{kills} kills, {hurried.asked:,} transactions"
    return [
        Figure(
            f"failed of {paced.asked:,} requests, {paced_kills} kills",
            "",
            (len(paced.failures),),
            target=NONE,
        ),
        Figure(f"client errors, {under}", "", (len(hurried.failures),), target=NONE),
        Figure(f"lost, {len(confirmed):,} confirmed", "", (len(lost),), target=NONE),
        Figure("doubled, by key", "", (len(doubled),), target=NONE),
        Figure("faults found by `hardcore verify`", "", (0 if verdict.get("ok") else 1,), target=NONE),
    ]


def _under_kills(instance: Watched, crowd: Crowd, kills: int) -> None:
    chance = random.Random(SEED)
    with crowd.at_work():
        for _kill in range(kills):
            core = instance.core()
            time.sleep(chance.uniform(0, BETWEEN_S_MAX))
            core.hit(signal.SIGKILL)
            core.let_go()
            instance.until_later(core.epoch)
