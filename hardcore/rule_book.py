"""The rules in force, as their one writer keeps them: changed one after the other, on the disk before anybody is told.

A change is a function from one value to the next (`quarantine_file`); it is made under a lock, written, and only then
counts. What a court decides is written until the disk takes it; what a person asks is refused where it can't be written.
Then every core that lives is told to read anew, and the gateway after them: whoever hears of a verdict and sends its
request again meets a core that knows the rule. Not chosen: to tell first and write behind; a death in between would
forget a poison that somebody was told is set aside.
"""

import asyncio
from collections.abc import Awaitable, Callable, Coroutine, Mapping, Sequence
from itertools import chain, repeat
from pathlib import Path
from typing import Any, Final, Protocol

import msgspec

from hardcore import quarantine_file
from hardcore.host import clock, core_control
from hardcore.host.folders import Folders
from hardcore.host.ids import new_id
from hardcore.model import trials
from hardcore.model.observations import Observation
from hardcore.quarantine_file import Aside

#: Pauses before what a disk did not take is tried again; the last one again and again.
RETRY_PAUSES_S: Final = (0.1, 0.5, 2.0, 10.0, 60.0)
#: A person who changes a rule waits so long for a disk that is busy with another one.
PERSON_WAITS_S: Final = 5.0
#: A core reads its rules in milliseconds; one that does not answer reads them when it opens its book.
TOLD_S: Final = 0.5


class Hands(Protocol):
    """What is needed of the executor around it."""

    halted: asyncio.Event

    def begin(self, work: Coroutine[Any, Any, None]) -> None:
        """Start a piece of work that nobody waits for."""

    async def in_hand(self, work: Callable[..., Any], *args: Any) -> Any:
        """Run blocking work on a hand's thread."""

    def note(self, kind: str, **particulars: object) -> None:
        """Write a line to the guard's log."""


class Doors(msgspec.Struct, frozen=True):
    """Whom the court speaks to. `cores`: the control sockets of those that live; `calm`: no switch is under way."""

    tell: Callable[[Observation], None]
    publish: Callable[[Mapping[str, object]], None]
    cores: Callable[[], Sequence[Path]]
    calm: Callable[[], Awaitable[None]]
    add_trials: Callable[[trials.AddTrials], Coroutine[Any, Any, None]]


