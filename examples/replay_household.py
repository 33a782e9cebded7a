"""A household's ten years are booked while the ledger is killed and frozen again and again; then all is checked.

    .venv/bin/python examples/replay_household.py

beancount makes the household (`bean-example`) and says what every balance must be in the end. Four senders book
it through the gateway, each transaction under its own key and asked once; a fifth party finds the core by
`hardcore status` and kills or freezes it at random moments. Nobody is told when. The moments come from a seed,
but what a blow meets in flight is the machine's own doing, and differs each time. Nothing runs afterwards.
"""

import argparse
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

try:
    from examples import audit, household
    from examples.guarded import HARDCORE, Guarded, GuardError, stop_cleanly
    from examples.lanes import Lanes
    from examples.line import Answer, Line
    from examples.reading import UnreadableError, read_ledger
except ModuleNotFoundError:
    sys.exit("This needs beancount and the checkout's own Python: `make venv-dev`, then .venv/bin/python.")

SENDERS = 4
BLOWS = 10
BLOWS_QUICK = 3
#: The core is expected to die more often than a guard would put up with; and a short probation saves time.
POLICY = {"max_restart_count": 1000, "probation_ms": 500}
HITS = {signal.SIGKILL: "killed", signal.SIGSTOP: "frozen"}
DIAGNOSES = {signal.SIGKILL: "KILLED_FROM_OUTSIDE", signal.SIGSTOP: "FROZEN"}
ANSWER_S = 30.0
PROGRESS_S = 120.0
LAST_REPORT_S = 30.0
JITTER_S_MAX = 0.05
ASKED_AGAIN_MAX = 10
ASK_AGAIN_S = 0.5
SHOWN_MAX = 10


@dataclass(frozen=True, slots=True)
class Blow:
    """A blow: what it was, at how many booked, and how long until a new core's first answer (None: never)."""

    number: signal.Signals
    booked: int
    answered_s: float | None


class Replay:
    """The senders and what they were told. One thread each; what they share is behind one lock."""

    def __init__(self, address: tuple[str, int], wishes: Sequence[household.Wish]) -> None:
        self.lanes = Lanes([wish.accounts for wish in wishes])
        self.told: dict[str, str] = {}
        self.failures: list[str] = []
        self._address = address
        self._wishes = wishes
        self._first_ns: dict[int, int] = {}
        self._news = threading.Condition()
        self._threads = [threading.Thread(target=self._send, name=f"sender {n}") for n in range(SENDERS)]

    @contextmanager
    def sending(self) -> Iterator[None]:
        """Let the senders work; in the end none is left."""
        for thread in self._threads:
            thread.start()
        try:
            yield
        finally:
            self.lanes.close()
            for thread in self._threads:
                thread.join()

    def first_answer_ns(self, after_epoch: int, within_s: float) -> int | None:
        """Wait for the first answer of a later core; return when it came."""

        def later() -> list[int]:
            return [at_ns for epoch, at_ns in self._first_ns.items() if epoch > after_epoch]

        with self._news:
            self._news.wait_for(later, within_s)
            return min(later(), default=None)

    def _send(self) -> None:
        with Line(self._address) as line:
            while (number := self.lanes.take()) is not None:
                self._book(line, self._wishes[number])
                self.lanes.finish(number)

    def _book(self, line: Line, wish: household.Wish) -> None:
        """Ask once. A failure is counted; asking again is for the sake of the rest, with the same key."""
        for _time in range(ASKED_AGAIN_MAX):
            answer = line.post("/api/ledger/transactions", wish.body, wish.key)
            if isinstance(answer, Answer) and answer.good:
                self._note(wish, answer)
                return
            with self._news:
                self.failures.append(f"{wish.key}: {answer}")
            time.sleep(ASK_AGAIN_S)

    def _note(self, wish: household.Wish, answer: Answer) -> None:
        with self._news:
            self.told[wish.key] = answer.body["id"]
            if answer.body["epoch"] not in self._first_ns:
                self._first_ns[answer.body["epoch"]] = answer.told_ns
                self._news.notify_all()


