"""Keeps a gateway running: starts it, sees it die by its pidfd, starts it again on the same listener.

A dead gateway is replaced at once; one that dies again and again waits longer each time, but is always
tried: without it nobody sees anything. Its deaths are counted apart from the core's.
"""

import asyncio
import dataclasses
import json
import os
import random
import signal
import sys
from contextlib import suppress

from hardcore.executor import Executor, gone
from hardcore.host import clock, leftovers, lives, logs, processes
from hardcore.host.folders import Folders
from hardcore.host.processes import Handle
from hardcore.recovery.budget import NS_PER_S, Budget, backoff_ns
from hardcore.recovery.policy import Policy

#: Deaths of the gateway in a minute that are answered without a pause.
QUICK_RESTARTS = 3
LEAVE_GRACE_S = 1.0
#: Making a process takes milliseconds; a disk that does not give its log for this long may never do so.
MAKING_S = 5.0


class Gatekeeper:
    """Owns the gateway's process."""

    def __init__(self, folders: Folders, policy: Policy, listen_fd: int, executor: Executor) -> None:
        self.handle: Handle | None = None
        self._folders = folders
        self._policy = policy
        self._listen_fd = listen_fd
        self._executor = executor
        self._deaths = Budget(QUICK_RESTARTS, 60 * NS_PER_S)
        self._wanted = True
        self._ended = asyncio.Event()
        self._starting = asyncio.Lock()

    async def start(self) -> None:
        """Start the gateway; what can't be started is tried again with growing pauses."""
        async with self._starting:
            if not self._wanted:
                return
            try:
                self.handle = await self._executor.in_hand(self._spawn)
            except Exception as error:  # noqa: BLE001  # without a gateway nobody sees anything: always again
                self._executor.note("gateway", failed=f"{type(error).__name__}: {error}")
                self._again(None)
                return
            self._ended.clear()
            try:
                asyncio.get_running_loop().add_reader(self.handle.pidfd, self._on_end, self.handle)
            except OSError as error:
                logs.end_with(f"a new gateway's end can't be watched: {error}")

    def _spawn(self) -> Handle:
        environment = leftovers.environment_of_gateway(self._folders)
        environment["HARDCORE_LIMITS"] = json.dumps(dataclasses.asdict(self._policy.gateway))
        argv = [sys.executable, "-I", "-m", "hardcore.crisis"]
        argv += ["--listen-fd", str(self._listen_fd), "--control", str(self._folders.control)]
        if os.environ.get(lives.DEMO_SWITCH) == "1":
            argv.append("--demo")
        argv += ["--recoveries", str(self._folders.state / "recoveries.json")]
        log = logs.place(self._folders.logs / "gateway.log", self._folders.run)
        handle = processes.spawn(argv, environment, log, self._folders.data, fds=(self._listen_fd,))
        identity = {"pid": handle.pid, "start": handle.identity.start}
        self._executor.hint(None, gateway=identity)
        return handle

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
        policy = self._policy
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
            if not await gone(older, self._policy.gateway.drain_ms / 1000 + LEAVE_GRACE_S):
                await self._executor.in_hand(older.kill_tree)
        finally:
            older.close()

    async def stop(self) -> None:
        """Let the gateway answer what it holds and leave; end it if it does not."""
        self._wanted = False
        # One that is just being made would be left behind by nobody's hand; but its making may hang.
        with suppress(TimeoutError):
            await asyncio.wait_for(self._starting.acquire(), MAKING_S)
        handle = self.handle
        if handle is None:
            return
        handle.signal(signal.SIGTERM)
        handle.signal(signal.SIGCONT)
        limit_s = self._policy.gateway.drain_ms / 1000 + LEAVE_GRACE_S
        if not await _within(self._ended, limit_s):
            handle.kill_tree()
            await _within(self._ended, LEAVE_GRACE_S)


async def _within(event: asyncio.Event, limit_s: float) -> bool:
    try:
        await asyncio.wait_for(event.wait(), limit_s)
    except TimeoutError:
        return False
    return True
