"""What a test has started and not ended: its processes, found even when they hide.

A guard, its launcher and its cores are made to survive the death of their parents, in sessions of their own and
with a clean environment, so the children of the test's process are not all there is. Whatever else was started
works in the test's own folder and says so in its arguments, its environment or its working folder.
"""

import os
from contextlib import suppress
from pathlib import Path
from typing import Final

import psutil

_GONE: Final = (psutil.NoSuchProcess, psutil.AccessDenied, OSError)


def children() -> set[psutil.Process]:
    """Every living process below this one. Asked before and after each test, so the kernel's own lists are read."""
    found: set[psutil.Process] = set()
    asked = [os.getpid()]
    while asked:
        with suppress(*_GONE):
            for task in Path(f"/proc/{asked.pop()}/task").glob("*/children"):
                with suppress(*_GONE):
                    asked += [int(pid) for pid in task.read_text().split()]
        for pid in asked:
            with suppress(*_GONE):
                found.add(psutil.Process(pid))
    return {child for child in found if _lives(child)}


def at_work_in(folder: Path) -> set[psutil.Process]:
    """Every living process but this one that names the folder, wherever it descends from."""
    found: set[psutil.Process] = set()
    for process in psutil.process_iter():
        if process.pid != os.getpid() and _names(process, str(folder)) and _lives(process):
            found.add(process)
    return found


def end(processes: set[psutil.Process]) -> list[str]:
    """Kill them all; what each of them was, for the reader."""
    told: list[str] = []
    for process in sorted(processes, key=lambda process: process.pid):
        with suppress(*_GONE):
            told.append(f"{process.pid}: {' '.join(process.cmdline())}")
            process.kill()
    psutil.wait_procs(processes, timeout=5)
    return told


def _lives(process: psutil.Process) -> bool:
    try:
        return process.status() not in {psutil.STATUS_ZOMBIE, psutil.STATUS_DEAD}
    except _GONE:
        return False


def _names(process: psutil.Process, folder: str) -> bool:
    """Whether a process has the folder in its arguments, its working folder or its environment."""
    about = Path("/proc") / str(process.pid)
    try:
        here = str((about / "cwd").readlink())
        words = (about / "cmdline").read_bytes() + b"\0" + (about / "environ").read_bytes()
    except _GONE:
        return False
    return (here + "/").startswith(folder + "/") or os.fsencode(folder) in words
