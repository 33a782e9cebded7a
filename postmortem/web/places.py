"""What the pages are given from outside: the folders they read, and the two ways to do something.

Functions instead of a client of the guard: the pages do not know which socket leads to it, and a test gives them a
guard of three lines. Everything that only the archive knows comes by `views.Reads` and `views.Acts`.
"""

from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path
from typing import Any

import msgspec

#: Asks the guard one question of its control socket; None: no guard answers.
AskGuard = Callable[[Mapping[str, Any]], Awaitable[Mapping[str, Any] | None]]
#: Writes a line of the audit log: verb, what it was done to, the reason, what came of it.
WriteDown = Callable[[str, str, str, str], Awaitable[None]]


class Places(msgspec.Struct, frozen=True):
    """`incidents`: the folder of all incidents. `data`: the data folder, for the room that is left on its disk.

    `token`: what every form carries as `_csrf` and every form's sender has to send back. `version`: of the code.
    """

    incidents: Path
    data: Path
    token: str
    ask_guard: AskGuard
    write_down: WriteDown
    version: str
