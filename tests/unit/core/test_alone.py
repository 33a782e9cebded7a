"""Work on a thread of its own: one that comes back does the next piece, one that hangs is left behind."""

import asyncio
import threading
from uuid import uuid4

import pytest

from core.alone import alone


def test_a_thread_that_comes_back_does_a_later_piece() -> None:
    async def until_one_does_two(name: str) -> set[threading.Thread]:
        seen: set[threading.Thread] = set()
        # Who waits may hear of a piece before its thread is free again: the next one is then done by another.
        while (doing := await alone(threading.current_thread, name)) not in seen:
            seen.add(doing)
        return seen

    assert all(thread.daemon for thread in asyncio.run(until_one_does_two(uuid4().hex)))


def test_a_piece_that_hangs_holds_up_no_other() -> None:
    name, released = uuid4().hex, threading.Event()

    async def beside() -> str:
        hangs = asyncio.create_task(alone(released.wait, name))
        await asyncio.sleep(0)
        told = await alone(lambda: "done", name)
        hangs.cancel()
        return told

    try:
        assert asyncio.run(beside()) == "done"
    finally:
        released.set()


def test_what_a_piece_raises_is_raised_to_who_waits_and_its_thread_goes_on() -> None:
    async def wrong() -> None:
        await alone(lambda: 1 // 0, "wrong")

    for _ in range(2):
        with pytest.raises(ZeroDivisionError):
            asyncio.run(wrong())
