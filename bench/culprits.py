"""Is the culprit named: real deaths over a real house under load, and what each report says of whom.

For each fault it is known beforehand what a report has to say: the diagnosis, the rule that explains it, and whose
command it was, or that it was nobody's. Meanwhile innocents book on accounts of their own, so that naming whoever
happened to be at work counts as wrong. A poison is a real transaction on a real account under the key that the drill
armed; the rest are the drills and signals of the other measurements. What is counted is the report as it stands
once the trials are over, and how long after the incident's end it was written.
"""

import argparse
import hashlib
import itertools
import random
import signal
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bench.figures import Figure, Target
from bench.instance import TRANSACTIONS, Watched, fill, transaction
from examples.guarded import GuardError, stop_cleanly
from examples.line import Line
from hardcore.control import client
from postmortem import cli as incidents

SEED = 20261123
OVER_S = 90.0
LOOK_EVERY_S = 0.02
RIGHT_PERCENT_MIN = 95
REPORT_MS_MAX = 2_000
DEATHS = 200
POLICY = {
    "transaction_timeout_ms": 2000,
    "clean_after_ms": 500,
    "safe_retry_ms": 1000,
    "max_convictions": 1000,
}
#: What the poison is booked on; the innocents book on other accounts.
POISONED = ("assets:poisoned", "expenses:poisoned")
_SIGNALS = {"kill -9": signal.SIGKILL, "kill -STOP": signal.SIGSTOP}


@dataclass(frozen=True, slots=True)
class Expected:
    """What a report has to say. `accounts`: of the command behind it; empty: nobody may be named."""

    diagnosis: str
    rules: frozenset[str]
    accounts: tuple[str, ...] = ()


def _expected(diagnosis: str, *rules: str, accounts: tuple[str, ...] = ()) -> Expected:
    return Expected(diagnosis, frozenset(rules), accounts)


DRILLED = ("system:drill",)
EXPECTED: Mapping[str, Expected] = {
    "poison": _expected("CRASHED", "poison_died", accounts=POISONED),
    "kill -9": _expected("KILLED_FROM_OUTSIDE", "killed"),
    "kill -STOP": _expected("FROZEN", "frozen"),
    "crash": _expected("CRASHED", "crashed_at"),
    "segv": _expected("CRASHED", "crashed_at"),
    "exit": _expected("EXITED", "exited"),
    "block": _expected("LOOP_BLOCKED", "blocked"),
    "spin": _expected("SPINNING", "spinning"),
    "gil": _expected("GIL_HELD", "gil_held"),
    "deadlock": _expected("DEADLOCK", "deadlock", accounts=DRILLED),
    "slow-tx": _expected("TRANSACTION_TIMEOUT", "over_time", accounts=DRILLED),
    "dblock": _expected("DB_LOCKED", "locked_out_by", "locked_out"),
    "diskfull": _expected("DISK_FULL", "disk_full"),
    "oom": _expected("OUT_OF_MEMORY", "out_of_memory"),
}


@dataclass(slots=True)
class Tally:
    """What came of all deaths."""

    said: dict[str, Counter[str]] = field(default_factory=dict)
    report_ms: list[float] = field(default_factory=list)
    refused: dict[str, str] = field(default_factory=dict)

    def take(self, fault: str, verdict: str) -> None:
        """Count one report: `right`, or what was wrong with it."""
        self.said.setdefault(fault, Counter())[verdict] += 1

    @property
    def right(self) -> tuple[int, int]:
        """How many reports were right in everything, of how many."""
        return sum(one["right"] for one in self.said.values()), sum(one.total() for one in self.said.values())


def measure(folder: Path, *, deaths: int, say: Callable[[str], None]) -> list[Figure]:
    """Make so many deaths, the faults in turn and in a mixed order, and return how many were explained rightly."""
    tally = Tally()
    order = list(itertools.islice(itertools.cycle(EXPECTED), deaths))
    random.Random(SEED).shuffle(order)  # an order, no secret
    with Watched(folder / "culprits", POLICY) as instance:
        fill(instance, 20)
        _open_poisoned(instance)
        with _innocents(instance.address):
            for fault in order:
                if fault not in tally.refused:
                    _death(instance, fault, tally)
    for fault, said in tally.said.items():
        say(f"{fault:<12}" + ", ".join(f"{count} x {verdict}" for verdict, count in said.most_common()))
    for fault, why in tally.refused.items():
        say(f"{fault:<12}not here: {why}")
    right, whole = tally.right
    if not whole:
        raise GuardError("No death could be made.")
    wrong = 100 * (whole - right) / whole
    return [
        Figure(
            f"culprit or cause named wrongly, of {whole}",
            "%",
            (wrong,),
            target=Target(100 - RIGHT_PERCENT_MIN),
        ),
        Figure(
            "report, after the incident's end", "ms", tuple(tally.report_ms), target=Target(REPORT_MS_MAX)
        ),
    ]


