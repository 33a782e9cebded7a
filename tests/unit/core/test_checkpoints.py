"""Checkpoints: written whole or not at all, used only where they are of this very book, and never held for a book."""

import asyncio
import errno
import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
import pytest
from sqlalchemy import Engine

from core.checkpointing import Checkpointer
from core.guarded.control import CheckpointMade
from core.guarded.recorder import NoRecorder
from core.journal import checkpoint
from core.journal.chain import Broken
from core.journal.checkpoint import TABLE, Checkpoint, State, Trigger
from core.journal.checkpoints import CREATING, Checkpoints
from core.journal.ground import Ground
from core.journal.quick import Quick, prove_quickly
from core.journal.rebuilding import Rebuilding
from core.journal.store import LEDGER_FILE, open_reading, snapshot
from core.settings import Settings
from tests.unit.core.books import Pen, moving, opening, order, tamper

SETTINGS = Settings(verify_rest_ms=0)
HOUR_NS = 3_600 * 1_000_000_000


@dataclass
class Shelf:
    """A small book, its checkpoints, and what was said of them."""

    folder: Path
    pen: Pen
    said: list[tuple[str, str]] = field(default_factory=list)
    unsound: list[str] = field(default_factory=list)
    moves: int = 0

    def note(self, name: str, what: str) -> None:
        self.said.append((name, what))

    def checkpoints(self, kept: int = 10, age_h: int = 24) -> Checkpoints:
        return Checkpoints.of(self.folder, self.note, kept, age_h)

    def book(self, count: int = 1) -> None:
        for _ in range(count):
            self.moves += 1
            self.pen.write(order(moving(self.moves, "a", "b"), f"k{self.moves}"))

    def head(self) -> int:
        return self.pen.journal.head_seq

    def make(self, kept: int = 10, age_h: int = 24) -> CheckpointMade | str:
        """Make one, as a life would that has made none yet."""
        readers = open_reading(self.folder / LEDGER_FILE, 1, 1_000)

        async def made() -> CheckpointMade | str:
            maker = Checkpointer(
                self.checkpoints(kept, age_h),
                readers,
                NoRecorder(),
                SETTINGS,
                Rebuilding(),
                self.head,
                self.unsound.append,
                threading.Event(),
            )
            return await maker.make()

        try:
            return asyncio.run(made())
        finally:
            readers.dispose()

    def name(self) -> str:
        """Make one and return its name."""
        made = self.make()
        assert isinstance(made, CheckpointMade), made
        return made.name

    def file(self, name: str) -> Path:
        return self.folder / "checkpoints" / name

    def quick(self, *, whole: bool = False) -> tuple[Quick | Broken, str]:
        """Prove the book; return also by which checkpoint."""
        readers = open_reading(self.folder / LEDGER_FILE, 1, 1_000)
        ground = Ground(self.checkpoints(), whole=whole)
        found = prove_quickly(readers, 900, 1_000, ground, lambda: False)
        readers.dispose()
        assert isinstance(found, Quick | Broken), found
        return found, ground.gone_by

    def newest(self, now_ns: int | None = None) -> str | None:
        readers = open_reading(self.folder / LEDGER_FILE, 1, 1_000)
        with snapshot(readers, 900) as connection:
            found = self.checkpoints().newest(connection, now_ns or time.time_ns())
        readers.dispose()
        return found.name if found else None


@pytest.fixture
def shelf(tmp_path: Path) -> Shelf:
    made = Shelf(tmp_path, Pen(tmp_path))
    made.pen.carry_out(opening("a"), opening("b"))
    made.book(3)
    return made


def test_a_checkpoint_says_what_stands_and_a_proof_begins_at_it(shelf: Shelf) -> None:
    name = shelf.name()
    found = checkpoint.read(name, shelf.file(name).read_bytes())
    assert isinstance(found, Checkpoint)
    assert (found.seq, found.events, found.accounts, found.sums) == (5, 5, 2, {"KRW": "0"})
    assert found.size == shelf.file(name).stat().st_size
    shelf.book(4)
    proven, by = shelf.quick()
    assert isinstance(proven, Quick)
    assert (by, proven.proof.tail, proven.proof.head_seq) == (name, 4, 9)
    assert [what for _, what in shelf.said] == [State.COMPLETE, State.LOADED]


def test_without_any_the_proof_begins_where_it_always_did(shelf: Shelf) -> None:
    proven, by = shelf.quick()
    assert isinstance(proven, Quick)
    assert (by, proven.proof.tail) == ("", 5)


def test_whoever_wants_the_whole_chain_gets_it_in_spite_of_a_checkpoint(shelf: Shelf) -> None:
    shelf.name()
    proven, by = shelf.quick(whole=True)
    assert isinstance(proven, Quick)
    assert (by, proven.proof.tail) == ("", 5)


