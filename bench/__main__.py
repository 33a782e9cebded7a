"""The numbers of this machine, beside their baselines: `make bench`, or `python -m bench [PART ...]`.

Each part starts instances of its own in a temporary folder and leaves nothing behind. A missed target is said
and is no failure: what a shared machine can do is not for a build to decide. Two parts are scripts of their
own, which measure a piece by itself and print what they found.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from bench import (
    bench_gateway,
    crowd,
    culprits,
    dashboard,
    deaths,
    doors,
    faults,
    forecasts,
    gateway_lost,
    imports,
    ledger,
    losses,
    peace,
    poison_row,
    poisons,
    promises,
    rates,
    restarts,
    screen,
    switches,
    tabs,
    watchers,
    weight,
)
from bench.figures import Figure
from bench.machine import described, machine
from examples.guarded import GuardError, stop_cleanly
from examples.reading import UnreadableError


@dataclass(frozen=True, slots=True)
class Part:
    """A part: what it is about, and how it is measured in full and as a smoke test."""

    about: str
    full: Callable[[Path], list[Figure]]
    quick: Callable[[Path], list[Figure]]


@dataclass(frozen=True, slots=True)
class Script:
    """A part that prints by itself."""

    about: str
    quick: tuple[str, ...]
    long: bool = False


def note(words: str) -> None:
    """Say something beside the figures, out of a program's way."""
    print(words, file=sys.stderr, flush=True)


PARTS: dict[str, Part] = {
    "weight": Part(
        "what the guard weighs",
        lambda folder: weight.measure(folder, quiet_s=20, busy_s=8),
        lambda folder: weight.measure(folder, quiet_s=2, busy_s=2),
    ),
    "deaths": Part(
        "a death, from the blow to the next good answer",
        lambda folder: deaths.measure(folder, kills=9, freezes=5),
        lambda folder: deaths.measure(folder, kills=1, freezes=1),
    ),
    "gateway_lost": Part(
        "a gateway's loss, until a client that dials is answered",
        lambda folder: gateway_lost.measure(folder, kills=20, freezes=5),
        lambda folder: gateway_lost.measure(folder, kills=1, freezes=1),
    ),
    "switch": Part(
        "what a client sees while the core is changed for the spare",
        lambda folder: switches.measure(folder, kills=20, hangs=5, switches=10),
        lambda folder: switches.measure(folder, kills=1, hangs=1, switches=1),
    ),
    "crowd": Part(
        "clients that wait while the core is killed",
        lambda folder: crowd.measure(folder, paced_kills=5, kills=30, say=note),
        lambda folder: crowd.measure(folder, paced_kills=1, kills=2, say=note),
    ),
    "rates": Part(
        "how much goes through",
        lambda folder: rates.measure(folder, rounds=5, seconds=2),
        lambda folder: rates.measure(folder, rounds=1, seconds=1),
    ),
    "gateway": Part(
        "what the gateway costs by itself",
        lambda folder: bench_gateway.measure(folder, rounds=5, seconds=2, say=note),
        lambda folder: bench_gateway.measure(folder, rounds=1, seconds=0.5, say=note),
    ),
    "tabs": Part(
        "a thousand open tabs over a death",
        lambda folder: tabs.measure(folder, tabs=1000, kills=5),
        lambda folder: tabs.measure(folder, tabs=100, kills=1),
    ),
    "screen": Part(
        "what stands on a person's screen in an outage, and when; what the pages weigh (5 minutes)",
        lambda folder: screen.measure(folder, rounds=20, visits=20),
        lambda folder: screen.measure(folder, rounds=1, visits=1),
    ),
    "watchers": Part(
        "the guard itself is lost, until it is watched again",
        lambda folder: watchers.measure(folder, kills=20, alone=3, stops=2),
        lambda folder: watchers.measure(folder, kills=1, alone=1, stops=1),
    ),
    "doors": Part(
        "how soon a monitor is answered while everything else goes wrong",
        lambda folder: doors.measure(folder, asks=200, half_open=1000),
        lambda folder: doors.measure(folder, asks=5, half_open=100),
    ),
    "dashboard": Part(
        "each page of the dashboard, with all that is ever kept",
        lambda folder: dashboard.measure(folder, folders=200, lines=10_000, held=1_000, rounds=20, say=note),
        lambda folder: dashboard.measure(folder, folders=5, lines=200, held=20, rounds=2, say=note),
    ),
}
#: Long ones, measured only when they are named.
LONG: dict[str, Part] = {
    "faults": Part(
        "each fault many times: seen, how soon, and called by its right name (15 minutes)",
        lambda folder: faults.measure(folder, rounds=20, say=note),
        lambda folder: faults.measure(folder, rounds=1, say=note),
    ),
    "culprits": Part(
        "200 deaths of every kind: is the command behind each named, and nobody else (20 minutes)",
        lambda folder: culprits.measure(folder, deaths=culprits.DEATHS, say=note),
        lambda folder: culprits.measure(folder, deaths=len(culprits.EXPECTED), say=note),
    ),
    "losses": Part(
        "200 kills and freezes at random instants: nothing lost, nothing doubled (8 minutes)",
        lambda folder: losses.measure(folder, blows=200, say=note),
        lambda folder: losses.measure(folder, blows=3, say=note),
    ),
    "peace": Part(
        "load of every kind for 30 minutes, and not one kill",
        lambda folder: peace.measure(folder, seconds=1800, say=note),
        lambda folder: peace.measure(folder, seconds=30, say=note),
    ),
    "poison": Part(
        "one poison among ten innocents under load: one death, nobody else refused (3 minutes)",
        lambda folder: poisons.measure_poison(folder, rounds=20, say=note),
        lambda folder: poisons.measure_poison(folder, rounds=1, say=note),
    ),
    "row": Part(
        "one poison among the 10,000 rows of a bank's file: that row, and nothing of the rest (2 minutes)",
        lambda folder: poison_row.measure(folder, rows=10_000, say=note),
        lambda folder: poison_row.measure(folder, rows=200, say=note),
    ),
    "imports": Part(
        "100,000 rows of a bank's file, and what others wait meanwhile (2 minutes)",
        lambda folder: imports.measure(folder, rows=100_000, one_by_one=10_000, say=note),
        lambda folder: imports.measure(folder, rows=2_000, one_by_one=500, say=note),
    ),
    "ledger": Part(
        "the book itself: commits, batches, opening and proving a book of a million events (4 minutes)",
        lambda folder: ledger.measure(folder / "ledger", seconds=5.0, events=1_000_000, rounds=3, say=note),
        lambda folder: ledger.measure(folder / "ledger", seconds=0.3, events=2_000, rounds=1, say=note),
    ),
    "forecasts": Part(
        "leaks told of before their limit, and false alarms in a thousand healthy hours (2 minutes)",
        lambda folder: forecasts.measure(folder, hours=2_000, leaks=300, say=note),
        lambda folder: forecasts.measure(folder, hours=50, leaks=5, say=note),
    ),
    "outside": Part(
        "150 kills from outside under load: nobody is convicted (4 minutes)",
        lambda folder: poisons.measure_outside(folder, kills=150, say=note),
        lambda folder: poisons.measure_outside(folder, kills=2, say=note),
    ),
    "promises": Part(
        "what is promised of high availability, each with its number (3 minutes)",
        lambda folder: promises.measure(folder, rounds=10),
        lambda folder: promises.measure(folder, rounds=2),
    ),
    "restarts": Part(
        "what a thousand restarts leave in the guard (10 minutes)",
        lambda folder: restarts.measure(folder, restarts=1000, say=note),
        lambda folder: restarts.measure(folder, restarts=5, say=note),
    ),
}
SCRIPTS: dict[str, Script] = {
    "recorder": Script("what the flight recorder costs", ()),
    "peers": Script(
        "crash and hang beside the peers (`make peers` first; 15 minutes)",
        ("--rounds", "1", "--hangs", "1"),
        long=True,
    ),
}
ABOUT = {
    **{name: part.about for name, part in (PARTS | LONG).items()},
    **{name: script.about for name, script in SCRIPTS.items()},
}


