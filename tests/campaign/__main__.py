"""Strike a living system at random, many times: `make campaign RUNS=500`, or `python -m tests.campaign --runs N`.

Each run is a seed: `--seed N` strikes once more as that one did. Prints a line for each run, and at the end the coverage
(fault x moment), how soon deaths were noticed and how long they lasted, and which laws broke. Exit code 1 if one did.
"""

import argparse
import contextlib
import sys
import time
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from tests.campaign.block import BLOCK, carry_out
from tests.campaign.run import Told
from tests.campaign.table import as_markdown, summary

RUNS_MAX = 100_000


def main(argv: list[str] | None = None) -> int:
    """Return 0 if every law held."""
    parser = argparse.ArgumentParser(prog="tests.campaign", description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=20, help="how many (20)")
    parser.add_argument("--first", type=int, default=0, help="the first seed (0)")
    parser.add_argument("--seed", type=int, help="only this one")
    parser.add_argument("--jobs", type=int, default=1, help="houses at a time (1)")
    parser.add_argument("--write", type=Path, metavar="FILE", help="write the table there as Markdown")
    parser.add_argument(
        "--keep", type=Path, metavar="DIR", help="leave logs and incidents of broken runs there"
    )
    asked = parser.parse_args(argv)
    if not 1 <= asked.runs <= RUNS_MAX:
        parser.error(f"--runs must be 1 to {RUNS_MAX}")
    seeds = [asked.seed] if asked.seed is not None else range(asked.first, asked.first + asked.runs)
    began = time.monotonic()
    told = _all(list(seeds), max(1, asked.jobs), asked.keep)
    took_s = time.monotonic() - began
    sys.stdout.write(summary(told, took_s))
    if asked.write is not None:
        asked.write.write_text(as_markdown(told, took_s), "utf-8")
    return 1 if any(one.broken for one in told) else 0


def _all(seeds: list[int], jobs: int, keep: Path | None) -> list[Told]:
    blocks = [seeds[at : at + BLOCK] for at in range(0, len(seeds), BLOCK)]
    told: list[Told] = []
    if jobs == 1:
        with contextlib.suppress(KeyboardInterrupt):  # what was carried out is told all the same
            for block in blocks:
                told += carry_out(block, _say, keep)
        return told
    with get_context("spawn").Pool(jobs) as pool, contextlib.suppress(KeyboardInterrupt):
        for done in pool.imap_unordered(partial(carry_out, keep=keep), blocks):
            for one in done:
                _say(one)
            told += done
    return told


def _say(told: Told) -> None:
    how = "; ".join(told.broken) or "held"
    sys.stdout.write(f"{told.seed:>6}  {told.took_s:5.1f} s  {', '.join(told.strikes)}  {how}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
