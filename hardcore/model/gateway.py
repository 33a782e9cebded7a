"""What a reader finds on the gateway's own page, as values: its beats, and which requests stood where.

The bytes are `docs/wires.md` section 18. A path is known by its hash only: who asked for what is nobody's business
here, and a name of eight bytes is enough to tell that it was the same one twice.
"""

from enum import IntEnum

import msgspec


class Stage(IntEnum):
    """Where a request is in the gateway. PARSING: its bytes are in our own hands, and nobody else's."""

    FREE = 0
    PARSING = 1
    HELD = 2
    FORWARDED = 3
    ANSWERING = 4


class GatewayPulse(msgspec.Struct, frozen=True):
    """The head of the page. Times are monotonic nanoseconds, 0 for never; counts only grow."""

    pid: int = 0
    start: int = 0
    loop_thread: int = 0
    beat_thread: int = 0
    loop_ns: int = 0
    loop_count: int = 0
    thread_ns: int = 0
    begun: int = 0
    over: int = 0
    overdue: int = 0  # answered 504: the core had not answered in time
    overdue_ns: int = 0
    refused: int = 0  # answered 400 because their path had killed a gateway
    gc_since_ns: int = 0  # in garbage collection since then; 0: not


class GatewayRequest(msgspec.Struct, frozen=True):
    """One request that the gateway had. `path_hash` is empty while its path is not known."""

    stage: Stage
    since_ns: int
    path_hash: str
    bytes_read: int
    connection: int


class GatewayPage(msgspec.Struct, frozen=True):
    """The whole page at one moment."""

    pulse: GatewayPulse
    requests: tuple[GatewayRequest, ...]

    def parsing(self) -> frozenset[str]:
        """Return the paths that were being parsed, as far as they are known."""
        return frozenset(
            one.path_hash for one in self.requests if one.stage is Stage.PARSING and one.path_hash
        )
