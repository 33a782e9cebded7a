"""What a client sees of a crash and of a hang: this guard and the peers, one after the other, in one run.

The guest is this ledger for everybody (`bench/peers/guest.py` says how), the client asks every 5 ms on a fresh connection.
Prints a table in Markdown, as it stands in `docs/benchmarks.md`. Peers that are not installed are named and left out;
`make peers` installs what PyPI and npm have. The others are Debian's: monit, runit, s6.
"""

import argparse
import asyncio
import shutil
import statistics
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from bench.instance import Watched, fill
from bench.machine import described
from bench.peers.asking import Blow
from bench.peers.contest import Guarded, Outcome, Peer, asking_at, fight, running
from bench.peers.recipes import PEERS, Recipe
from core.journal.store import LEDGER_FILE
from examples.guarded import stop_cleanly

TRANSACTIONS = 500
OURS = "**Hard-Core, with a spare**"
COLD = "Hard-Core, `--no-spare`"


def parse() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=7, help="crashes of each (default: 7)")
    parser.add_argument("--hangs", type=int, default=5, help="hangs of each that watches (default: 5)")
    parser.add_argument("--only", default="", help="peers whose name has this in it")
    return parser.parse_args()


async def ours(name: str, data: Path, asked: argparse.Namespace, policy: dict[str, object]) -> Outcome:
    """Let this guard be hit."""
    with Watched(data, policy) as instance:
        async with asking_at(instance.address) as asking:
            guarded = Guarded(instance, spare=bool(policy.get("spare", True)))
            return await fight(name, guarded, asking, asked.rounds, asked.hangs)


async def theirs(recipe: Recipe, folder: Path, book: Path, asked: argparse.Namespace) -> Outcome:
    """Let a peer be hit. Where nothing looks at more than a death, one hang shows it."""
    with running(recipe, folder, book) as ground:
        async with asking_at(("127.0.0.1", ground.port)) as asking:
            peer = Peer(recipe, ground, asking)
            return await fight(recipe.name, peer, asking, asked.rounds, asked.hangs if recipe.watches else 1)


def row(outcome: Outcome) -> str:
    """Return a row of the table."""
    crash, hang = outcome.crashes, outcome.hangs
    if not crash:
        return f"| {outcome.name} | could not be measured: {outcome.fault} | | | | |"
    longest = [blow.longest_ms for blow in crash]
    cells = [
        f"{statistics.median(longest):.0f} / {_p95(longest):.0f} / {max(longest):.0f}",
        _outage(crash),
        _failed(crash),
        _outage(hang) if hang else "-",
        _failed(hang) if hang else "-",
    ]
    return f"| {outcome.name} | " + " | ".join(cells) + " |"


def _p95(values: Sequence[float]) -> float:
    return sorted(values)[max(0, -(-len(values) * 95 // 100) - 1)]


def _outage(blows: Sequence[Blow]) -> str:
    known = [blow.outage_ms for blow in blows if blow.outage_ms is not None]
    if len(known) < len(blows):
        return "never (watched for 10 s)"
    return f"{statistics.median(known):.0f} / {max(known):.0f}"


def _failed(blows: Sequence[Blow]) -> str:
    counts = [blow.failed for blow in blows]
    return f"{statistics.median(counts):.0f} ({max(counts)})"


def head() -> str:
    """Return the head of the table."""
    return (
        "| guard | crash: longest request, ms, median / p95 / max | crash: outage, ms, median / max "
        "| failed requests, median (max) | hang: outage, ms, median / max | failed in a hang, median (max) |\n"
        "|---|---|---|---|---|---|"
    )


async def measure(asked: argparse.Namespace, folder: Path) -> None:
    """Hit everybody and print what came of it."""
    data, book = folder / "ours", folder / "book"
    with Watched(data) as instance:
        fill(instance, TRANSACTIONS)
    book.mkdir()
    shutil.copy(data / LEDGER_FILE, book)
    print(head(), flush=True)
    print(row(await ours(OURS, data, asked, {})), flush=True)
    print(row(await ours(COLD, data, asked, {"spare": False})), flush=True)
    for number, recipe in enumerate(PEERS):
        if asked.only not in recipe.name:
            continue
        if not recipe.installed():
            print(f"{recipe.name}: not installed", file=sys.stderr)
            continue
        print(row(await theirs(recipe, folder / f"peer-{number}", book, asked)), flush=True)


def main() -> int:
    """Measure; return the exit code."""
    asked = parse()
    stop_cleanly()
    print(described())
    with tempfile.TemporaryDirectory(prefix="bench-peers-") as folder:
        asyncio.run(measure(asked, Path(folder)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
