"""What waits on the loop: each suspended task with its innermost place and the names on the way, and no more."""

import asyncio
import json
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine, Generator
from contextlib import suppress
from typing import Any, cast

from core.guarded.tasks import (
    DEPTH_MAX,
    ID_CHARACTERS_MAX,
    LOOKED_AT_MAX,
    TOLD_BYTES_MAX,
    TaskNote,
    suspended_tasks,
)


def look_at(*suspended: Callable[[], Coroutine[Any, Any, None]]) -> tuple[list[TaskNote], int]:
    """Suspend each of these in a task of its own, look at them, and end them."""

    async def run() -> tuple[list[TaskNote], int]:
        tasks = [asyncio.create_task(made(), name=f"task-{n}") for n, made in enumerate(suspended)]
        await asyncio.sleep(0)
        seen = suspended_tasks()
        for task in tasks:
            task.cancel()
        for task in tasks:
            with suppress(asyncio.CancelledError):
                await task
        return seen

    return asyncio.run(run())


async def never() -> None:
    await asyncio.get_running_loop().create_future()


async def command(transaction_id: str, account_id: str, secret: str = "hunter2") -> None:  # noqa: ARG001
    await never()


def test_a_task_is_told_with_its_innermost_place_and_its_names() -> None:
    async def request() -> None:
        await command("tx-1", "cash food")

    (note,), count = look_at(request)
    assert count == 1
    place = note.pop("waits_at")
    assert place.startswith("core_guarded/test_tasks.py:")
    assert place.endswith(" never")
    assert note == {"name": "task-0", "transaction_id": "tx-1", "account_id": "cash food"}


def test_the_innermost_name_counts_and_one_that_says_nothing_takes_none_away() -> None:
    async def outer() -> None:
        transaction_id, account_id = "outer", "outer-account"  # noqa: F841  told from its frame
        await command("inner", "")

    (note,), _ = look_at(outer)
    assert (note["transaction_id"], note["account_id"]) == ("inner", "outer-account")


def test_nothing_but_the_two_names_is_told() -> None:
    (note,), _ = look_at(lambda: command("tx-1", "cash"))
    assert "hunter2" not in json.dumps(note)


def test_a_name_that_is_no_plain_text_is_not_told() -> None:
    class Text(str):
        __slots__ = ()

    (note,), _ = look_at(lambda: command(Text("tx-1"), cast("str", ["cash"])))
    assert (note["transaction_id"], note["account_id"]) == ("", "")


def test_what_waits_inside_a_generator_is_followed() -> None:
    class Old(Awaitable[None]):
        def __await__(self) -> Generator[Any, Any, None]:
            account_id = "in-generator"  # noqa: F841  told from its frame
            yield from asyncio.get_running_loop().create_future()

    async def request() -> None:
        await Old()

    (note,), _ = look_at(request)
    assert note["account_id"] == "in-generator"
    assert note["waits_at"].endswith(" __await__")


def test_a_stream_of_values_is_the_place_as_far_as_can_be_seen() -> None:
    async def rows() -> AsyncIterator[int]:
        await never()
        yield 1

    async def request() -> None:
        async for _ in rows():
            pass

    (note,), _ = look_at(request)
    assert note["waits_at"].endswith(" request")


def test_a_chain_without_an_end_is_followed_so_far_and_no_further() -> None:
    async def deep(levels: int) -> None:
        if levels:
            await deep(levels - 1)
        else:
            await command("too-deep", "")

    (note,), _ = look_at(lambda: deep(2 * DEPTH_MAX))
    assert note["waits_at"].endswith(" deep")
    assert note["transaction_id"] == ""


def test_long_names_are_cut() -> None:
    (note,), _ = look_at(lambda: command("t" * 1_000, "a" * 1_000))
    assert (len(note["transaction_id"]), len(note["account_id"])) == (ID_CHARACTERS_MAX, ID_CHARACTERS_MAX)


def test_of_many_tasks_only_so_many_are_looked_at_and_all_are_counted() -> None:
    notes, count = look_at(*[never] * (LOOKED_AT_MAX + 5))
    assert count == LOOKED_AT_MAX + 5
    assert len(notes) <= LOOKED_AT_MAX


def test_the_answer_fits_and_those_that_name_something_come_first() -> None:
    named = [lambda: command("가" * ID_CHARACTERS_MAX, "나" * ID_CHARACTERS_MAX)] * 20
    notes, count = look_at(*[never] * 300, *named)
    assert count == 320
    assert [bool(note["transaction_id"]) for note in notes[:20]] == [True] * 20
    answer = {"ok": True, "tasks": notes, "count": count}
    assert len(json.dumps(answer).encode()) + 1 <= TOLD_BYTES_MAX
