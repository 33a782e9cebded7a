"""A core that may have been stopped: when it looks whether it still is the core, and who waits for that."""

import asyncio
from collections.abc import Callable

from core.tenure import STOPPED_NS, Tenure


class Store:
    """A store whose epoch can be asked for, once it may be read."""

    def __init__(self, epoch: int | None) -> None:
        self.epoch = epoch
        self.asked = 0
        self.readable = asyncio.Event()

    async def ask(self) -> int | None:
        self.asked += 1
        await self.readable.wait()
        return self.epoch


def run(scenario: Callable[[], object]) -> None:
    async def inside() -> None:
        done = scenario()
        assert asyncio.iscoroutine(done)
        await done

    asyncio.run(inside())


def test_a_core_that_beats_is_sure_without_a_look() -> None:
    async def scenario() -> None:
        store, over = Store(9), list[int]()
        tenure = Tenure(1, store.ask, over.append)
        for _ in range(3):
            tenure.beat(tenure._seen_ns + STOPPED_NS)
        tenure._seen_ns = 2**62  # no matter how slow this test is
        await tenure.sure()
        assert (store.asked, over) == (0, [])

    run(scenario)


def test_after_a_gap_every_answer_waits_for_one_look() -> None:
    async def scenario() -> None:
        store, over = Store(2), list[int]()
        tenure = Tenure(1, store.ask, over.append)
        tenure.beat(tenure._seen_ns + STOPPED_NS + 1)
        tenure._seen_ns = 2**62
        answers = [asyncio.ensure_future(tenure.sure()) for _ in range(3)]
        await asyncio.sleep(0)
        assert not any(answer.done() for answer in answers)
        store.readable.set()
        await asyncio.gather(*answers)
        assert (store.asked, over) == (1, [2])

    run(scenario)


def test_the_first_answer_after_a_stop_looks_although_no_beat_came_before_it() -> None:
    async def scenario() -> None:
        store, over = Store(2), list[int]()
        store.readable.set()
        tenure = Tenure(1, store.ask, over.append)
        tenure._seen_ns = -STOPPED_NS  # it has beaten long ago
        await tenure.sure()
        assert (store.asked, over) == (1, [2])

    run(scenario)


def test_a_core_that_is_still_the_core_or_can_not_know_goes_on() -> None:
    async def scenario() -> None:
        for epoch in (1, None):
            store, over = Store(epoch), list[int]()
            store.readable.set()
            tenure = Tenure(1, store.ask, over.append)
            tenure._seen_ns = -STOPPED_NS
            await tenure.sure()
            await tenure.sure()
            assert (store.asked, over) == (1, [])

    run(scenario)


def test_a_stop_while_the_store_is_looked_at_is_doubt_of_its_own() -> None:
    async def scenario() -> None:
        store, over = Store(1), list[int]()
        tenure = Tenure(1, store.ask, over.append)
        tenure.beat(tenure._seen_ns + STOPPED_NS + 1)
        await asyncio.sleep(0)
        assert store.asked == 1, "it looks"
        tenure.beat(tenure._seen_ns + STOPPED_NS + 1)
        tenure._seen_ns = 2**62
        answer = asyncio.ensure_future(tenure.sure())
        store.readable.set()
        await answer
        assert (store.asked, over) == (2, [])

    run(scenario)


def test_a_core_that_has_let_go_of_its_book_asks_no_more_whose_it_is() -> None:
    async def scenario() -> None:
        store, over = Store(2), list[int]()
        tenure = Tenure(1, store.ask, over.append)
        tenure.beat(tenure._seen_ns + STOPPED_NS + 1)
        await asyncio.sleep(0)
        tenure.lay_down()
        store.readable.set()
        await tenure.sure()
        tenure.beat(tenure._seen_ns + STOPPED_NS + 1)
        tenure._seen_ns = 2**62
        await tenure.sure()
        assert (store.asked, over) == (1, [])

    run(scenario)
