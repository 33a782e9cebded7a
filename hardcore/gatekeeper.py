"""Keeps a gateway running: starts it, sees it die by its pidfd or stand still, starts it again on the same listener.

A dead gateway is replaced at once; one that dies again and again waits longer each time, but is always
tried: without it nobody sees anything. Its deaths are counted apart from the core's. One that stands still is judged
like a core (`gateway_watch`), its evidence is taken, and it is ended through its pidfd; each loss is an incident of
its own (`side_incident`). The policy's words for GATEWAY_LOST hold: without REBOOT_PROCESS a person is waited for.

A gateway that an earlier guard left holds every browser's connection, so it is kept, if it is what we would start
now (the same code, told the same, on the same listener) and dials us within moments. Any other is seen off: it
answers what it holds first, while ours takes what is new.
"""

import asyncio
import os
import random
import signal
from collections.abc import Coroutine, Sequence
from contextlib import suppress
from typing import Any

from hardcore import gateway_start
from hardcore.access.files import read_doorway
from hardcore.executor import Executor
from hardcore.gateway_watch import GatewayWatch, Remains, end_of_orphan, remains_before
from hardcore.host import clock, logs, processes, refused_paths
from hardcore.host.first_answer import is_answered
from hardcore.host.folders import Folders
from hardcore.host.gateway_page import make_page, set_aside
from hardcore.host.processes import Handle, gone
from hardcore.model.observations import Exit
from hardcore.model.verdicts import Colour, Diagnosis, Grade, Testimony, Verdict
from hardcore.recovery.budget import NS_PER_S, Budget, backoff_ns
from hardcore.recovery.plan import patience
from hardcore.recovery.policy import Policy, Word
from hardcore.sentinel.gateway_end import may_be_of_reading
from hardcore.side_incident import Loss, SideIncident

#: Deaths of the gateway in a minute that are answered without a pause.
QUICK_RESTARTS = 3
LEAVE_GRACE_S = 1.0
#: Making a process takes milliseconds; a disk that does not give its log for this long may never do so.
MAKING_S = 5.0
#: A gateway that lives dials a new guard some ten times in this time.
DIALS_S = 2.0
#: So long one question waits for the first answer of a new gateway, before it is asked anew.
ANSWER_S = 5.0
#: Counting what a gateway died over waits no longer for a disk: the next one is wanted.
COUNTED_S = 0.5
#: Between two questions to a new gateway that was not there for the first.
ASK_AGAIN_S = 0.05
_LOST = Diagnosis.GATEWAY_LOST
_MS = 1_000_000


