"""A core's recorder at full speed, as a process of its own: `python -m tests.contract.recorder_writer PAGE`.

Everything it writes is derived from one number, so a reader can tell a mixture of two entries from a
whole one without knowing when it was written. It never ends by itself.
"""

import sys
from hashlib import sha256
from itertools import count
from pathlib import Path

from core.guarded.recorder import Recorder, Stage

#: Commands in flight at a time.
OPEN_MAX = 24


def account_ids(n: int) -> list[str]:
    return [f"assets:{n}", f"expenses:{n}"]


def payload(n: int) -> bytes:
    return f"payload of {n} ".encode() * 16


def run(path: Path) -> None:
    recorder = Recorder.open(path)
    assert isinstance(recorder, Recorder), recorder
    component = recorder.component("writer", 100)
    open_slots: list[int] = []
    for n in count(1):
        slot = recorder.begin(f"c{n}", f"key {n}", f"k{n}", f"t{n}", account_ids(n), payload(n), n)
        assert slot is not None
        recorder.ordinal(slot, n)
        recorder.stage(slot, Stage(1 + n % 5))
        component.done()
        open_slots.append(slot)
        if len(open_slots) == OPEN_MAX:
            # Not the oldest: slots are to be used again in another order than they were begun in.
            recorder.finish(open_slots.pop(n % OPEN_MAX), n % 600)
        recorder.witness(n, n + 1, sha256(str(n).encode()).digest())
        recorder.answered(n)
        recorder.census(n, n + 1, n, n, [(f"type{i}.{n}", n + i, n) for i in range(1 + n % 20)])
        recorder.event(f"e{n}", f"text {n}")
        recorder.beat_loop(n)


if __name__ == "__main__":
    run(Path(sys.argv[1]))