class RuleBook:
    """See the module. `aside` is what is in force."""

    def __init__(self, folders: Folders, generation: int, hands: Hands, doors: Doors) -> None:
        self.aside = Aside()
        self._folders = folders
        self._generation = generation
        self._hands = hands
        self._doors = doors
        self._writing = asyncio.Lock()
        self._arming = asyncio.Lock()

    async def change(self, change: Callable[[Aside], Aside], *, patient: bool = True) -> bool:
        """Change what the file says, for good; return whether it lies there. `patient`: tried until the disk takes it.

        Each try is a change of its own: between two of them others have their turn, and are told that there is no room.
        """
        if patient:
            return await self.persist(lambda: self._try(change))
        return not await self._try(change, PERSON_WAITS_S)

    async def _try(self, change: Callable[[Aside], Aside], wait_s: float | None = None) -> str:
        """Change what the file says, if the disk takes it; return why it does not."""
        try:
            async with asyncio.timeout(wait_s):
                await self._writing.acquire()
        except TimeoutError:
            return "the disk does not answer"
        try:
            after = change(self.aside)
            failed: str = "" if after is self.aside else await self._hands.in_hand(self._put, after)
            if not failed:
                self.aside = after
            return failed
        finally:
            self._writing.release()

    async def show(self, change: Callable[[Aside], Aside]) -> str:
        """Change what every process sees, at once and without an fsync; return why that can't be done.

        What is shown counts whether or not the disk takes it: `keep` has it written for good.
        """
        async with self._writing:
            self.aside = change(self.aside)
            failed: str = await self._hands.in_hand(self._put, self.aside, False)
            return failed

    async def keep(self) -> str:
        """Have what is in force outlast a power cut, too; return why that can't be done."""
        async with self._writing:
            failed: str = await self._hands.in_hand(self._put, self.aside)
            return failed

    def _put(self, aside: Aside, durable: bool = True) -> str:  # noqa: FBT001, FBT002  # a hand takes no names
        try:
            quarantine_file.write(self._folders, aside, durable=durable)
        except OSError as error:
            return error.strerror or type(error).__name__
        return ""

    async def persist(self, write: Callable[[], Awaitable[str]]) -> bool:
        """Have it written until it is, or the guard ends: what is left then is done by the next one.

        `write` returns why it can't be done, or nothing when it is.
        """
        for pause_s in chain(RETRY_PAUSES_S, repeat(RETRY_PAUSES_S[-1])):
            failed = await write()
            if not failed:
                return True
            self._hands.note("court", failed=failed)
            if self._hands.halted.is_set():
                return False
            try:
                await asyncio.wait_for(self._hands.halted.wait(), pause_s)
            except TimeoutError:
                continue
        raise AssertionError("the pauses have no end")

    async def tell_cores(self) -> bool:
        """Have every core that lives read the rules anew, and the gateway after them; return whether a core has."""
        order = self._order()
        told = await asyncio.gather(*(core_control.give(path, order, TOLD_S) for path in self._doors.cores()))
        for refused in filter(None, told):
            self._hands.note("quarantine", untold=refused)
        self._doors.publish(self.line())
        return not all(told)

    async def tell_released(self, core: Path) -> None:
        """Have the core that is released read the rules: all who are suspect are named there, and its own work may begin."""
        refused = await core_control.give(core, self._order(), TOLD_S)
        if refused:
            self._hands.note("quarantine", untold=refused)

    def _order(self) -> dict[str, object]:
        return {"verb": "quarantine", "generation": self._generation}

    def line(self) -> dict[str, object]:
        """Return the line that has a gateway read the rules anew."""
        return {"type": "quarantine", "serial": self.aside.serial}

    # ---- what people ask ----

    async def add(self, wish: object) -> dict[str, object] | str:
        """Put a person's rule in force; return its id, or one sentence that says why not."""
        rule = quarantine_file.judge(wish, new_id())
        if isinstance(rule, str):
            return rule
        if self.aside.rule(rule["id"]) is not None:
            return {"id": rule["id"], "changed": False}
        if len(self.aside.rules) >= quarantine_file.RULES_MAX:
            return f"There are {quarantine_file.RULES_MAX} rules already. Remove one first."
        if not await self.change(lambda aside: quarantine_file.with_rule(aside, rule), patient=False):
            return "The rule can't be written. Make room in the data folder and try again."
        await self.tell_cores()
        return {"id": rule["id"], "changed": True}

    async def remove(self, rule_id: str) -> dict[str, object] | str:
        """Take a rule away; what a letter's rule named may run again. Return whether there was one, or why not."""
        rule = self.aside.rule(rule_id)
        if rule is None:
            return {"changed": False}
        if quarantine_file.UNSENT in rule:
            return "Its letter has yet to be written. Try again in a moment."
        if not await self.change(lambda aside: quarantine_file.without_rule(aside, rule_id), patient=False):
            return "The rule can't be taken away. Make room in the data folder and try again."
        await self.tell_cores()
        self._doors.tell(trials.RuleRemoved(clock.now_ns(), rule_id))
        return {"changed": True}

    # ---- the drill ----

    async def arm(self, name: str) -> str:
        """Let the command of this name kill whoever executes it; return why that can't be done."""
        try:
            async with self._arming:
                await self._hands.in_hand(quarantine_file.arm, self._folders, name)
        except OSError as error:
            return f"The drill can't be written down ({error.strerror})."
        return "" if await self.tell_cores() else "No core has read the drill."

    async def disarm(self, name: str) -> None:
        """End the drill, if it is this one that is armed."""
        try:
            async with self._arming:
                await self._hands.in_hand(quarantine_file.disarm, self._folders, name)
        except OSError as error:
            self._hands.note("drill", armed=name, failed=error.strerror)
