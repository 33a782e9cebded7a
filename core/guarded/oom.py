"""Which of us the kernel ends first when memory runs out: the spare before the core, both before what watches them.

A number on the process itself (`oom_score_adj`), which anyone may raise and take back to what it was. A spare that
is ended costs nobody anything. Not chosen: to ask for a number below that of other programs; it takes a privilege,
and the household's machine has more important things on it than this ledger.
"""

from contextlib import suppress
from pathlib import Path
from typing import Final

CORE: Final = 300
SPARE: Final = 800


def rank(score: int) -> None:
    """Have the kernel rank this process by `score`. Where it lets nobody say so, all stays as it was."""
    with suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text(f"{score}\n", "ascii")
