"""What a poison costs, and what a death from outside does not: deaths, refused innocents, doubled bookings, the outage.

Each round arms one request that kills whoever carries it out and sends it among ten innocents at the same moment, under
a crowd that books all the time. It has to cost one death, be set aside, and no innocent may be refused. Then the core
is killed from outside again and again under the same crowd, and nobody may be convicted or even held.
"""

import random
import signal
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bench.crowd import NONE, SEED, Crowd
from bench.figures import Figure, Target
from bench.instance import TRANSACTIONS, Watched, fill, transaction
from examples.guarded import GuardError
from examples.line import Answer, Broken, Line
from examples.reading import read_ledger
from hardcore.control import client

INNOCENTS = 10
OUTAGE_MS = 200
PACE_S = 0.01
BETWEEN_S_MAX = 0.35
SET_ASIDE = 422
OVER_S = 40.0
LOOK_EVERY_S = 0.02
DRILL = "/api/ledger/drill"


@dataclass(slots=True)
class Round:
    """One poison: how many deaths it cost, how long nobody was served, what its company and itself were told."""

    deaths: int = 0
    outage_ms: float = 0.0
    refused: list[str] = field(default_factory=list)
    booked: list[str] = field(default_factory=list)
    status: int | None = None


def measure_poison(folder: Path, *, rounds: int, say: Callable[[str], None]) -> list[Figure]:
    """Send so many poisons, one at a time, each among innocents; return what they cost."""
    with Watched(folder / "poison") as instance:
        fill(instance, 0)
        crowd = Crowd(instance.address, "poison", PACE_S)
        with crowd.at_work():
            told = [_round(instance, number) for number in range(rounds)]
        _at_rest(instance)
        doubled, lost = _against_the_book(
            instance, [*crowd.confirmed, *(key for one in told for key in one.booked)]
        )
        letters = _letters(instance)
        verdict = instance.hardcore("verify")
    for line in (*(word for one in told for word in one.refused), *crowd.failures)[:5]:
        say(f"  {line}")
    company = f"{rounds} poisons, each among {INNOCENTS} innocents"
    return [
        Figure("deaths for one poison", "", tuple(float(one.deaths) for one in told), target=Target(1)),
        Figure("fault -> serving", "ms", tuple(one.outage_ms for one in told), target=Target(OUTAGE_MS)),
        Figure(f"innocents refused, {company}", "", (sum(len(one.refused) for one in told),), target=NONE),
        Figure(f"failed of {crowd.asked:,} other requests", "", (len(crowd.failures),), target=NONE),
        Figure("poisons not told that they are set aside", "", (sum(one.status != SET_ASIDE for one in told),), target=NONE),
        Figure("letters missing or too many", "", (abs(letters - rounds),), target=NONE),
        Figure("lost, by key", "", (lost,), target=NONE),
        Figure("doubled, by key", "", (doubled,), target=NONE),
        Figure("faults found by `hardcore verify`", "", (0 if verdict.get("ok") else 1,), target=NONE),
    ]  # fmt: skip


def measure_outside(folder: Path, *, kills: int, say: Callable[[str], None]) -> list[Figure]:
    """Kill the core so many times from outside, under clients that book all the time; return whom that convicted."""
    with Watched(folder / "outside") as instance:
        fill(instance, 0)
        crowd = Crowd(instance.address, "outside", 0.0)
        chance = random.Random(SEED)
        with crowd.at_work():
            for _kill in range(kills):
                core = instance.core()
                time.sleep(chance.uniform(0, BETWEEN_S_MAX))
                core.hit(signal.SIGKILL)
                core.let_go()
                instance.until_later(core.epoch)
        _at_rest(instance)
        doubled, lost = _against_the_book(instance, crowd.confirmed)
        letters = _letters(instance)
    for failure in crowd.failures[:5]:
        say(f"  {failure}")
    return [
        Figure(f"convicted or held, {kills} kills from outside", "", (letters,), target=NONE),
        Figure(f"failed of {crowd.asked:,} requests", "", (len(crowd.failures),), target=NONE),
        Figure("lost, by key", "", (lost,), target=NONE),
        Figure("doubled, by key", "", (doubled,), target=NONE),
    ]


def _round(instance: Watched, number: int) -> Round:
    told = _at_rest(instance)
    before = int(told["core"]["epoch"])
    armed = client.ask(instance.folders.control, {"verb": "drill", "fault": "poison", "yes": True})
    if armed.get("ok") is not True:
        raise GuardError(f"The poison was refused: {armed}")
    result, together = Round(), threading.Barrier(INNOCENTS + 1)
    poison = threading.Thread(target=_poison, args=(instance, str(armed["key"]), together, result))
    innocents = [
        threading.Thread(target=_innocent, args=(instance, f"innocent-{number}-{one}", together, result))
        for one in range(INNOCENTS)
    ]
    for thread in (poison, *innocents):
        thread.start()
    for thread in (poison, *innocents):
        thread.join()
    after = _at_rest(instance)
    result.deaths = int(after["core"]["epoch"]) - before
    story = instance.hardcore("incidents", "show", str(after["last_incident"]))
    result.outage_ms = float(story["outage_ms"] or 0.0)
    return result


def _poison(instance: Watched, key: str, together: threading.Barrier, result: Round) -> None:
    with Line(instance.address) as line:
        together.wait()
        answer = line.post(DRILL, key, key)  # each a request of its own
        result.status = answer.status if isinstance(answer, Answer) else None


def _innocent(instance: Watched, key: str, together: threading.Barrier, result: Round) -> None:
    with Line(instance.address) as line:
        together.wait()
        answer: Answer | Broken = line.post(TRANSACTIONS, transaction(key), key)
        (result.booked if answer.good else result.refused).append(key if answer.good else f"{key}: {answer}")


def _at_rest(instance: Watched) -> dict[str, Any]:
    """Wait until nothing is under way: no incident, no suspect, and a spare that waits."""
    give_up_at = time.monotonic() + OVER_S
    while True:
        told = instance.status()
        spare = told.get("spare") or {}
        if (
            told["core"]["ready"]
            and told["incident"] is None
            and spare.get("ready")
            and not _suspects(instance)
        ):
            return told
        if time.monotonic() > give_up_at:
            raise GuardError(f"It is not at rest after {OVER_S:g} s: {told['phase']}.")
        time.sleep(LOOK_EVERY_S)


def _rules(instance: Watched) -> Mapping[str, Any]:
    told = client.ask(instance.folders.control, {"verb": "quarantine"})["quarantine"]
    assert isinstance(told, Mapping), "it is the file"
    return told


def _suspects(instance: Watched) -> int:
    return len(_rules(instance)["suspects"])


def _letters(instance: Watched) -> int:
    return sum(rule.get("type") == "letter" for rule in _rules(instance)["rules"])


def _against_the_book(instance: Watched, confirmed: list[str]) -> tuple[int, int]:
    """Return how many keys stand in the book twice, and how many confirmed ones not at all."""
    with Line(instance.address) as line:
        booked = Counter(str(event["key"]) for event in read_ledger(line).events)
    return sum(times > 1 for times in booked.values()), sum(not booked[key] for key in confirmed)
