"""Recorded traces of real processes: small JSON files, in which each tick says only what has changed since the last.

`record.py` makes them; here they are written and read.
"""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from hardcore.model import observations as seen
from hardcore.model import recorder as words
from hardcore.model.clocks import Clocks
from hardcore.model.codec import Codec, Undecodable
from hardcore.model.looks import ProcessSample, StackFrame, ThreadSample, ThreadStack

FOLDER = Path(__file__).parent / "traces"
Fact = seen.Sampled | seen.StacksSampled
CODEC = Codec(
    [
        seen.Sampled,
        seen.StacksSampled,
        ThreadStack,
        StackFrame,
        ThreadSample,
        ProcessSample,
        Clocks,
        words.Beats,
        words.Threads,
        words.Witness,
        words.CommandNote,
        words.SlotStage,
        words.LifeState,
    ]
)


def write(path: Path, facts: list[Fact]) -> None:
    lines, last = [], None
    for fact in facts:
        told = CODEC.encode(fact)
        if isinstance(fact, seen.Sampled):
            lines.append(_changed(last, told) if last is not None else told)
            last = told
        else:
            lines.append(told)
    path.write_text("".join(json.dumps(line, separators=(",", ":")) + "\n" for line in lines))


def read(name: str) -> Iterator[Fact]:
    last: Any = None
    for line in (FOLDER / f"{name}.jsonl").read_text().splitlines():
        told = json.loads(line)
        if "StacksSampled" not in told:
            told = last = told if last is None else _merged(last, told)
        fact = CODEC.decode(told)
        assert not isinstance(fact, Undecodable), fact
        yield fact


def _changed(last: Any, now: Any) -> Any:
    """What is to be said of `now` to somebody who knows `last`; what is gone is null."""
    if not isinstance(last, dict) or not isinstance(now, dict):
        return now
    changed = {key: _changed(last.get(key), value) for key, value in now.items() if last.get(key) != value}
    return {**changed, **dict.fromkeys(last.keys() - now.keys())}


def _merged(last: Any, changed: Any) -> Any:
    if not isinstance(last, dict) or not isinstance(changed, dict):
        return changed
    merged = {key: _merged(last.get(key), value) for key, value in changed.items()}
    return {key: value for key, value in {**last, **merged}.items() if value is not None}
