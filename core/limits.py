"""How long each kind of work may be DECIDING before whoever watches may call it stuck. Pure.

The policy gives one number, for a write: deciding one takes microseconds and never waits, so any multiple of it is
a fault. A read asks the store, waits for its lock and may take its honest time, so its limit lies well above the
moment at which it is interrupted by itself: a limit below that would have a healthy core killed for a long list.
The proof of the whole book is no command and has no limit here; it takes no slot. A limit for each route was not
chosen: whoever adds a route would have to know how a guard judges it. A rule that somebody has accepted for one kind
counts instead, but for a read never below its own end.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from core.settings import Settings

READ: Final = "read."  # what the kind of every read begins with
#: A read is interrupted between two steps of the store; after this it has missed that more than once.
READ_TIMES: Final = 3
_NO_RULES: Final[Mapping[str, int]] = MappingProxyType({})


def limit_ms(kind: str, settings: Settings, ruled_ms: Mapping[str, int] = _NO_RULES) -> int:
    """Return how long work of this kind may be DECIDING, in milliseconds. `ruled_ms`: rules, by kind."""
    ruled = ruled_ms.get(kind)
    if kind.startswith(READ):
        own_end_ms = settings.write_busy_ms + settings.read_ms_max
        if ruled is not None:
            return max(ruled, own_end_ms)
        return max(settings.command_deadline_ms, READ_TIMES * own_end_ms)
    return settings.command_deadline_ms if ruled is None else ruled