def parse() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(
        prog="python -m bench",
        description="Measure this machine. Without a name: everything but the long parts, in about twelve minutes.",
        epilog="\n".join(f"  {name:<10}{about}" for name, about in ABOUT.items()),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("parts", nargs="*", metavar="PART", help="only these parts, of the ones below")
    parser.add_argument("--quick", action="store_true", help="a round of each, to see that it works")
    parser.add_argument(
        "--json", action="store_true", help="one JSON object; without the parts that are scripts"
    )
    asked = parser.parse_args()
    strange = [name for name in asked.parts if name not in ABOUT]
    if strange:
        parser.error(f"there is no part {strange[0]!r}: choose from {', '.join(ABOUT)}")
    return asked


def run_part(name: str, *, quick: bool) -> list[Figure]:
    """Measure one part in a folder of its own."""
    part = (PARTS | LONG)[name]
    with tempfile.TemporaryDirectory(prefix="bench-") as folder:
        return (part.quick if quick else part.full)(Path(folder))


def run_script(name: str, *, quick: bool) -> None:
    """Let a script measure and print. Raises CalledProcessError."""
    subprocess.run(
        [sys.executable, "-m", f"bench.bench_{name}", *(SCRIPTS[name].quick if quick else ())], check=True
    )


def run(asked: argparse.Namespace) -> None:
    """Measure what was asked for and print it."""
    found: dict[str, list[Figure]] = {}
    before, began = machine(), time.monotonic()
    if not asked.json:
        print(described(), "medians [min - max]", sep="\n")
    for name in asked.parts or [*PARTS, *(name for name, script in SCRIPTS.items() if not script.long)]:
        if asked.json and name in SCRIPTS:
            continue
        if not asked.json:
            print(f"\n{ABOUT[name]}", flush=True)
        if name in SCRIPTS:
            run_script(name, quick=asked.quick)
            continue
        found[name] = run_part(name, quick=asked.quick)
        if not asked.json:
            print("\n".join(figure.line() for figure in found[name]), flush=True)
    took_s = time.monotonic() - began
    if asked.json:
        figures = {name: [figure.as_json() for figure in part] for name, part in found.items()}
        print(json.dumps({"machine": before, "took_s": round(took_s, 1), "figures": figures}, indent=1))
    else:
        print(f"\n{took_s:.0f} s, load now {machine()['load']}")


def main() -> int:
    """Measure; return the exit code."""
    asked = parse()
    stop_cleanly()
    try:
        run(asked)
    except KeyboardInterrupt:
        note("Stopped. Nothing is left running.")
        return 130
    except (GuardError, UnreadableError, OSError, subprocess.SubprocessError) as error:
        note(f"This could not be measured: {error}")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
