"""Run many simulated crises, or one again: `python -m tests.simulation [--seed N] [--seeds N] [--first N]`.

Prints how fast it went, which fault was tried in which phase, and which rows of the table no seed reached.
A law that broke is one line with the seed that repeats it; with `--seed` the whole story is told.
"""

import argparse
import os
import sys
import time
from collections import Counter
from collections.abc import Iterable
from multiprocessing import Pool

from hardcore.model.phases import Phase
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.transitions import TABLE, Trigger
from tests.simulation.faults import FAULTS
from tests.simulation.run import Result, run

SEEDS_MAX = 10_000_000
FAILURES_SHOWN_MAX = 20
_CHUNK = 50
_SHORT = dict(
    zip(
        Phase,
        [
            "stopd",
            "adopt",
            "start",
            "prove",
            "proba",
            "runng",
            "suspt",
            "drain",
            "evid",
            "stopg",
            "kill",
            "unkil",
            "switc",
            "back",
            "fatal",
        ],
        strict=True,
    )
)


def main(argv: list[str] | None = None) -> int:
    """Return 0 if every law held, 1 if one broke."""
    parser = argparse.ArgumentParser(prog="tests.simulation", description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, help="run this one and tell its story")
    parser.add_argument("--seeds", type=int, default=5000, help="how many (5000)")
    parser.add_argument("--first", type=int, default=0, help="the first of them (0)")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes (all cores)")
    asked = parser.parse_args(argv)
    if asked.seed is not None:
        return _tell(asked.seed)
    if not 1 <= asked.seeds <= SEEDS_MAX:
        parser.error(f"--seeds must be 1 to {SEEDS_MAX}")
    return _run_many(range(asked.first, asked.first + asked.seeds), max(1, asked.jobs))


def _say(line: str = "") -> None:
    sys.stdout.write(f"{line}\n")


def _tell(seed: int) -> int:
    result = run(seed, tell=True)
    for line in result.story:
        _say(line)
    _say()
    _say(str(result) if result.broken else f"seed {seed} ({result.script.kind}): every law held")
    return 1 if result.broken else 0


def _run_many(seeds: range, jobs: int) -> int:
    began = time.monotonic()
    pool = Pool(jobs)
    faults, rows, named, broken = _collect(pool.imap_unordered(run, seeds, _CHUNK))
    pool.close()
    pool.join()  # only then is the time of the processes ours to read
    took_s, worked_s = time.monotonic() - began, os.times().children_user
    _say_coverage(faults)
    _say_names(named)
    missing = [f"{p} x {t}" for p, listed in TABLE.items() for t in listed if (p, t) not in rows]
    _say(
        f"rows of the table: {len(rows)} reached, {len(missing)} not{': ' if missing else ''}{', '.join(missing)}"
    )
    _say(f"{len(seeds)} seeds in {took_s:.1f} s; {len(seeds) / worked_s:.0f} for each second of a processor")
    for result in broken[:FAILURES_SHOWN_MAX]:
        _say(str(result))
    _say(f"{len(broken)} broken" if broken else "every law held")
    return 1 if broken else 0


def _collect(
    results: Iterable[Result],
) -> tuple[
    Counter[tuple[str, Phase]], set[tuple[Phase, Trigger]], Counter[tuple[str, Diagnosis]], list[Result]
]:
    faults: Counter[tuple[str, Phase]] = Counter()
    rows: set[tuple[Phase, Trigger]] = set()
    named: Counter[tuple[str, Diagnosis]] = Counter()
    broken = []
    for result in results:
        faults.update(result.faults)
        rows |= result.rows
        named.update(result.named)
        if result.broken:
            broken.append(result)
    return faults, rows, named, sorted(broken, key=lambda result: result.seed)


def _say_coverage(faults: Counter[tuple[str, Phase]]) -> None:
    _say(f"{'fault x phase':<28}{''.join(f'{_SHORT[phase]:>6}' for phase in Phase)}")
    for name in FAULTS:
        hits = "".join(f"{faults[name, phase] or '.':>6}" for phase in Phase)
        _say(f"{name:<28}{hits}")


def _say_names(named: Counter[tuple[str, Diagnosis]]) -> None:
    """What a living core had, and what it was called; a wrong name is a broken law."""
    _say("what it was -> what it was called")
    for (truth, diagnosis), times in sorted(named.items()):
        _say(f"{truth:<28}{diagnosis:<22}{times:>6}")


if __name__ == "__main__":
    sys.exit(main())
