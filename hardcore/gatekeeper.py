"""Keeps a gateway running: starts it, sees it die by its pidfd, starts it again on the same listener.

A dead gateway is replaced at once; one that dies again and again waits longer each time, but is always
tried: without it nobody sees anything. Its deaths are counted apart from the core's.

A gateway that an earlier guard left holds every browser's connection, so it is kept, if it is what we would start
now (the same code, told the same, on the same listener) and dials us within moments. Any other is seen off: it
answers what it holds first, while ours takes what is new.
"""

import asyncio
import dataclasses
import json
import os
import random
import signal
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from hardcore.executor import Executor
from hardcore.host import build, clock, leftovers, lives, logs, processes
from hardcore.host.folders import Folders
from hardcore.host.processes import Handle, gone
from hardcore.recovery.budget import NS_PER_S, Budget, backoff_ns
from hardcore.recovery.policy import Policy

#: Deaths of the gateway in a minute that are answered without a pause.
QUICK_RESTARTS = 3
LEAVE_GRACE_S = 1.0
#: Making a process takes milliseconds; a disk that does not give its log for this long may never do so.
MAKING_S = 5.0
#: A gateway that lives dials a new guard some ten times in this time.
DIALS_S = 2.0
_LISTENER = "--listen-fd"


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

    async def begin(self, older: Sequence[Handle]) -> None:
        """Go on with a gateway that an earlier guard left, if it is as ours would be; else start one."""
        async with self._starting:
            kept = await self._chosen(older)
            if kept is not None:
                self._watch(kept)
        if kept is None:
            await self.start()
        else:
            await self._confirm(kept)

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
            self.handle = None
            self._executor.begin(self.see_off(older))
            await self.start()

    def _watch(self, handle: Handle) -> None:
        self.handle = handle
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
            self._watch(handle)

    def _spawn(self) -> Handle:
        log = logs.place(self._folders.logs / "gateway.log", self._folders.run)
        fds = (self._listen_fd,)
        handle = processes.spawn(self._argv(), self._environment(), log, self._folders.data, fds=fds)
        self._name(handle)
        return handle

    def _name(self, handle: Handle) -> None:
        self._executor.hint(None, gateway={"pid": handle.pid, "start": handle.identity.start})

    def _environment(self) -> dict[str, str]:
        return {
            **leftovers.environment_of_gateway(self._folders),
            "HARDCORE_LIMITS": json.dumps(dataclasses.asdict(self.policy.gateway)),
            "HARDCORE_BUILD": build.guard_build_id(),
        }

    def _argv(self) -> list[str]:
        argv = [sys.executable, "-I", "-m", "hardcore.crisis"]
        argv += [_LISTENER, str(self._listen_fd), "--control", str(self._folders.control)]
        if os.environ.get(lives.DEMO_SWITCH) == "1":
            argv.append("--demo")
        argv += ["--recoveries", str(self._folders.state / "recoveries.json")]
        argv += ["--receipts", str(self._folders.data / "receipts.db")]
        argv += ["--state", str(self._folders.state), "--investigator", str(self._folders.investigator)]
        argv += ["--agents", str(self._folders.agents)]
        return argv

    def _fits(self, older: Handle) -> bool:
        """Whether a gateway is what we would start now, but for the number that its listener has there."""
        told = dict(line.partition("=")[::2] for line in leftovers.read_environment(older.pid))
        ours = self._environment()
        if any(told.get(name) != ours[name] for name in ("HARDCORE_LIMITS", "HARDCORE_BUILD")):
            return False
        return _told_alike(self._argv(), _command_line(older.pid)) and self._shares_listener(older)

    def _shares_listener(self, older: Handle) -> bool:
        """Whether what browsers dial is the same socket for both; a new launcher may hold another."""
        argv = _command_line(older.pid)
        number = argv[argv.index(_LISTENER) + 1]
        try:
            theirs = Path(f"/proc/{older.pid}/fd/{number}").stat()
            return os.path.samestat(theirs, os.fstat(self._listen_fd))
        except OSError:
            return False

    def _on_end(self, handle: Handle) -> None:
        how = handle.reap()
        if how is None:
            return
        asyncio.get_running_loop().remove_reader(handle.pidfd)
        handle.close()
        self.handle = None
        self._ended.set()
        if self._wanted:
            self._again(f"code {how.code}" if how.signal is None else f"signal {how.signal}")

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
        self._executor.note("gateway", ended=how, pause_ms=pause_ns // 1_000_000)
        asyncio.get_running_loop().call_later(pause_ns / NS_PER_S, self._restart)

    def _restart(self) -> None:
        if self._wanted:
            self._executor.begin(self.start())

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


async def _within(event: asyncio.Event, limit_s: float) -> bool:
    try:
        await asyncio.wait_for(event.wait(), limit_s)
    except TimeoutError:
        return False
    return True


def _command_line(pid: int) -> list[str]:
    try:
        return os.fsdecode(Path(f"/proc/{pid}/cmdline").read_bytes()).split("\0")[:-1]
    except OSError:
        return []


def _told_alike(ours: list[str], theirs: list[str]) -> bool:
    """Whether two command lines differ in the number of the listener alone."""
    if _LISTENER not in theirs or len(ours) != len(theirs):
        return False
    number = ours.index(_LISTENER) + 1
    return [*ours[:number], *ours[number + 1 :]] == [*theirs[:number], *theirs[number + 1 :]]