class Gatekeeper:
    """Owns the gateway's process."""

    def __init__(self, folders: Folders, policy: Policy, listen_fd: int, executor: Executor) -> None:
        self.handle: Handle | None = None
        self._folders = folders
        self.policy = policy
        self._listen_fd = listen_fd
        self._executor = executor
        self._deaths = Budget(QUICK_RESTARTS, 60 * NS_PER_S)
        self._wanted = True
        self._ended = asyncio.Event()
        self._starting = asyncio.Lock()
        self._dialled = asyncio.Event()
        self._dialled_pid = 0
        self._eyes: GatewayWatch | None = None
        self._story = SideIncident(executor, folders)
        self._killed: Verdict | None = None  # why we have ended the one that is about to be gone
        self._looked_at = 0  # the process whose evidence was taken while it stood still
        self._still_ns = 0  # and since when it did
        self._drill: str | None = None
        self._awaits = False  # an operator's word
        self._allowed = False  # it has come: the one that stands still may be ended
        self._known = refused_paths.Deaths()
        self._tasks: set[asyncio.Task[None]] = set()

    async def begin(self, older: Sequence[Handle], *, lost: bool = False) -> None:
        """Go on with a gateway that an earlier guard left, if it is as ours would be; else start one.

        `lost`: the guard before was not told to end, so a gateway that is gone with it was lost as well.
        """
        self._known = await self._executor.in_hand(refused_paths.read, self._folders.refused_paths)
        self._keep(self._watch_on())
        async with self._starting:
            kept = await self._chosen(older)
            if kept is not None:
                self._hold(kept)
        if kept is not None:
            await self._confirm(kept)
            self._executor.filing.gateway_is_back(None)
            return
        since_ns = clock.now_ns()
        if lost and not older:
            since_ns = await self._tell_of_before(since_ns)
        await self.start()
        self._keep(self._tell_held(since_ns))

    async def _tell_held(self, since_ns: int) -> None:
        """Tell the story of the guard before for how long its gateway's place was empty."""
        while self._wanted:
            if await self._is_answered():
                self._executor.filing.gateway_is_back((clock.now_ns() - since_ns) // _MS)
                return
            await asyncio.sleep(ASK_AGAIN_S)

    async def _tell_of_before(self, now_ns: int) -> int:
        """Tell of a gateway that died while nobody watched, with the guard that had watched it; return since when."""
        remains = await self._executor.in_hand(remains_before, self._folders.gateway_page)
        if remains is None or remains.page is None:
            return now_ns
        pulse = remains.page.pulse
        fault_ns: int = min(now_ns, max(pulse.loop_ns, pulse.thread_ns))
        how = await end_of_orphan(self._folders.exits, remains.pid, fault_ns)
        fact = Testimony(
            "page", Colour.RED, "the gateway of the guard before is gone, and nobody watched it end"
        )
        loss = Loss(_LOST, Grade.CERTAIN, (fact,), fault_ns, now_ns)
        self._story.open(loss, alerts=self._alerts(), text=f"The gateway has ended ({_ending(how)}).")
        self._story.died(fault_ns, how)
        refused = await self._reckon(remains, how, None)
        self._executor.begin(self._keep_evidence(remains, how, fault_ns, refused))
        return fault_ns

    async def _chosen(self, older: Sequence[Handle]) -> Handle | None:
        kept: Handle | None = None
        for handle in older:
            if kept is None and await self._executor.in_hand(self._fits, handle) and self._wanted:
                kept = handle
            else:
                self._executor.begin(self.see_off(handle))
        return kept

    def dialled(self, pid: int) -> None:
        """Somebody has joined the feed: process `pid`, as the kernel says."""
        self._dialled_pid = pid
        if self.handle is not None and self.handle.pid == pid:
            self._dialled.set()

    async def _confirm(self, older: Handle) -> None:
        """Keep a gateway for good once it has dialled; one that does not hangs, and is replaced."""
        self.dialled(self._dialled_pid)  # it may have been quicker than we
        if await _within(self._dialled, DIALS_S):
            await self._executor.in_hand(self._name, older)
            self._executor.note("gateway", adopted=older.pid)
        elif self.handle is older and self._wanted:
            asyncio.get_running_loop().remove_reader(older.pidfd)
            self._let_go()
            self._executor.begin(self.see_off(older))
            await self.start()

    def _hold(self, handle: Handle) -> None:
        self.handle = handle
        due_ns = clock.now_ns() + self.policy.startup_timeout_ms * _MS
        self._eyes = GatewayWatch(handle, self._folders.gateway_page, patience(self.policy), due_ns)
        self._ended.clear()
        try:
            asyncio.get_running_loop().add_reader(handle.pidfd, self._on_end, handle)
        except OSError as error:
            logs.end_with(f"a gateway's end can't be watched: {error}")

    async def start(self) -> None:
        """Start the gateway; what can't be started is tried again with growing pauses."""
        async with self._starting:
            if not self._wanted:
                return
            try:
                handle = await self._executor.in_hand(self._spawn)
            except Exception as error:  # noqa: BLE001  # without a gateway nobody sees anything: always again
                self._executor.note("gateway", failed=f"{type(error).__name__}: {error}")
                self._again(None)
                return
            self._hold(handle)
        if self._story.id is not None:
            self._story.step("gateway_spawned", clock.now_ns())
            self._keep(self._await_answer(handle))

    def _spawn(self) -> Handle:
        try:
            make_page(self._folders.gateway_page)
        except OSError as error:  # it serves all the same; of its beats nothing is known then
            self._executor.note("gateway", no_page=error.strerror)
        log = logs.place(self._folders.logs / "gateway.log", self._folders.run)
        fds = (self._listen_fd,)
        argv = gateway_start.argv(self._folders, self._listen_fd)
        environment = gateway_start.environment(self._folders, self.policy)
        handle = processes.spawn(argv, environment, log, self._folders.data, fds=fds)
        self._name(handle)
        return handle

    def _name(self, handle: Handle) -> None:
        self._executor.hint(None, gateway={"pid": handle.pid, "start": handle.identity.start})

    def _fits(self, older: Handle) -> bool:
        """Whether a gateway is what we would start now."""
        return gateway_start.fits(older, self._folders, self.policy, self._listen_fd)

    async def _is_answered(self) -> bool:
        encrypted = read_doorway(self._folders.state).encrypted
        return await is_answered(self._listen_fd, ANSWER_S, encrypted=encrypted)

    def _on_end(self, handle: Handle) -> None:
        how = handle.reap()
        if how is None:
            return
        asyncio.get_running_loop().remove_reader(handle.pidfd)
        remains = self._eyes.remains() if self._eyes is not None else None
        self._let_go()
        handle.close()
        self._ended.set()
        if self._wanted and remains is not None:
            self._executor.begin(self._replace(remains, how, clock.now_ns()))

    def _let_go(self) -> None:
        self.handle = None
        if self._eyes is not None:
            self._eyes.close()
            self._eyes = None

    def _again(self, how: str | None) -> None:
        now_ns = clock.now_ns()
        self._deaths = self._deaths.after_death(now_ns)
        over = len(self._deaths.deaths_ns) - QUICK_RESTARTS
        policy = self.policy
        pause_ns = (
            backoff_ns(over, policy.backoff_initial_ms, policy.backoff_max_ms, random.random())
            if over > 0
            else 0
        )
        if how is not None and not self._restarts():
            self._await_operator("The gateway is gone and is not started again before somebody says so.")
            return
        self._executor.note("gateway", ended=how, pause_ms=pause_ns // _MS)
        asyncio.get_running_loop().call_later(pause_ns / NS_PER_S, self._restart)

    def _restart(self) -> None:
        if self._wanted:
            self._executor.begin(self.start())

    # -- one that is lost ------------------------------------------------------------------------------

    async def _watch_on(self) -> None:
        """Look at the gateway once in an interval."""
        while True:
            await asyncio.sleep(self.policy.health_check_interval_ms / 1000)
            eyes = self._eyes
            if eyes is None:
                continue
            verdict = eyes.look()
            if verdict.colour is Colour.RED:
                await self._stands_still(eyes, verdict)
            elif self._looked_at == eyes.handle.pid and eyes.has_beaten_since(self._still_ns):
                self._beats_again(eyes)

    async def _stands_still(self, eyes: GatewayWatch, verdict: Verdict) -> None:
        """End a gateway that is lost while it lives, once its evidence is taken, if it stands still even then."""
        loss = Loss(_LOST, verdict.grade, verdict.testimonies, verdict.fault_ns, clock.now_ns(), self._drill)
        self._story.open(loss, alerts=self._alerts(), text=f"The gateway stands still ({verdict.diagnosis}).")
        if self._looked_at != eyes.handle.pid:
            self._looked_at, self._still_ns = eyes.handle.pid, verdict.fault_ns
            await self._look_closely(eyes, verdict)
        if not (self._restarts() or self._allowed):
            self._await_operator("The gateway stands still and is not ended before somebody says so.")
            return
        await self._executor.in_hand(self._executor.steps.mark, None)
        # Asked on the loop, which is where it is let go of: a number that was given back must not be signalled.
        if eyes is not self._eyes or eyes.has_beaten_since(verdict.fault_ns):
            return
        self._killed, self._allowed = verdict, False
        self._story.step("killed", clock.now_ns())
        eyes.handle.signal(signal.SIGKILL)

    async def _look_closely(self, eyes: GatewayWatch, verdict: Verdict) -> None:
        if not self.policy.asks(_LOST, Word.SNAPSHOT):
            return
        found = eyes.remains().files(clock.now_ns(), str(verdict.diagnosis), None)
        pidfd = os.dup(eyes.handle.pidfd)  # it may end by itself meanwhile
        try:
            budget_ms = self.policy.snapshot_budget_ms
            await self._story.take(eyes.handle.pid, pidfd, budget_ms, living=True, found=found)
        finally:
            os.close(pidfd)

    def _beats_again(self, eyes: GatewayWatch) -> None:
        """It stood still and goes on: nobody ended it."""
        assert eyes.pulse is not None, "whoever has beaten has a page"
        self._looked_at, self._awaits, self._allowed = 0, False, False
        if self._killed is None and self._story.id is not None:
            self._story.step("serving", eyes.pulse.loop_ns)
            self._story.close(self._outcome(), clock.now_ns(), "The gateway goes on by itself.")

    async def _replace(self, remains: Remains, how: Exit, at_ns: int) -> None:
        """Tell of a death, count what it was over, start the next one."""
        verdict, self._killed = self._killed, None
        drill, self._drill = self._drill, None
        if verdict is None:
            fact = Testimony("pidfd", Colour.RED, f"the gateway's process ended: {_ending(how)}")
            loss = Loss(_LOST, Grade.CERTAIN, (fact,), at_ns, at_ns, drill)
            self._story.open(loss, alerts=self._alerts(), text=f"The gateway has ended ({_ending(how)}).")
        if how == Exit() and remains.parsing:
            how = await end_of_orphan(self._folders.exits, remains.pid, at_ns)
        self._story.died(at_ns, how)
        refused = await self._reckon(remains, how, verdict, drill=drill is not None)
        self._again(_ending(how))
        if verdict is None:
            await self._keep_evidence(remains, how, at_ns, refused)

    async def _keep_evidence(self, remains: Remains, how: Exit, at_ns: int, refused: tuple[str, ...]) -> None:
        if not self.policy.asks(_LOST, Word.SNAPSHOT):
            return
        how = await end_of_orphan(self._folders.exits, remains.pid, at_ns) if how == Exit() else how
        found = remains.files(at_ns, "died", how, refused)
        await self._story.take(remains.pid, -1, self.policy.snapshot_budget_ms, living=False, found=found)

    async def _reckon(
        self, remains: Remains, how: Exit, verdict: Verdict | None, *, drill: bool = False
    ) -> tuple[str, ...]:
        """Count a death over what was being read, if that can have caused it; return what is refused for it from now on."""
        with suppress(OSError):  # then a guard that begins meanwhile tells of it once more
            await self._executor.in_hand(set_aside, self._folders.gateway_page)
        guilty = may_be_of_reading(
            how,
            verdict.diagnosis if verdict is not None else None,
            drill=drill,
            oom_kills=remains.oom_kills,
            grown_bytes=remains.grown_bytes,
        )
        return await self._count(remains.parsing) if guilty and remains.parsing else ()

    async def _count(self, parsing: frozenset[str]) -> tuple[str, ...]:
        """Count a death over these paths; return those of them that are refused from now on."""
        now_s = clock.together()[1].wall_ns / 1e9
        self._known = self._known.after(parsing, now_s)
        refused = tuple(path for path in self._known.in_force(now_s) if path in parsing)
        work = self._executor.in_hand(refused_paths.write, self._folders.refused_paths, self._known)
        try:
            await asyncio.wait_for(work, COUNTED_S)
        except (OSError, TimeoutError) as error:
            self._executor.note("gateway", uncounted=f"{type(error).__name__}: {error}")
        if refused:
            self._executor.note("gateway", refuses=list(refused))
        return refused

    async def _await_answer(self, handle: Handle) -> None:
        """Close the incident with the first answer of the new gateway."""
        while self.handle is handle and self._story.id is not None:
            if await self._is_answered() and self.handle is handle:
                self._story.step("serving", clock.now_ns())
                self._story.close(self._outcome(), clock.now_ns(), "The gateway serves again.")
            else:
                await asyncio.sleep(ASK_AGAIN_S)

    def _await_operator(self, text: str) -> None:
        if not self._awaits:
            self._awaits = True
            self._executor.note("gateway", waits=text)
            self._story.waits(text)

    def _restarts(self) -> bool:
        return self.policy.mode == "act" and self.policy.asks(_LOST, Word.REBOOT_PROCESS)

    def _alerts(self) -> bool:
        return self.policy.mode != "observe" and self.policy.asks(_LOST, Word.SEND_ALERT)

    def _outcome(self) -> str:
        return "recovered" if self.policy.mode == "act" else "assist"

    def resume(self) -> None:
        """An operator's word: start the one that is gone, end the one that stands still."""
        if not self._awaits or not self._wanted:
            return
        self._awaits = False
        if self.handle is None:
            self._executor.begin(self.start())
        else:
            self._allowed = True

    def drill(self) -> str | None:
        """Kill the gateway, as a drill; return why that can't be done now, None when it is."""
        if self.handle is None or self._story.id is not None:
            return "there is no gateway that runs"
        self._drill = "gateway"
        self.handle.signal(signal.SIGKILL)
        return None

    def told(self) -> dict[str, object]:
        """Return what a status says of the gateway."""
        pulse = self._eyes.pulse if self._eyes is not None else None
        age_ms = (clock.now_ns() - pulse.loop_ns) // _MS if pulse is not None else None
        return {
            "pid": self.handle.pid if self.handle is not None else None,
            "heartbeat_age_ms": age_ms,
            "overdue": pulse.overdue if pulse is not None else 0,
            "refused_paths": list(self._known.in_force(clock.together()[1].wall_ns / 1e9)),
            "refused_requests": pulse.refused if pulse is not None else 0,
            "incident": self._story.id,
            "last_incident": self._story.last,
            "awaits_operator": self._awaits,
        }

    def _keep(self, work: Coroutine[Any, Any, None]) -> None:
        """Start what goes on until we stop; if it ends by a fault, nobody would look any more, so we end."""
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._done)

    def _done(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        if not task.cancelled() and (error := task.exception()) is not None:
            logs.end_with(f"the gateway can't be watched any more: {type(error).__name__}: {error}")

    # -- the end ---------------------------------------------------------------------------------------

    async def see_off(self, older: Handle) -> None:
        """Let a gateway that an earlier guard left behind answer what it holds and leave; end it if it does not."""
        self._executor.note("leftover", gateway=older.pid)
        older.signal(signal.SIGTERM)
        older.signal(signal.SIGCONT)
        try:
            if not await gone(older, self.policy.gateway.drain_ms / 1000 + LEAVE_GRACE_S):
                await self._executor.in_hand(older.kill_tree)
        finally:
            older.close()

    async def stop(self) -> None:
        """Let the gateway answer what it holds and leave; end it if it does not."""
        self._wanted = False
        for task in tuple(self._tasks):
            task.cancel()
        # One that is just being made would be left behind by nobody's hand; but its making may hang.
        with suppress(TimeoutError):
            await asyncio.wait_for(self._starting.acquire(), MAKING_S)
            self._starting.release()  # whoever comes to it now finds that none is wanted
        handle = self.handle
        if handle is None:
            return
        handle.signal(signal.SIGTERM)
        handle.signal(signal.SIGCONT)
        limit_s = self.policy.gateway.drain_ms / 1000 + LEAVE_GRACE_S
        if not await _within(self._ended, limit_s):
            handle.kill_tree()
            await _within(self._ended, LEAVE_GRACE_S)


def _ending(how: Exit) -> str:
    if how.signal is not None:
        return f"signal {how.signal}"
    return f"code {how.code}" if how.code is not None else "nobody could read how"


async def _within(event: asyncio.Event, limit_s: float) -> bool:
    try:
        await asyncio.wait_for(event.wait(), limit_s)
    except TimeoutError:
        return False
    return True
