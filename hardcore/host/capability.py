"""What this machine lets the guard see and do, tried once at the start: tried, because rules can't be read off.

Whether a debugger may look into a process depends on Yama, capabilities, containers and their seccomp profiles. So a
short child is made that allows what a core allows, and is dumped as a core would be. What can't be done is named
for `hardcore doctor`; nothing waits for the answer, and everything works without.
"""

import os
import select
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from hardcore.host import clock, memory

#: A bare interpreter is up in some 20 ms.
READY_S = 5.0
WHY_CHARACTERS_MAX = 200

_YAMA = Path("/proc/sys/kernel/yama/ptrace_scope")
#: As a core does (docs/wires.md): whoever is of its own user may look.
_CHILD = """
import ctypes, sys
ctypes.CDLL(None).prctl(0x59616D61, ctypes.c_ulong(-1), 0, 0, 0)
print("ready", flush=True)
sys.stdin.read()
"""


def examine(py_spy: Path | None, gcore: Path | None, dump: Callable[[int], str]) -> dict[str, object]:
    """Return what can be done here, in the form of `capability.json`.

    `dump` looks at the stacks of a process and returns why it could not, empty if it could. Blocks for seconds at
    most.
    """
    why = "py-spy is not installed" if py_spy is None else _try(dump)
    counter = memory.oom_counter(os.getpid())
    return {
        "py_spy": None if py_spy is None else str(py_spy),
        "can_dump": not why,
        "why": why[:WHY_CHARACTERS_MAX],
        "gcore": None if gcore is None else str(gcore),
        "yama": _yama(),
        "oom_counter": "none" if counter is None else counter.kind,
        "cgroup_own": memory.can_confine(),
        "at": clock.wall(clock.now_ns()),
    }


def _try(dump: Callable[[int], str]) -> str:
    try:
        child = subprocess.Popen(
            [sys.executable, "-I", "-S", "-c", _CHILD],
            stdin=subprocess.PIPE,  # it ends with whoever holds the other end
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={"PATH": os.defpath},
            start_new_session=True,
        )
    except OSError as error:
        return f"no process could be made to try it on: {error.strerror}"
    with child:
        try:
            assert child.stdout is not None, "it has a pipe"
            ready = select.select([child.stdout], [], [], READY_S)[0] and child.stdout.readline()
            return dump(child.pid) if ready else "the process to try it on did not begin"
        finally:
            child.kill()


def _yama() -> int | None:
    try:
        return int(_YAMA.read_text("ascii"))
    except (OSError, ValueError):
        return None
