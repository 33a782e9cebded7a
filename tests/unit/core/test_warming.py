"""A spare while it waits: when it follows the book, and when it leaves it alone."""

import asyncio
from pathlib import Path

import pytest

from core.guarded.orders import PromoteOrder
from core.settings import Settings
from core.warming import Spare
from tests.unit.core.books import Pen, opening
from tests.waiting import WAIT_S

ORDER = PromoteOrder(None, (), None, 1)


def test_a_spare_reads_nothing_while_the_log_is_too_long_and_can_be_promoted_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("core.warming.LOOK_EVERY_S", 0.001)

    async def scenario() -> None:
        made = Pen(tmp_path)
        made.carry_out(opening("a"))
        monkeypatch.setattr("core.warming.LOG_BYTES_MAX", 0)
        told: list[str] = []
        monkeypatch.setattr(made.recorder, "event", lambda code, _: told.append(code))
        spare = Spare(tmp_path, Settings(), made.recorder)
        await spare.warm_up()
        waiting = asyncio.create_task(spare.told())
        async with asyncio.timeout(WAIT_S):
            while told != ["SPARE_ASIDE"]:  # noqa: ASYNC110  it tells nobody else
                await asyncio.sleep(0)
            made.carry_out(opening("b"))
            for _ in range(10):
                await asyncio.to_thread(lambda: None)
                assert spare.seq == 1
            monkeypatch.setattr("core.warming.LOG_BYTES_MAX", 1 << 30)
            while spare.seq == 1:  # noqa: ASYNC110  as above
                await asyncio.sleep(0)
            assert told == ["SPARE_ASIDE", "SPARE_FOLLOWS"]
            monkeypatch.setattr("core.warming.LOG_BYTES_MAX", 0)
            begin = spare.promote(ORDER)
            assert not isinstance(begin, str)
            begin()
            assert await waiting == ORDER
        spare.close()
        made.close()

    asyncio.run(scenario())
