import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import msgspec

from core.guarded.recorder import Stage
from core.journal import queries
from core.journal.answers import Answer, Done, Leaving, OutcomeUnknown, ReadOnly
from core.journal.fence import Raised
from core.journal.store import StoreError
from core.journal.writer import Writer
from core.ledger.commands import Command
from tests.unit.core.books import Pen, failing_at_commit, fenced, moving, opened, opening, order

FOR_EVER_NS = 3_600_000_000_000


class Heard:
    """What the writer told about its end."""

    def __init__(self) -> None:
        self.shut: list[StoreError] = []
        self.failed: list[str] = []
        self.fenced: list[int] = []
        self.bugs: list[Exception] = []


@asynccontextmanager
async def writing(made: Pen, heard: Heard) -> AsyncIterator[Writer]:
    writer = Writer(
        made.journal,
        made.recorder,
        asyncio.get_running_loop(),
        on_shut=heard.shut.append,
        on_failed=heard.failed.append,
        on_fenced=heard.fenced.append,
        on_bug=heard.bugs.append,
    )
    writer.start()
    try:
        yield writer
    finally:
        await writer.stop()
        made.recorder.close()


def ask(writer: Writer, made: Pen, command: Command, key: str | None = None) -> "asyncio.Future[Answer]":
    slot = made.recorder.begin("c", key, "test", "", (), b"", 0)
    assert slot is not None
    return writer.submit(order(command, key, slot))


def test_everything_that_waits_is_answered_in_order(tmp_path: Path) -> None:
    async def scenario() -> None:
        made, heard = Pen(tmp_path), Heard()
        async with writing(made, heard) as writer:
            first = [ask(writer, made, opening(name)) for name in "ab"]
            futures = [ask(writer, made, moving(n, "a", "b"), f"k{n}") for n in range(100)]
            answers = await asyncio.gather(*first, *futures)
            assert all(isinstance(answer, Done) for answer in answers)
            assert writer.head_seq == 102
        assert not heard.bugs

    asyncio.run(scenario())


def test_a_second_request_with_a_running_key_waits_for_the_first(tmp_path: Path) -> None:
    async def scenario() -> None:
        made, heard = Pen(tmp_path), Heard()
        async with writing(made, heard) as writer:
            first, second = ask(writer, made, opening("a"), "k"), ask(writer, made, opening("a"), "k")
            done, again = await asyncio.gather(first, second)
            assert isinstance(done, Done)
            assert again == Done(done.status, done.body, replayed=True)

    asyncio.run(scenario())


def test_stopping_writes_what_waits_and_refuses_what_comes_later(tmp_path: Path) -> None:
    async def scenario() -> None:
        made, heard = Pen(tmp_path), Heard()
        async with writing(made, heard) as writer:
            waiting = [ask(writer, made, opening(f"a{n}")) for n in range(50)]
            stopping = asyncio.create_task(writer.stop())
            await asyncio.sleep(0)
            late = ask(writer, made, opening("late"))
            await stopping
            assert all(isinstance(answer, Done) for answer in await asyncio.gather(*waiting))
            assert await late == Leaving()

    asyncio.run(scenario())


def test_a_fenced_writer_answers_nobody(tmp_path: Path) -> None:
    async def scenario() -> None:
        made, heard = Pen(tmp_path), Heard()
        async with writing(made, heard) as writer:
            await ask(writer, made, opening("a"))
            successor = opened(tmp_path)
            assert fenced(successor, None) == Raised(2)
            unanswered = ask(writer, made, opening("b"))
            await writer.stop()
            assert heard.fenced == [2]
            assert not unanswered.done()
            assert [account.id for account in queries.all_accounts(successor)] == ["a"]
            successor.close()
            successor.engine.dispose()

    asyncio.run(scenario())


def test_a_failed_commit_answers_its_batch_unknown_and_the_rest_not_done(tmp_path: Path) -> None:
    async def scenario() -> None:
        made, heard = Pen(tmp_path), Heard()
        async with writing(made, heard) as writer:
            await ask(writer, made, opening("a"))
            await ask(writer, made, opening("b"))
            failing_at_commit(made.connection)
            futures = [ask(writer, made, moving(1, "a", "b"), f"k{n}") for n in range(200)]
            answers = await asyncio.gather(*futures)
            assert OutcomeUnknown() in answers
            first_unknown = answers.index(OutcomeUnknown())
            assert all(isinstance(answer, Done) for answer in answers[:first_unknown])
            assert set(answers[first_unknown:]) <= {OutcomeUnknown(), Leaving()}
            assert len(heard.failed) == 1
            assert await ask(writer, made, opening("c")) == Leaving()

    asyncio.run(scenario())


def test_a_full_disk_is_told_before_its_batch_hears_so_and_the_writer_goes_on(tmp_path: Path) -> None:
    async def scenario() -> None:
        made, heard = Pen(tmp_path), Heard()
        async with writing(made, heard) as writer:
            await ask(writer, made, opening("a"))
            writer.pretend_full(time.monotonic_ns() + FOR_EVER_NS)
            future = ask(writer, made, opening("b"))
            heard_first: list[int] = []
            future.add_done_callback(lambda _: heard_first.append(len(heard.shut)))
            assert await future == ReadOnly("DISK_FULL")
            await asyncio.sleep(0)
            assert heard_first == [1]
            writer.pretend_full(0)
            assert isinstance(await ask(writer, made, opening("b")), Done)
        assert not heard.failed
        assert not heard.bugs

    asyncio.run(scenario())


def test_a_writer_that_meets_a_bug_says_so_instead_of_going_quiet(tmp_path: Path) -> None:
    async def scenario() -> None:
        made, heard = Pen(tmp_path), Heard()
        async with writing(made, heard) as writer:
            broken = order(opening("a"), slot=0)
            made.recorder.begin("c", None, "test", "", (), b"", 0)
            msgspec.structs.force_setattr(broken, "account_ids", None)
            unanswered = writer.submit(broken)
            await writer.stop()
            assert len(heard.bugs) == 1
            assert not unanswered.done()

    asyncio.run(scenario())


def test_a_cancelled_request_does_not_disturb_the_others(tmp_path: Path) -> None:
    async def scenario() -> None:
        made, heard = Pen(tmp_path), Heard()
        async with writing(made, heard) as writer:
            gone, stays = ask(writer, made, opening("a")), ask(writer, made, opening("b"))
            gone.cancel()
            assert isinstance(await stays, Done)
        assert not heard.bugs

    asyncio.run(scenario())


def test_stages_are_the_recorders_own() -> None:
    assert [stage.name for stage in Stage] == [
        "FREE",
        "QUEUED",
        "DECIDING",
        "WRITING",
        "COMMITTED",
        "ANSWERING",
    ]