def test_nothing_is_kept_of_an_empty_book(tmp_path: Path) -> None:
    empty = Shelf(tmp_path, Pen(tmp_path))
    assert isinstance(empty.make(), str)
    assert not (tmp_path / "checkpoints").exists()


def test_the_newest_by_number_wins(shelf: Shelf) -> None:
    first = shelf.name()
    shelf.book()
    second = shelf.name()
    os.utime(shelf.file(second), (0, 0))  # whenever it was written
    assert shelf.newest() == second
    shelf.file(second).unlink()
    assert shelf.newest() == first


@pytest.mark.parametrize(
    "harm",
    [
        b"",
        b"{",
        b"\x00" * 300,
        b'{"version":1}',
        b"[" * 5_000,
    ],
)
def test_what_is_no_checkpoint_is_passed_over_with_a_line(shelf: Shelf, harm: bytes) -> None:
    older = shelf.name()
    shelf.book()
    newer = shelf.name()
    shelf.file(newer).write_bytes(harm)
    assert shelf.newest() == older
    assert shelf.said[-1][0] == newer
    assert shelf.said[-1][1].startswith("passed over: ")


@pytest.mark.parametrize("keep", [1, 100, -2])
def test_a_torn_one_is_passed_over_wherever_it_was_cut(shelf: Shelf, keep: int) -> None:
    older = shelf.name()
    shelf.book()
    newer = shelf.name()
    shelf.file(newer).write_bytes(shelf.file(newer).read_bytes()[:keep])
    assert shelf.newest() == older


def test_a_pipe_among_them_holds_nobody_up(shelf: Shelf) -> None:
    older = shelf.name()
    os.mkfifo(shelf.file(older).with_name("999999-9.json"))
    assert shelf.newest() == older


def test_a_bit_that_has_turned_is_seen_wherever_it_is(shelf: Shelf) -> None:
    name = shelf.name()
    whole = shelf.file(name).read_bytes()
    for place in range(0, len(whole), 7):
        turned = bytearray(whole)
        turned[place] ^= 1
        assert isinstance(checkpoint.read(name, bytes(turned)), str), f"the bit at {place}"


def test_one_that_was_renamed_or_is_larger_than_it_says_is_none(shelf: Shelf) -> None:
    name = shelf.name()
    data = shelf.file(name).read_bytes()
    assert checkpoint.read("6-1.json", data) == "it has another's name"
    assert "bytes and says" in str(checkpoint.read(name, data + b" "))
    shelf.file(name).write_bytes(b"x" * (checkpoint.BYTES_MAX + 1))
    assert shelf.newest() is None


def remade(shelf: Shelf, name: str, **changed: object) -> None:
    """Write a checkpoint anew with other words and a right digest: a liar's, or another machine's."""
    found = checkpoint.read(name, shelf.file(name).read_bytes())
    assert isinstance(found, Checkpoint)
    liar = msgspec.structs.replace(found, **changed)  # type: ignore[arg-type]  # names of fields
    liar = msgspec.structs.replace(liar, size=len(checkpoint._encoded(liar)))
    data = checkpoint._encoded(msgspec.structs.replace(liar, sha256=checkpoint._digest(liar)))
    shelf.file(name).unlink()
    shelf.file(liar.name).write_bytes(data)


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"seq": 99}, "the ledger ends at"),
        ({"epoch": 99}, "stands at"),
        ({"hash": "00" * 32}, "another one"),
        ({"at": "2999-01-01T00:00:00.000000000Z"}, "still to come"),
    ],
)
def test_one_that_is_not_of_this_book_is_passed_over(
    shelf: Shelf, changed: dict[str, object], why: str
) -> None:
    remade(shelf, shelf.name(), **changed)
    assert shelf.newest() is None
    assert why in shelf.said[-1][1]


def test_one_that_lies_about_the_balances_stops_the_proof_and_is_not_believed(shelf: Shelf) -> None:
    remade(shelf, shelf.name(), balances_sha256="11" * 32)
    found, _ = shelf.quick()
    assert isinstance(found, Broken)


def test_balances_that_somebody_has_moved_are_never_kept(shelf: Shelf) -> None:
    tamper(
        shelf.folder,
        "UPDATE account SET posted = posted + 5 WHERE id = 'a'",
        "UPDATE account SET posted = posted - 5 WHERE id = 'b'",
    )
    refused = shelf.make()
    assert isinstance(refused, str)
    assert shelf.unsound == [refused]
    assert shelf.newest() is None


