"""What the rooms at the door know of the sentinel around them, and how they say no.

A protocol and not the sentinel itself: whoever answers questions can feed facts and read the moment, and reach nothing
else of the loop. The tests play a house with it.
"""

from collections.abc import Callable, Coroutine, Mapping
from typing import Any, Protocol

from hardcore.chronicle import Chronicle
from hardcore.court_room import CourtRoom
from hardcore.host.folders import Folders
from hardcore.host.lives import Life
from hardcore.investigating import Investigators
from hardcore.model import observations as seen
from hardcore.outbox import Outbox
from hardcore.recovery.policy import Policy
from hardcore.recovery.reading import Reading

Answer = tuple[Mapping[str, object], list[int]]


class House(Protocol):
    """What the door needs of the sentinel around it."""

    folders: Folders
    policy: Policy
    listen_fd: int
    url: str
    generation: int
    adopted: bool
    court: CourtRoom
    investigators: Investigators
    chronicle: Chronicle
    outbox: Outbox
    note: Callable[..., None]  # writes a line to the guard's log

    def begin(self, work: Coroutine[Any, Any, None]) -> None:
        """Start a piece of work that nobody waits for."""

    def feed(self, fact: seen.Observation) -> None:
        """Give the manager a fact and do what it orders."""

    def reading(self) -> Reading:
        """Return what the present moment means."""

    def life(self) -> Life | None:
        """Return the present life of the core."""

    def numbered(self, number: int) -> Life | None:
        """Return a life by its number, if its process has been made."""

    def gateway_told(self) -> Mapping[str, object]:
        """Return what a status says of the gateway."""

    def drill_gateway(self) -> str | None:
        """Kill the gateway, as a drill; return why that can't be done now."""

    def curve(self) -> list[dict[str, Any]]:
        """Return what is known of each resource over time."""

    async def in_hand(self, work: Callable[..., Any], *args: Any) -> Any:
        """Run blocking work on a hand's thread."""

    async def confine(self, life: Life) -> str | None:
        """Put the core into a memory cgroup of its own; return why that can't be done here."""

    async def hold_lock(self, seconds: int) -> str | None:
        """Have another process take the ledger's lock for so long; return why it could not."""


def refuse(code: str, error: str, **values: object) -> Answer:
    """Say no. The code and its values are for whoever says it in another language."""
    return {"ok": False, "code": code, "error": error, "values": values}, []
