"""What some drills need around the core, before it is told to break: a lock that another process holds.

The fault is made by a process of its own, as it would be in life: a backup program that has the ledger open in a
transaction. It ends by itself; here it is started, waited for until the kernel's table says that it has the lock,
and seen off.
"""

import asyncio
import sys

from hardcore.executor import Executor
from hardcore.host import lives, locks, logs, processes
from hardcore.host.folders import Folders
from hardcore.host.processes import gone

BEGIN_S = 5.0
LOOK_EVERY_S = 0.05
#: How much longer than asked it may take to end.
GRACE_S = 5.0


async def hold_lock(executor: Executor, folders: Folders, seconds: int) -> str | None:
    """Have another process hold the ledger's write lock for so long; return why it could not, None once it does."""
    if folders.store.exists():
        return "the ledger lies in a database server, and this drill holds the lock of a file"
    argv = [sys.executable, "-I", "-m", "core", "hold-lock", "--data", str(folders.data)]
    try:
        handle = await executor.in_hand(
            processes.spawn,
            [*argv, "--seconds", str(seconds)],
            lives.clean_environment(),
            logs.place(folders.logs / "drill.log", folders.run),
            folders.data,
        )
    except OSError as error:
        return f"no process could be made to hold the lock: {error.strerror}"
    loop = asyncio.get_running_loop()
    give_up_at = loop.time() + BEGIN_S
    while not await executor.in_hand(_holds, folders, handle.pid):
        if loop.time() > give_up_at or await gone(handle, LOOK_EVERY_S):
            executor.begin(_see_off(handle, 0.0))
            return "the ledger's lock could not be taken; somebody else may hold it (logs/drill.log)"
    executor.begin(_see_off(handle, seconds + GRACE_S))
    return None


def _holds(folders: Folders, pid: int) -> bool:
    table = locks.read_table()
    if isinstance(table, str):
        return True  # this machine does not say who holds it; the drill goes on all the same
    return any(holder.pid == pid for holder in locks.writers_in(folders.data, 0, table))


async def _see_off(handle: processes.Handle, within_s: float) -> None:
    """Wait for its end, and make one if it does not come by itself."""
    try:
        if not await gone(handle, within_s):
            handle.kill_tree()
            await gone(handle, lives.KILL_S)
    finally:
        handle.reap()
        handle.close()
