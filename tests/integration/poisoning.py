"""Poisons for the tests: a drill arms a request, and a test decides what is sent under its key, and beside what."""

import hashlib
from concurrent.futures import Future, ThreadPoolExecutor
from http.client import HTTPException
from threading import Event
from typing import Any

from tests.integration.house import Answer, House, transaction
from tests.waiting import until

TRIAL_S = 60.0
PACE_S = 0.01


def armed(house: House) -> str:
    """The key under which the next request kills whoever carries it out."""
    answer = until(lambda: _asked(house), "the drill to be taken")
    assert answer is not None
    return str(answer["key"])


def _asked(house: House) -> dict[str, Any] | None:
    answer = house.order("drill", fault="poison", yes=True)
    return answer if answer.get("ok") else None


def name_of(key: str) -> str:
    return hashlib.sha256(key.encode()).hexdigest()[:32]


def rules(house: House) -> list[dict[str, Any]]:
    told = house.order("quarantine")
    assert told["ok"], told
    found: list[dict[str, Any]] = told["quarantine"]["rules"]
    return found


def letter_of(house: House, key: str) -> str:
    """Wait until what was sent under this key is set aside; its number."""

    def look() -> str | None:
        if not house.status():
            return None
        return next((rule["id"] for rule in rules(house) if rule.get("name") == name_of(key)), None)

    found = until(look, f"a letter for {name_of(key)}", TRIAL_S)
    assert found is not None
    return found


def house_story(house: House, incident: str) -> dict[str, Any]:
    story: dict[str, Any] = house.cli("--json", "incidents", "show", incident).told
    return story


class Load:
    """Customers who book one won after the other, each under a key of its own, until they are told to stop.

    What was acknowledged is in `booked`, what was answered otherwise in `others`.
    """

    def __init__(self, house: House, name: str, customers: int = 3) -> None:
        self.booked: list[str] = []
        self.others: list[tuple[str, Answer]] = []
        self._house = house
        self._stop = Event()
        self._pool = ThreadPoolExecutor(customers + 16)
        self._under_way: list[Future[None]] = [
            self._pool.submit(self._book_on, f"{name}-{number}") for number in range(customers)
        ]

    def send(self, key: str, description: str) -> "Future[Answer]":
        """Send one transaction beside the load."""
        return self._pool.submit(
            self._house.ask, "POST", "/api/ledger/transactions", transaction(description), key=key
        )

    def _book_on(self, name: str) -> None:
        count = 0
        while not self._stop.wait(PACE_S):
            count += 1
            key = f"{name}-{count}"
            try:
                answer = self._house.book(key)
            except (OSError, HTTPException):
                continue  # its gateway was killed under it: nobody was told anything
            if answer.status == 201:
                self.booked.append(key)
            else:
                self.others.append((key, answer))

    def go_on(self) -> None:
        """Wait until somebody more was served."""
        before = len(self.booked)
        until(lambda: len(self.booked) > before, "somebody to be served")

    def stop(self) -> None:
        self._stop.set()
        self._pool.shutdown(wait=True)
