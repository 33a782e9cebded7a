"""Who is connected: what all connections of clients share, whatever protocol they speak."""

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Protocol


class Guest(Protocol):
    """One open connection."""

    def depart(self) -> None:
        """The gateway leaves: end now if nothing is going on, else as soon as it is over."""


@dataclass(slots=True)
class Census:
    """Who is open, and the names this server answers to. `changed` is called when somebody comes or leaves."""

    hosts: Collection[str]
    now_ns: Callable[[], int]
    changed: Callable[[], None]
    connections: set[Guest]
