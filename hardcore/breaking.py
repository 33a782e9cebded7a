"""Breaks the core on an operator's word: whether it may be broken now, what has to be ready, what it is told.

What is broken already teaches nothing when broken, so a drill asks for a core that runs, for nobody who would notice, and
for no other drill. It is noted with the manager before the core hears of it: its next death is a drill, whoever finds it.
The poison is told to no core in words: a request is armed, and whoever executes it dies of it, a trial as well.
The guard's own death is made by itself, once its answer is out: it needs no other process that could mistake whom it kills.
A leak that leads to nothing is given back by the guard, because whoever asked for it may have gone home.
"""

import asyncio
import hashlib
import json
import os
import signal
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path

from hardcore.control.protocol import (
    LEAK_MB_PER_S,
    LEAK_MB_PER_S_MAX,
    LEAK_S,
    NAME_DIGITS,
    PEACE_S,
    PEACEFUL,
    Request,
    write_line,
)
from hardcore.host import clock, files
from hardcore.host.folders import Folders
from hardcore.host.ids import new_id
from hardcore.host.lives import Life
from hardcore.host.sentinel_page import LAST_WORDS
from hardcore.house import Answer, House, refuse
from hardcore.model import observations as seen
from hardcore.model.phases import Phase
from hardcore.recovery.budget import NS_PER_S
from hardcore.recovery.drill import LEAK_S_MAX, grace_ns

CORE_ANSWER_S = 2.0
#: An answer at our own door is out after this.
ANSWERED_S = 0.05
#: How long the drill `dblock` keeps the ledger's lock: long enough to be told from a busy moment.
LOCK_HELD_S = 4
CORE_LINE_BYTES_MAX = 4096


def _drill_is_on() -> Answer:
    return refuse("drill-under-way", "Another drill is under way. Wait until it is over.")


def _end_the_guard(folders: Folders) -> Answer:
    """Have this very process be killed, as from outside: nothing is tidied up, and only the next guard knows why."""
    with suppress(OSError):  # without these words its loss is told as a real one, which is the safe side
        told = {"nonce": files.read_json(folders.sentinel).get("nonce")}
        files.write_json(folders.run / LAST_WORDS, told, durable=False)
    asyncio.get_running_loop().call_later(ANSWERED_S, signal.raise_signal, signal.SIGKILL)
    return {"ok": True, "fault": "sentinel", "pid": os.getpid(), "since": clock.wall(clock.now_ns())}, []


def _particulars(request: Request) -> dict[str, object]:
    """Return what the order of a drill says beside its name."""
    match request.fault:
        case "oom":
            return {"armed": True}  # said only once the core is confined
        case "leak":
            seconds, pace = request.seconds or LEAK_S, request.mb_per_s or LEAK_MB_PER_S
            return {"seconds": min(seconds, LEAK_S_MAX), "mb_per_s": min(pace, LEAK_MB_PER_S_MAX)}
        case "stall":
            return {"component": request.component}
        case _:
            return {}


