"""Is it seen, how soon, and called by its right name: each fault made for real, many times, in random order.

Whatever a guarded core can be made to suffer without a change to the host: drills, signals from outside, another
process on the ledger's lock. For each blow the incident that came of it is read: its diagnosis goes into the
table of what was done against what was said, its timeline into the figures. Before each kill of a living core
the evidence has to be complete; that is counted here, and how long it took.
"""

import random
import signal
import statistics
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bench.figures import Figure, Target
from bench.instance import Watched, fill
from examples.guarded import GuardError
from hardcore.control import client
from postmortem import bundle
from postmortem import cli as incidents

SEED = 20261122
OVER_S = 60.0
NS_PER_MS = 1e6
LOOK_EVERY_S = 0.01
RIGHT_PERCENT_MIN = 95
#: Ends of a living core: the evidence has to be on disk before the kill.
HANGS = frozenset({"FROZEN", "LOOP_BLOCKED", "SPINNING", "GIL_HELD", "DEADLOCK", "TRANSACTION_TIMEOUT"})
BUNDLE_MS_MEDIAN, BUNDLE_MS_P95 = 60, 150
#: A transaction's time is the policy's, so detection of a slow one is that long; shortened to save time.
POLICY = {"transaction_timeout_ms": 2000, "clean_after_ms": 500, "safe_retry_ms": 1000}

#: What is done -> what it has to be called.
EXPECTED: Mapping[str, str] = {
    "kill -9": "KILLED_FROM_OUTSIDE",
    "kill -STOP": "FROZEN",
    "crash": "CRASHED",
    "segv": "CRASHED",
    "exit": "EXITED",
    "freeze": "FROZEN",
    "block": "LOOP_BLOCKED",
    "spin": "SPINNING",
    "gil": "GIL_HELD",
    "deadlock": "DEADLOCK",
    "slow-tx": "TRANSACTION_TIMEOUT",
    "dblock": "DB_LOCKED",
    "diskfull": "DISK_FULL",
    "oom": "OUT_OF_MEMORY",
}
_SIGNALS = {"kill -9": signal.SIGKILL, "kill -STOP": signal.SIGSTOP}


@dataclass(slots=True)
class Tally:
    """What came of all the blows. Times are in milliseconds."""

    said: dict[str, Counter[str]] = field(default_factory=dict)
    detected: dict[str, list[float]] = field(default_factory=dict)
    bundles: list[float] = field(default_factory=list)
    hangs: int = 0
    whole: int = 0
    missing: Counter[str] = field(default_factory=Counter)
    refused: dict[str, str] = field(default_factory=dict)

    @property
    def right(self) -> tuple[int, int]:
        """How many were called by their right name, of how many."""
        right = sum(said[EXPECTED[fault]] for fault, said in self.said.items())
        return right, sum(said.total() for said in self.said.values())

    def take(self, fault: str, story: Mapping[str, Any], noticed_ms: float, box: Path) -> None:
        """Count one incident that was noticed so long after the blow; `box` is its folder."""
        self.said.setdefault(fault, Counter())[str(story["diagnosis"])] += 1
        self.detected.setdefault(fault, []).append(noticed_ms)
        if story["diagnosis"] in HANGS:
            steps = {step["step"]: step["offset_ms"] for step in story["timeline"]}
            self.hangs += 1
            self.whole += bool(story["evidence_complete"]) and steps["dumped"] <= steps["killed"]
            self.bundles.append(steps["dumped"] - steps["detected"])
            told = bundle.read_manifest(box)
            if isinstance(told, bundle.Manifest):
                self.missing.update(f"{fault}: {name}: {why}" for name, why in told.missing.items())


def measure(folder: Path, *, rounds: int, say: Callable[[str], None]) -> list[Figure]:
    """Make each fault so many times and return what was seen of them."""
    tally = Tally()
    order = [fault for fault in EXPECTED for _ in range(rounds)]
    random.Random(SEED).shuffle(order)  # an order, no secret
    with Watched(folder / "faults", POLICY) as instance:
        fill(instance, 50)
        for fault in order:
            if fault not in tally.refused:
                _blow(instance, fault, tally)
    say(matrix(tally))
    for what, often in tally.missing.most_common():
        say(f"missing {often} x {what}")
    return _figures(tally)