def verdict(story: Mapping[str, Any], expected: Expected) -> str:
    """Return `right`, or the first thing that a report says wrongly."""
    if story["diagnosis"] != expected.diagnosis:
        return f"called {story['diagnosis']}"
    if not expected.rules & {finding["rule"] for finding in story["findings"]}:
        return "not explained"
    culprit = story["culprit"]
    named = tuple(culprit["account_ids"]) if culprit["confidence"] else ()
    if set(named) != set(expected.accounts):
        return f"named {', '.join(named) or 'nobody'}"
    return "right" if not expected.accounts or culprit["transaction_id"] else "no transaction"


def _death(instance: Watched, fault: str, tally: Tally) -> None:
    """Make one death and judge its report once everybody has been tried."""
    instance.quiet()
    before = instance.running()["last_incident"]
    name = _blow(instance, fault, tally)
    if name is None:
        return
    incident = _over(instance, before, fault)
    folder = instance.folders.incidents / incident
    story = _settled(instance, incident, name)
    closed_s, written_s = (folder / "incident.json").stat().st_mtime, (folder / "report.json").stat().st_mtime
    tally.report_ms.append(max(0.0, (written_s - closed_s) * 1000))
    tally.take(fault, verdict(story, EXPECTED[fault]))


def _blow(instance: Watched, fault: str, tally: Tally) -> str | None:
    """Make the fault; return the name of the poison, empty if it is none. None: this machine can't make it."""
    if fault in _SIGNALS:
        core = instance.core()
        core.hit(_SIGNALS[fault])
        core.let_go()
        return ""
    answer = client.ask(instance.folders.control, {"verb": "drill", "fault": fault, "yes": True})
    if not answer.get("ok"):
        tally.refused[fault] = str(answer.get("error"))
        return None
    if fault != "poison":
        return ""
    key = str(answer["key"])
    threading.Thread(target=_send_poison, args=(instance.address, key), daemon=True).start()
    return hashlib.sha256(key.encode()).hexdigest()[:32]


def _send_poison(address: tuple[str, int], key: str) -> None:
    with Line(address) as line:
        line.post(TRANSACTIONS, _booking(POISONED, key), key)  # each another request: the same one is refused


def _booking(accounts: tuple[str, ...], words: str) -> dict[str, Any]:
    lines = zip(accounts, ("-1", "1"), strict=True)
    postings = [{"account": account, "amount": amount, "currency": "KRW"} for account, amount in lines]
    return {**transaction(words), "postings": postings}


def _open_poisoned(instance: Watched) -> None:
    with Line(instance.address) as line:
        for account in POISONED:
            kind = "asset" if account.startswith("assets") else "expense"
            body = {"id": account, "name": account, "type": kind, "currency": "KRW"}
            if not line.post("/api/ledger/accounts", body, f"open-{account}").good:
                raise GuardError(f"The account {account} could not be opened.")


@contextmanager
def _innocents(address: tuple[str, int]) -> Iterator[None]:
    """Book on other accounts all the while, one request after the other; what becomes of them is not asked."""
    stop = threading.Event()

    def book() -> None:
        for number in itertools.count():
            if stop.is_set():
                return
            with Line(address) as line:
                line.post(TRANSACTIONS, transaction("innocent"), f"innocent-{number}")
            stop.wait(0.01)

    thread = threading.Thread(target=book, daemon=True)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join(OVER_S)


def _over(instance: Watched, before: object, fault: str) -> str:
    """Wait until the incident of this blow is closed and a core serves; return its id."""
    give_up_at = time.monotonic() + OVER_S
    while True:
        told = instance.status()
        new = told["last_incident"] != before and told["incident"] is None
        if new and told["phase"] in {"RUNNING", "SUSPECT"}:
            instance.quiet()
            return str(told["last_incident"])
        if time.monotonic() > give_up_at:
            raise GuardError(f"Nothing has come of {fault} within {OVER_S:g} s: {told['phase']}.")
        time.sleep(LOOK_EVERY_S)


def _settled(instance: Watched, incident: str, poison: str) -> Mapping[str, Any]:
    """Return the report once every suspect of it, and the poison above all, has had its trial."""
    give_up_at = time.monotonic() + OVER_S
    while True:
        story = incidents.show_incident(instance.folders.incidents, incident)
        tried = {trial["name"] for trial in story["trials"]} if isinstance(story, dict) else set()
        if isinstance(story, dict) and (poison in tried or not poison) and tried >= set(story["suspects"]):
            return story
        if time.monotonic() > give_up_at:
            if isinstance(story, dict):
                return story  # judged as it is: a trial that never came is a report that never named anybody
            raise GuardError(f"There is no report of {incident}.")
        time.sleep(LOOK_EVERY_S)


def main() -> int:
    """Measure as many deaths as asked for; return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m bench.culprits", description="Is the culprit named?")
    parser.add_argument("--count", type=int, default=DEATHS, help="deaths (%(default)s)")
    asked = parser.parse_args()
    stop_cleanly()
    with tempfile.TemporaryDirectory(prefix="bench-") as folder:
        figures = measure(Path(folder), deaths=asked.count, say=lambda words: print(words, flush=True))
    print("\n".join(figure.line() for figure in figures))
    return 0


if __name__ == "__main__":
    sys.exit(main())