class Breaking:
    """Breaks the core of a house. `others`: how many are connected, as the gateway says."""

    def __init__(self, house: House, others: Callable[[], int]) -> None:
        self._house = house
        self._others = others
        self._preparing = False
        self._peace_until_ns = 0
        self._waited_ns = 0  # so long the drill that was begun last may take to show

    async def drill(self, request: Request) -> Answer:
        """Break it, or say why it is not broken."""
        if self._preparing:
            return _drill_is_on()
        life = self._fit(request)
        if not isinstance(life, Life):
            return life
        self._preparing = True  # until the manager knows of it: two drills would be told as one
        try:
            if request.fault == "spare":
                return await self._end_spare()
            if request.fault == "sentinel":
                return _end_the_guard(self._house.folders)
            if request.fault == "gateway":
                return self._end_the_gateway()
            if request.fault == "poison":
                return await self._poison(life)
            return await self._break(request, life)
        finally:
            self._preparing = False

    def _fit(self, request: Request) -> Life | Answer:
        """Return the core to break, or why none can be: what is broken already teaches nothing when broken."""
        reading, life = self._house.reading(), self._house.life()
        if not self._house.policy.drills:
            return refuse("drills-off", "The policy forbids drills (`drills` is false).")
        if reading.phase not in {Phase.RUNNING, Phase.SUSPECT} or life is None:
            return refuse(
                "not-running",
                f"A drill needs a core that runs; it is {reading.phase} now.",
                phase=reading.phase,
            )
        now_ns = clock.now_ns()
        waits = reading.drill_ns is not None and now_ns - reading.drill_ns <= self._waited_ns
        if waits or now_ns < self._peace_until_ns:
            return _drill_is_on()
        if reading.safe is not None:
            return refuse("reads-only", "The ledger only reads at present: there is trouble enough.")
        if reading.incident is not None:
            return refuse(
                "incident-open",
                f"Incident {reading.incident} is still open. Wait until it is closed.",
                incident=reading.incident,
            )
        others = self._others()
        if others and not request.yes and request.fault not in PEACEFUL:
            return refuse(
                "others",
                f"Others are connected ({others}). Add --yes to break the core under them.",
                count=others,
            )
        return self._knows(request) or life

    def _knows(self, request: Request) -> Answer | None:
        """Refuse a part that the core has not."""
        known = [each.name for each in self._house.reading().components]
        if request.fault != "stall" or request.component in known or (request.component and not known):
            return None
        names = ", ".join(known)
        words = f"{request.component!r} is no part of this core; it has: {names}."
        return refuse("component-unknown", words, component=request.component, names=names)

    async def _break(self, request: Request, life: Life) -> Answer:
        unable = await self._prepare(request.fault, life)
        if unable is not None:
            return refuse("not-here", unable)
        fit = self._fit(request)  # again: preparing may take seconds
        if not isinstance(fit, Life):
            return fit
        if fit is not life:
            return refuse("core-refused", "The core has changed while its drill was prepared. Ask again.")
        began_ns, particulars = clock.now_ns(), _particulars(request)
        if request.fault not in PEACEFUL:
            self._note(seen.DrillStarted(began_ns, request.fault, life.number))
        refused = await self._tell_core(life, request.fault, particulars)
        if refused:
            self._house.feed(seen.DrillStarted(0, "", life.number))
            return refuse("core-refused", refused)
        if request.fault in PEACEFUL:
            self._peace_until_ns = clock.now_ns() + int(PEACE_S * NS_PER_S)
        if isinstance(seconds := particulars.get("seconds"), int):
            loop = asyncio.get_running_loop()
            loop.call_later(seconds, lambda: self._house.begin(self._give_back(life, began_ns)))
        return {"ok": True, "fault": request.fault, **particulars, "since": clock.wall(clock.now_ns())}, []

    def _note(self, fact: seen.DrillStarted) -> None:
        self._waited_ns = grace_ns(fact.fault)
        self._house.feed(fact)

    async def _give_back(self, life: Life, began_ns: int) -> None:
        """Have the core let go of what it has leaked, unless another serves by now."""
        if self._house.life() is not life:
            return
        if self._house.reading().drill_ns == began_ns:
            self._house.feed(seen.DrillStarted(0, "", life.number))
        failed = await self._tell_core(life, "leak", {"mb_per_s": 0})
        if failed:
            self._house.note("drill", leak_kept=failed)

    async def _end_spare(self) -> Answer:
        """Kill the core that waits: nobody but the guard may notice."""
        reading = self._house.reading()
        life = self._house.numbered(reading.spare)
        if not reading.spare_ready or life is None or life.handle is None:
            why = reading.spare_fault or "it is being started"
            return refuse("no-spare", f"There is no spare core that waits ({why}).", why=why)
        self._note(seen.DrillStarted(clock.now_ns(), "spare", life.number))
        await self._house.in_hand(life.handle.kill_tree)
        return {"ok": True, "fault": "spare", "since": clock.wall(clock.now_ns())}, []

    def _end_the_gateway(self) -> Answer:
        """Kill the gateway: the core that serves may not notice."""
        unable = self._house.drill_gateway()
        if unable is not None:
            return refuse("not-here", f"The gateway can't be killed now: {unable}.")
        return {"ok": True, "fault": "gateway", "since": clock.wall(clock.now_ns())}, []

    async def _poison(self, life: Life) -> Answer:
        """Arm a request that nobody has sent yet, and say under which key it has to come."""
        key = f"drill:{new_id()}"
        failed = await self._house.court.rules.arm(hashlib.sha256(key.encode()).hexdigest()[:NAME_DIGITS])
        if failed:
            return refuse("core-refused", failed)
        self._note(seen.DrillStarted(clock.now_ns(), "poison", life.number))
        return {"ok": True, "fault": "poison", "key": key, "since": clock.wall(clock.now_ns())}, []

    async def _prepare(self, fault: str, life: Life) -> str | None:
        """Do what a drill needs around the core; return why it can't be done on this machine."""
        if fault == "oom":
            return await self._house.confine(life)
        if fault == "dblock":
            return await self._house.hold_lock(LOCK_HELD_S)
        return None

    async def _tell_core(self, life: Life, fault: str, particulars: Mapping[str, object]) -> str:
        """Have the core break itself; return why it would not, or an empty text."""
        path = self._house.folders.core_control(life.nonce)
        order = {"verb": "drill", "fault": fault, "generation": self._house.generation, **particulars}
        try:
            told = await asyncio.wait_for(ask_core(path, order), CORE_ANSWER_S)
        except (OSError, ValueError, TimeoutError) as error:
            return f"The core's control socket does not answer ({type(error).__name__})."
        if not told or told.get("ok") is True:
            return ""  # without an answer it is gone already: the drill has begun
        return str(told.get("error", "it gave no reason"))


async def ask_core(path: Path, order: Mapping[str, object]) -> Mapping[str, object]:
    """Return what the core answers to an order; nothing if it went without an answer."""
    reader, writer = await asyncio.open_unix_connection(str(path), limit=CORE_LINE_BYTES_MAX)
    try:
        writer.write(write_line(order))
        await writer.drain()
        answer = json.loads(await reader.readline() or b"{}")
        return answer if isinstance(answer, dict) else {}
    except ConnectionError:
        return {}
    finally:
        writer.close()
