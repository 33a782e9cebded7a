"""A guest whose loop ends in an exception while a thread that nobody stops keeps its process alive.

`python -m tests.contract.loop_that_ends PAGE`: it beats until a line comes on its standard input.
"""

import asyncio
import sys
import threading
from pathlib import Path

from core.guarded.environment import GuardedEnvironment
from core.guarded.life import guarded_life, take_instruments
from core.guarded.recorder import LifeState, RecorderUnusable
from tests.unit.core_guarded.guest import Bare


async def _live() -> None:
    environment = GuardedEnvironment(recorder=Path(sys.argv[1]))
    instruments = take_instruments(environment)
    assert not isinstance(instruments, RecorderUnusable), instruments
    recorder, beacon = instruments.recorder, instruments.beacon
    async with guarded_life(environment, recorder, beacon, guarded=Bare(), on_term=lambda _: None):
        recorder.set_state(LifeState.READY)
        threading.Thread(target=threading.Event().wait, name="nobody stops it").start()
        await asyncio.to_thread(sys.stdin.readline)
        raise ValueError("nobody catches this")


if __name__ == "__main__":
    asyncio.run(_live())
