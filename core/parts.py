"""The components of this core: parts that work by themselves and can each be ended and begun anew alone.

A component has its own beat on the recorder page, so a guard sees that it stands still while requests are answered;
then it orders that part anew and nothing else. What a part must do for that is small and the same for all: leave
behind what hangs, see to it that this never does anything again, and begin. Not chosen: a process for each; they all
work on the book of this one, and a second writer is what the whole design keeps away.
"""

from collections.abc import Callable
from functools import partial
from typing import Final, Protocol

NOTHING_OF_THE_KIND: Final = "This core has no such component now."


class Part(Protocol):
    """What can be begun anew alone. On the loop's thread, and at once: nothing here may wait for what hangs."""

    def begin_anew(self) -> None:
        """Leave behind what is at work, for good, and begin."""
        ...

    def stall(self) -> None:
        """Get on no more from now on, until it is begun anew: a drill."""
        ...


class Parts:
    """All components of this core, by the names on its recorder page."""

    def __init__(self) -> None:
        """Have none yet: they come with the book."""
        self._parts: dict[str, Part] = {}

    def add(self, name: str, part: Part) -> None:
        """Take orders for a component."""
        self._parts[name] = part

    def begin_anew(self, name: str) -> str | None:
        """Begin a component anew; return why that can't be done, None if it is done."""
        part = self._parts.get(name)
        if part is None:
            return NOTHING_OF_THE_KIND
        part.begin_anew()
        return None

    def stall(self, name: str) -> Callable[[], object] | str:
        """Return what stalls a component once it is called, or why it can't be stalled."""
        part = self._parts.get(name)
        return NOTHING_OF_THE_KIND if part is None else partial(part.stall)
