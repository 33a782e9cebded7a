"""Clients that book one after the other, as a household's devices would, and the count of what they were told.

Patient ones come again with the same key until they are told that it is done; frank ones ask once and keep
whatever they were told, so that every answer can be held against the ledger.
"""

import http.client
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from tests.integration.house import Answer, House

PATIENCE_S = 40.0
PAUSE_S = 0.02
#: Between two bookings of one client: several in each moment that matters, and processors left for who is tested.
PACE_S = 0.01


@dataclass(frozen=True)
class Told:
    """What a client knows of one key in the end: `status` 0 means that the connection broke."""

    key: str
    status: int
    outcome: str | None
    tries: int


@dataclass
class Clients:
    """See the module. Started and stopped by `at_work`."""

    house: House
    prefix: str
    patient: bool
    told: list[Told] = field(default_factory=list)
    stop: threading.Event = field(default_factory=threading.Event)

    def work(self, number: int) -> None:
        """Book until told to stop."""
        count = 0
        while not self.stop.is_set():
            count += 1
            self.told.append(self._book(f"{self.prefix}-{number}-{count}"))
            self.stop.wait(PACE_S)

    def _book(self, key: str) -> Told:
        give_up_at = time.monotonic() + PATIENCE_S
        tries = 0
        while True:
            tries += 1
            answer = self._ask(key)
            settled = answer is not None and answer.status < 500
            if settled or not self.patient or time.monotonic() > give_up_at:
                return Told(key, answer.status if answer else 0, answer.outcome if answer else None, tries)
            self.stop.wait(PAUSE_S)

    def _ask(self, key: str) -> Answer | None:
        try:
            return self.house.book(key)
        except (OSError, http.client.HTTPException):
            return None


@contextmanager
def at_work(house: House, count: int, prefix: str, *, patient: bool = True) -> Iterator[Clients]:
    """Let `count` clients book while the block runs; afterwards each has its last answer."""
    clients = Clients(house, prefix, patient)
    threads = [threading.Thread(target=clients.work, args=(n,), daemon=True) for n in range(count)]
    for thread in threads:
        thread.start()
    try:
        yield clients
    finally:
        clients.stop.set()
        for thread in threads:
            thread.join(PATIENCE_S + 10)
            assert not thread.is_alive(), "a client never came to its end"


def in_ledger(house: House, prefix: str) -> Counter[str]:
    """How often each key with this prefix stands in the ledger."""
    return Counter(description for description in house.booked() if description.startswith(prefix))


def assert_exactly_once(house: House, clients: Clients) -> None:
    """Hold every answer against the ledger: what was promised stands there once, nothing stands twice."""
    counts = in_ledger(house, clients.prefix)
    doubled = {key: count for key, count in counts.items() if count != 1}
    assert not doubled, f"in the ledger more than once: {doubled}"
    lost = [told for told in clients.told if told.status == 201 and told.key not in counts]
    assert not lost, f"acknowledged and not in the ledger: {lost}"
    lied = [told for told in clients.told if told.outcome == "not_done" and told.key in counts]
    assert not lied, f"told that it was not done, yet it is in the ledger: {lied}"
    strange = counts.keys() - {told.key for told in clients.told}
    assert not strange, f"in the ledger, and nobody asked for it: {strange}"