def test_an_older_copy_that_was_put_back_gets_new_checkpoints_and_keeps_them(shelf: Shelf) -> None:
    shelf.book(20)
    for _ in range(3):  # of a state that is no more
        shelf.book()
        remade(shelf, shelf.name(), seq=shelf.head() + 1_000)
    made = shelf.make(kept=2)
    assert isinstance(made, CheckpointMade)
    assert shelf.newest() == made.name


def test_no_more_are_kept_than_wanted_and_the_oldest_go_first(shelf: Shelf) -> None:
    names = []
    for n in range(5):
        shelf.book()
        made = shelf.make(kept=3)
        assert isinstance(made, CheckpointMade)
        os.utime(shelf.file(made.name), (time.time() - 100 + n,) * 2)
        names.append(made.name)
    assert sorted(path.name for path in shelf.file("").iterdir()) == sorted(names[-3:])
    assert (names[0], State.EXPIRED) in shelf.said


def test_what_is_too_old_goes_but_never_the_newest(shelf: Shelf) -> None:
    old = shelf.name()
    os.utime(shelf.file(old), (time.time() - 25 * 3_600,) * 2)
    shelf.book()
    new = shelf.name()
    assert [path.name for path in shelf.file("").iterdir()] == [new]


def test_what_a_death_left_half_written_is_swept_and_was_never_read(shelf: Shelf) -> None:
    name = shelf.name()
    left = shelf.file("9-1.json" + CREATING)
    left.write_bytes(shelf.file(name).read_bytes())
    assert shelf.newest() == name
    shelf.checkpoints().sweep()
    assert not left.exists()
    assert shelf.said[-1] == (left.name, State.EXPIRED)


@contextmanager
def full_disk(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    def refuse(_: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("core.journal.checkpoints.os.fsync", refuse)
        yield


def test_a_full_disk_costs_the_checkpoint_and_leaves_nothing_behind(
    shelf: Shelf, monkeypatch: pytest.MonkeyPatch
) -> None:
    with full_disk(monkeypatch):
        refused = shelf.make()
    assert refused == "It could not be written (No space left on device)."
    assert list(shelf.file("").iterdir()) == []
    assert shelf.newest() is None
    assert isinstance(shelf.make(), CheckpointMade)


def test_every_state_but_the_last_is_left_and_nothing_returns() -> None:
    assert {state for state, _ in TABLE} == set(State) - {State.EXPIRED}
    assert State.CREATING not in TABLE.values()
    with suppress(KeyError):
        checkpoint.after(State.EXPIRED, Trigger.USED)
        pytest.fail("what is expired is used again")


class Hanging(Checkpoints):
    """A disk that does not come back at the first file."""

    held, hangs = threading.Event(), threading.Event()

    def keep(self, name: str, data: bytes) -> None:
        if not self.hangs.is_set():
            self.hangs.set()
            self.held.wait()
        super().keep(name, data)


def _maker(shelf: Shelf, checkpoints: Checkpoints, readers: Engine, head: Callable[[], int]) -> Checkpointer:
    return Checkpointer(
        checkpoints,
        readers,
        NoRecorder(),
        SETTINGS,
        Rebuilding(),
        head,
        shelf.unsound.append,
        threading.Event(),
    )


def test_a_checkpoint_that_hangs_is_made_anew_for_whoever_waits(shelf: Shelf) -> None:
    shelf.book(3)
    readers = open_reading(shelf.folder / LEDGER_FILE, 1, 1_000)
    checkpoints = Hanging(shelf.folder / "checkpoints", shelf.note)

    async def scenario() -> CheckpointMade | str:
        maker = _maker(shelf, checkpoints, readers, shelf.head)
        made = asyncio.create_task(maker.make())
        await asyncio.to_thread(checkpoints.hangs.wait)
        maker.begin_anew()
        return await made

    try:
        made = asyncio.run(scenario())
    finally:
        checkpoints.held.set()
        readers.dispose()
    assert isinstance(made, CheckpointMade)


def test_a_turn_that_fails_is_not_the_last_one_of_this_life(shelf: Shelf) -> None:
    shelf.book(3)
    readers = open_reading(shelf.folder / LEDGER_FILE, 1, 1_000)
    asked: list[int] = []
    again = threading.Event()

    def head() -> int:
        asked.append(0)
        if len(asked) == 1:
            raise ValueError(asked)
        again.set()
        return shelf.head()

    async def scenario() -> None:
        maker = _maker(shelf, shelf.checkpoints(), readers, head)
        made = asyncio.create_task(maker.make())  # so that there is a last one, and the head is asked for
        await made
        making = asyncio.create_task(maker.keep_making(0))
        await asyncio.to_thread(again.wait)
        assert not making.done()
        making.cancel()
        await maker.end()

    try:
        asyncio.run(scenario())
    finally:
        readers.dispose()
