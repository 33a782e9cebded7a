"""A wave: rows of one import that go to the writer as one piece of work, each with its own key and its own answer.

Pure but for the ids that are made. What can be said of a row without the ledger is said here; the rest are orders. A
row at which we ourselves stumble ends the wave before it: it is then booked by itself, where its fault is its own.
Not chosen: rows as tasks of their own at all times; what a task, a slot and a hop to the writer cost was most of what
a row cost.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Final

import msgspec

from core.guarded.poison import name_of
from core.imports import judging
from core.imports.outcomes import Outcome, Stopped, meaning_of, refused
from core.imports.reading.candidates import Candidate, Result, SkippedRow
from core.imports.records import Manifest, Problem
from core.journal.answers import Answer, Order
from core.ledger.commands import accounts_of, fingerprint_of
from core.ledger.entries import RecordEntry
from core.ledger.reasons import Rejection

ROWS_MIN: Final = 16
ROWS_MAX: Final = 512
AIMED_NS: Final = 32_000_000  # of one wave at the writer: whoever comes meanwhile waits no longer than for it
_NO_SLOT: Final = -1  # the wave has one for all of them

Settled = Outcome | SkippedRow


class Wave(msgspec.Struct, frozen=True):
    """Rows from the one at `first` on. `settled` is what became of each; None: `orders` ask for it, in their order."""

    first: int
    rows: tuple[Result, ...]
    settled: tuple[Settled | None, ...]
    asked: tuple[Candidate, ...]
    orders: tuple[Order, ...]


def prepare(rows: Sequence[Result], first: int, manifest: Manifest, new_id: Callable[[], str]) -> Wave:
    """Return a wave of these rows, or of those before the first at which we stumble. Any thread."""
    settled: list[Settled | None] = []
    asked: list[Candidate] = []
    orders: list[Order] = []
    for ordinal, row in enumerate(rows, first):
        # Whatever it is, it is said where the row is booked by itself.
        try:
            made = _prepare(row, ordinal, manifest, new_id)
        except Exception:  # noqa: BLE001 - the reason stands above
            break
        if isinstance(made, Order):
            assert isinstance(row, Candidate), "nothing else is asked for"
            asked.append(row)
            orders.append(made)
        settled.append(None if isinstance(made, Order) else made)
    return Wave(first, tuple(rows[: len(settled)]), tuple(settled), tuple(asked), tuple(orders))


def _prepare(row: Result, ordinal: int, manifest: Manifest, new_id: Callable[[], str]) -> Order | Settled:
    judged: Candidate | Problem | SkippedRow = judging.judge(row, manifest.currency)
    if not isinstance(judged, Candidate):
        return judged
    command = judging.command_of(judged, ordinal, manifest, new_id())
    if isinstance(command, Rejection):
        return refused(judged, command)
    return _order(command, judging.key_of(manifest, ordinal))


def _order(command: RecordEntry, key: str) -> Order:
    return Order(
        command,
        key,
        fingerprint_of(command),
        key.encode(),
        command.id,
        command.id,
        accounts_of(command),
        _NO_SLOT,
        name_of(key),
    )


def payload_of(wave: Wave) -> bytes:
    """Return what evidence keeps of a wave: where its rows stand, and not what is in them."""
    return msgspec.json.encode({"from": wave.first, "rows": len(wave.rows)})


def outcomes(wave: Wave, answers: Iterable[Answer] | None) -> Iterator[Settled]:
    """Give what became of each row; without answers, and from the first that the writer could not take, to be asked again."""
    given = None if answers is None else zip(wave.asked, answers, strict=True)
    for settled in wave.settled:
        if settled is not None:
            yield settled
            continue
        if given is None:
            yield Stopped()
            return
        candidate, answer = next(given)
        yield meaning_of(answer, candidate)[1] or Stopped()


def next_size(rows: int, took_ns: int, size: int) -> int:
    """Return how many rows the next wave should have, after one of so many took so long: half to twice `size`."""
    fitting = rows * AIMED_NS // max(1, took_ns)
    return max(ROWS_MIN, min(ROWS_MAX, size * 2, max(size // 2, fitting)))