def _blow(instance: Watched, fault: str, tally: Tally) -> None:
    instance.quiet()
    before, blow_ns = instance.running()["last_incident"], time.monotonic_ns()
    if fault in _SIGNALS:
        core = instance.core()
        core.hit(_SIGNALS[fault])
        core.let_go()
    else:
        answer = client.ask(instance.folders.control, {"verb": "drill", "fault": fault, "yes": True})
        if not answer.get("ok"):
            tally.refused[fault] = str(answer.get("error"))
            return
    told = _over(instance, before, fault)
    box = instance.folders.incidents / told
    give_up_at = time.monotonic() + OVER_S
    while bundle.verify_bundle(box) and time.monotonic() < give_up_at:
        time.sleep(LOOK_EVERY_S)  # its report is still being put into it
    story = incidents.show_incident(instance.folders.incidents, told, "en")
    assert isinstance(story, dict), "an incident that is over has been told"
    noticed_ms = (instance.noticed_ns(blow_ns) - blow_ns) / NS_PER_MS
    tally.take(fault, story, noticed_ms, box)


def _over(instance: Watched, before: object, fault: str) -> str:
    """Wait until the incident of this blow is closed and a core serves; return its id."""
    give_up_at = time.monotonic() + OVER_S
    while True:
        told = instance.status()
        if (
            told["last_incident"] != before
            and told["incident"] is None
            and told["phase"] in {"RUNNING", "SUSPECT"}
        ):
            instance.quiet()
            return str(told["last_incident"])
        if time.monotonic() > give_up_at:
            raise GuardError(f"Nothing has come of {fault} within {OVER_S:g} s: {told['phase']}.")
        time.sleep(LOOK_EVERY_S)


def matrix(tally: Tally) -> str:
    """Return what was done against what was said, as a table for a person."""
    names = sorted({name for said in tally.said.values() for name in said})
    lines = ["done         " + "  ".join(names)]
    for fault in EXPECTED:
        if fault in tally.said:
            cells = (str(tally.said[fault][name] or ".").rjust(len(name)) for name in names)
            lines.append(f"{fault:<13}" + "  ".join(cells))
        elif fault in tally.refused:
            lines.append(f"{fault:<13}not here: {tally.refused[fault]}")
    return "\n".join(lines)


def _figures(tally: Tally) -> list[Figure]:
    right, all_of_them = tally.right
    figures = [
        Figure(f"{fault} -> noticed", "ms", tuple(tally.detected[fault]))
        for fault in EXPECTED
        if fault in tally.detected
    ]
    p95 = [
        Figure(f"{fault} -> noticed, p95", "ms", (percentile(tally.detected[fault], 95),))
        for fault in EXPECTED
        if fault in tally.detected
    ]
    wrong = 100 * (all_of_them - right) / all_of_them
    return [
        *(figure for pair in zip(figures, p95, strict=True) for figure in pair),
        Figure(
            f"called by a wrong name, of {all_of_them}", "%", (wrong,), target=Target(100 - RIGHT_PERCENT_MIN)
        ),
        Figure("evidence not whole before the kill", "", (tally.hangs - tally.whole,), target=Target(0)),
        Figure("evidence, from the verdict", "ms", tuple(tally.bundles), target=Target(BUNDLE_MS_MEDIAN)),
        Figure("evidence, p95", "ms", (percentile(tally.bundles, 95),), target=Target(BUNDLE_MS_P95)),
    ]


def percentile(values: list[float], percent: int) -> float:
    """Return the value that so many per cent of `values` do not exceed; of few, the largest."""
    return max(values) if len(values) < 20 else statistics.quantiles(values, n=100)[percent - 1]
