"""Drills in a command's place, and the names that a frame at work shows."""

import asyncio
import sys
import threading
from pathlib import Path

import msgspec
from sqlalchemy import Connection

from core.guarded.recorder import NoRecorder, Stage
from core.journal.answers import DecisionFailed, Done, Exercise, LookUp, Touch
from tests import waiting
from tests.unit.core.books import Pen, moving, opening, order, pen
from tests.unit.core.test_service import serving


def exercise(made: Pen, run: object) -> Exercise:
    slot = made.recorder.begin("c", None, "drill", "tx-1", ("system:drill",), b"", 0)
    assert slot is not None
    return Exercise(slot, "tx-1", "system:drill", run if callable(run) else None)


def names_of_frame(thread: int, function: str) -> dict[str, object]:
    """Return the locals of a function's frame on a thread, as a debugger would see them."""
    frame = sys._current_frames().get(thread)
    while frame is not None and frame.f_code.co_name != function:
        frame = frame.f_back
    assert frame is not None, f"the thread is not in {function}"
    return dict(frame.f_locals)


def test_an_exercise_is_decided_like_a_command_and_books_nothing(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        seen: list[tuple[int, dict[str, object]]] = []

        def run() -> None:
            word = (4096 + 1024 * work.slot) // 8 + 8  # the stage, as the page is laid out (docs/wires.md)
            seen.append((made.recorder._words[word], names_of_frame(threading.get_ident(), "_exercise")))

        work = exercise(made, run)
        before, drilled, after = made.write(order(opening("a")), work, order(opening("b")))
        assert [type(answer) for answer in (before, drilled, after)] == [Done, Done, Done]
        ((stage, names),) = seen
        assert stage == Stage.DECIDING
        assert (names["transaction_id"], names["account_id"]) == ("tx-1", "system:drill")
        assert made.journal.head_seq == 2


def test_deciding_names_the_one_that_is_judged_and_nothing_else_of_its_batch(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        made.carry_out(opening("a"), opening("b"))
        slots = [made.recorder.begin("c", None, "test", "", (), b"", 0) for _ in range(6)]
        looked_up, touched, failed, taken, drilled, waits = [slot for slot in slots if slot is not None]
        broken = order(moving(1, "a", "b"), slot=failed)
        msgspec.structs.force_setattr(broken.command, "postings", None)
        seen: list[dict[int, Stage]] = []

        def run() -> None:
            words = made.recorder._words
            seen.append({slot: Stage(words[(4096 + 1024 * slot) // 8 + 8]) for slot in slots if slot})

        answers = made.write(
            LookUp("k", looked_up),
            Touch(touched),
            broken,
            order(moving(2, "a", "b"), slot=taken),
            Exercise(drilled, "tx-1", "system:drill", run),
            order(moving(3, "a", "b"), slot=waits),
        )
        assert isinstance(answers[2], DecisionFailed)
        ((stages),) = seen
        assert [slot for slot, stage in stages.items() if stage is Stage.DECIDING] == [drilled]


class Staged(NoRecorder):
    """Remembers who was in the store's write."""

    def __init__(self) -> None:
        super().__init__()
        self.wrote: list[int] = []

    def stage(self, slot: int, stage: Stage) -> None:
        super().stage(slot, stage)
        if stage is Stage.WRITING:
            self.wrote.append(slot)


def test_a_key_that_is_looked_up_is_no_part_of_the_write_it_stands_beside(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        staged = made.journal._recorder = Staged()
        asked, writes = (staged.begin("c", "k", "test", "", (), b"", 0) for _ in range(2))
        assert asked is not None
        assert writes is not None
        made.write(LookUp("k", asked), order(opening("a"), "other", writes))
        assert staged.wrote == [writes]
        staged.close()


def test_a_batch_that_waits_for_the_store_names_all_who_wait(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        made.carry_out(opening("a"), opening("b"))
        seen: list[dict[str, object]] = []
        posted = order(moving(1, "a", "b"))
        made.write(
            posted, exercise(made, lambda: seen.append(names_of_frame(threading.get_ident(), "write")))
        )
        assert seen[0]["transaction_id"] == posted.transaction_id
        assert seen[0]["account_id"] == ",".join(posted.account_ids)


def test_a_reader_that_blocks_names_what_it_was_asked_about(tmp_path: Path) -> None:
    goes_on, begun = threading.Event(), threading.Event()
    readers: list[int] = []

    def wait(_: Connection) -> bool:
        readers.append(threading.get_ident())
        begun.set()
        return goes_on.wait(waiting.WAIT_S)

    async def scenario() -> None:
        async with serving(tmp_path) as service:
            slot = service.begin("read.account", b"")
            assert isinstance(slot, int)
            reading = asyncio.ensure_future(
                service.read(slot, wait, transaction_id="tx-1", account_id="cash")
            )
            assert await asyncio.to_thread(begun.wait, waiting.WAIT_S)
            names = names_of_frame(readers[0], "_ask")
            goes_on.set()
            assert await reading is True
            assert (names["transaction_id"], names["account_id"]) == ("tx-1", "cash")
            service.finish(slot, 200)
            service.drain()
            await service.close()

    asyncio.run(scenario())