def moments(chance: random.Random, transactions: int, blows: int) -> list[tuple[signal.Signals, int, int]]:
    """Return for each blow what it is, after how many transactions it comes, and where the senders wait for it.

    One blow in each stretch of the books, because a core that is hit while it starts has little to lose.
    """
    stretch = transactions // (blows + 1)
    kinds = [signal.SIGSTOP if number % 2 else signal.SIGKILL for number in range(blows)]
    chance.shuffle(kinds)
    return [
        (kind, number * stretch + chance.randrange(stretch // 2), (number + 1) * stretch)
        for number, kind in enumerate(kinds)
    ]


def strike(
    instance: Guarded, replay: Replay, chance: random.Random, plan: tuple[signal.Signals, int, int]
) -> Blow:
    """Wait for the moment, hit the core, and wait for the next one's first answer."""
    kind, after, gate = plan
    core = instance.core()
    try:
        replay.lanes.open_up_to(gate)
        if not replay.lanes.wait_for(after, PROGRESS_S):
            raise GuardError(f"Only {replay.lanes.done} transactions were booked in {PROGRESS_S:g} s.")
        time.sleep(chance.uniform(0, JITTER_S_MAX))
        booked, at_ns = replay.lanes.done, core.hit(kind)
    finally:
        core.let_go()
    first_ns = replay.first_answer_ns(core.epoch, ANSWER_S)
    return Blow(kind, booked, None if first_ns is None else (first_ns - at_ns) / 1e9)


def tell(blow: Blow) -> str:
    """Return a blow as one line."""
    if blow.answered_s is None:
        return f"{blow.booked:>7,} booked   {HITS[blow.number]}   no answer in {ANSWER_S:g} s"
    return f"{blow.booked:>7,} booked   {HITS[blow.number]}   answered again after {blow.answered_s:.2f} s"


def open_accounts(address: tuple[str, int], wishes: Sequence[household.Wish]) -> list[str]:
    """Open every account; return what went wrong."""
    with Line(address) as line:
        answers = [(wish.key, line.post("/api/ledger/accounts", wish.body, wish.key)) for wish in wishes]
    return [f"{key}: {answer}" for key, answer in answers if not answer.good]


def wrong_reports(instance: Guarded, blows: Sequence[Blow]) -> list[str]:
    """Each blow has one incident, closed, with the right diagnosis; there is no other."""
    due = sorted(DIAGNOSES[blow.number] for blow in blows)
    found: list[dict[str, Any]] = []
    give_up_at = time.monotonic() + LAST_REPORT_S
    while time.monotonic() < give_up_at:
        found = instance.hardcore("incidents", "list")
        if len(found) >= len(due) and all(each["outcome"] == "recovered" for each in found):
            break
    told = sorted(each["diagnosis"] for each in found)
    wrong = [] if told == due else [f"the incidents are {told}, and {due} were due"]
    return wrong + [f"{each['id']} is {each['outcome']}" for each in found if each["outcome"] != "recovered"]


def check(instance: Guarded, books: household.Household, replay: Replay, blows: Sequence[Blow]) -> bool:
    """Hold everything against everything, print what came out, and return whether all is well."""
    with Line(instance.address) as line:
        found = read_ledger(line)
    verdict = instance.hardcore("verify")
    transactions = books.transactions
    number = f"{len(transactions):,}"
    checks = [
        ("Balances", f"all {len(books.balances)} equal beancount's own", audit.wrong_balances(found, books)),
        (
            "Once",
            f"each of {number} is there exactly once, by key",
            audit.wrong_counts(found, (*books.accounts, *transactions)),
        ),
        (
            "List",
            f"all {number} as they were asked for and answered",
            audit.wrong_contents(found, transactions, replay.told),
        ),
        (
            "Order",
            "every account has its own in the household's order",
            audit.wrong_orders(found, transactions),
        ),
        (
            "Chain",
            f"`hardcore verify`: {verdict.get('events', 0):,} events, whole",
            [] if verdict.get("ok") else [str(verdict)],
        ),
        ("Clients", "no request failed, none was asked twice", replay.failures),
        ("Reports", f"{len(blows)} incidents, each told and closed", wrong_reports(instance, blows)),
    ]
    print()
    for name, good, wrong in checks:
        print(f"{name:<10}{good if not wrong else f'{len(wrong)} wrong'}")
        for sentence in wrong[:SHOWN_MAX]:
            print(f"{'':<10}  {sentence}")
    return not any(wrong for _name, _good, wrong in checks)


def replay_books(data: Path, books: household.Household, blows: int, seed: int) -> bool:
    """Book the household under blows; return whether all is well in the end."""
    chance = random.Random(seed)
    with Guarded(data, POLICY) as instance:
        print(f"{'Ledger':<10}{instance.url}, in {data}")
        failed = open_accounts(instance.address, books.accounts)
        if failed:
            raise GuardError(f"The accounts can't be opened. {failed[0]}")
        began = time.monotonic()
        replay = Replay(instance.address, books.transactions)
        struck = []
        with replay.sending():
            for plan in moments(chance, len(books.transactions), blows):
                struck.append(strike(instance, replay, chance, plan))
                print(tell(struck[-1]), flush=True)
            replay.lanes.open_up_to(len(books.transactions))
            if not replay.lanes.wait_for(len(books.transactions), PROGRESS_S):
                raise GuardError(f"Only {replay.lanes.done} transactions were booked in {PROGRESS_S:g} s.")
        print(
            f"{len(books.transactions):>7,} booked   all, in {time.monotonic() - began:.0f} s with {SENDERS} senders"
        )
        instance.running()
        return check(instance, books, replay, struck)


def run(data: Path, *, quick: bool, seed: int) -> bool:
    """Make the household, book it, check it."""
    path = data / "household.beancount"
    household.make_books(path, household.LAST_DAY_OF_A_PART if quick else household.LAST_DAY)
    books = household.read_books(path)
    kinds = f"{len(books.accounts)} accounts, {books.commodities} currencies"
    print(f"{'Household':<10}{len(books.transactions):,} transactions, {kinds}")
    well = replay_books(data, books, BLOWS_QUICK if quick else BLOWS, seed)
    print()
    print("Nothing is missing and nothing is there twice." if well else "Something is wrong: see above.")
    return well


def parse() -> argparse.Namespace:
    """Read the command line."""
    assert __doc__ is not None
    parser = argparse.ArgumentParser(
        prog="replay_household.py",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog="Exit code: 0 all is well, 1 something differs or did not work, 130 stopped by Ctrl-C.",
    )
    parser.add_argument("--quick", action="store_true", help=f"one year and {BLOWS_QUICK} blows")
    parser.add_argument("--seed", type=int, default=7, help="of the blows and their moments (default 7)")
    parser.add_argument(
        "--data",
        type=Path,
        help="keep everything in this new folder (default: kept only if something is wrong)",
    )
    return parser.parse_args()


def new_folder(kept: Path | None) -> Path:
    """Make the folder for everything. Raises GuardError if the one to be kept is in use."""
    if kept is None:
        return Path(tempfile.mkdtemp(prefix="household-"))
    if kept.exists() and any(kept.iterdir()):
        raise GuardError(f"{kept} is not empty: name a new folder with --data.")
    kept.mkdir(parents=True, exist_ok=True)
    return kept.absolute()


def run_in_folder(asked: argparse.Namespace) -> int:
    """Run, and keep the folder if that was asked for or if something in it has to be looked at."""
    data = new_folder(asked.data)
    keep = True
    try:
        well = run(data, quick=asked.quick, seed=asked.seed)
        keep = asked.data is not None or not well
    except KeyboardInterrupt:
        keep = asked.data is not None
        raise
    finally:
        if keep:
            print(f"The blows, told one by one: {HARDCORE} --data {data} incidents")
        else:
            shutil.rmtree(data)
    return 0 if well else 1


def main() -> int:
    """Run the example; return the exit code."""
    asked = parse()
    stop_cleanly()
    try:
        return run_in_folder(asked)
    except KeyboardInterrupt:
        print("Stopped. Nothing is left running.")
        return 130
    except (GuardError, UnreadableError, OSError, subprocess.SubprocessError) as error:
        print(error, file=sys.stderr)
        return 1


if __name__ == "__main__":
    sys.exit(main())
