"""The stacks of a process with the ids in their frames, read from outside by py-spy.

py-spy reads the memory of the process, so it neither pauses nor runs anything in it (`--nonblocking`; without
it, it fails on a stopped process and hangs on a frozen one). So the same look serves twice: at a process that
is only suspected, for nothing, and at one that was stopped, as evidence. What is shown of a frame's values is
decided in `masking`, before anything else sees them.
"""

import json
import os
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from shutil import which
from typing import Any

from hardcore.model.looks import StackFrame, ThreadStack
from hardcore.snapshot import children
from hardcore.snapshot.form import as_bytes
from hardcore.snapshot.masking import MASK, mask_local, parts, short_path, visible
from hardcore.snapshot.subject import Haul, Tools

STACKS_BYTES_MAX = 4 << 20
#: What a look as values keeps of a process.
THREADS_MAX = 256
FRAMES_MAX = 128

_NOT_INSTALLED = "py-spy is not installed"
_OTHER_FORM = "py-spy: the answer is not in the form known here"
_CHARACTERS_MAX = 240


def find_tools() -> Tools:
    """Look for py-spy beside this interpreter, then on PATH, and for gcore. To be asked once, at the start."""
    beside = Path(sys.executable).parent / "py-spy"
    found = str(beside) if os.access(beside, os.X_OK) else which("py-spy")
    gcore = which("gcore")
    return Tools(Path(found) if found else None, Path(gcore) if gcore else None)


def sample(pid: int, tools: Tools, until_ns: int) -> tuple[tuple[ThreadStack, ...], bytes] | str:
    """Look at all stacks of a living process without stopping it, until `until_ns` (monotonic) at most.

    Returns them as values and as the JSON of the evidence, masked both; or one sentence on why there are none.
    Blocks: for a thread of the caller's.
    """
    told = _told(pid, tools, begin(pid, tools), until_ns)
    return told if isinstance(told, str) else (as_stacks(told), as_bytes(told))


def begin(pid: int, tools: Tools) -> children.Child | str:
    """Start the look at a process; return the program, or one sentence on why there is none."""
    if tools.py_spy is None:
        return _NOT_INSTALLED
    argv = [str(tools.py_spy), "dump", "--pid", str(pid), "--locals", "--locals", "--json", "--nonblocking"]
    child = children.start(argv)
    return f"py-spy: {child}" if isinstance(child, str) else child


def read(child: children.Child, until_ns: int) -> list[dict[str, Any]] | str:
    """Wait for a look that was begun; return its threads with their values masked, or why there are none."""
    answer = children.finish(child, until_ns, STACKS_BYTES_MAX)
    if isinstance(answer, str):
        return f"py-spy: {answer}"
    try:
        return _masked(json.loads(answer))
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return _OTHER_FORM


def _told(pid: int, tools: Tools, child: children.Child | str, until_ns: int) -> list[dict[str, Any]] | str:
    """Return what a look that was begun has seen, or the one after it: a process that runs changes its frames under the
    reader's eyes, and what failed for that succeeds a moment later.
    """
    told = child if isinstance(child, str) else read(child, until_ns)
    if isinstance(told, str) and tools.py_spy is not None and time.monotonic_ns() < until_ns:
        again = begin(pid, tools)
        told = again if isinstance(again, str) else read(again, until_ns)
    return told


def collect_stacks(
    haul: Haul, pid: int, tools: Tools, child: children.Child | str | None, until_ns: int
) -> None:
    """Keep a look that was begun as `stacks.json`, and as `stacks.txt` made from it."""
    told = "it was not begun" if child is None else _told(pid, tools, child, until_ns)
    if isinstance(told, str):
        haul.missing["stacks.json"] = told
        return
    haul.files["stacks.json"] = as_bytes(told)
    haul.files["stacks.txt"] = _readable(told).encode("utf-8", "replace")
    haul.missing.pop("stacks.txt", None)


def as_stacks(threads: Sequence[Mapping[str, Any]]) -> tuple[ThreadStack, ...]:
    """Return masked threads as values: of the locals those that may be shown, each as plain text."""
    return tuple(
        ThreadStack(
            tid=thread["os_thread_id"] or 0,
            name=thread["thread_name"] or "",
            active=thread["active"],
            owns_gil=thread["owns_gil"],
            frames=tuple(_frame(frame) for frame in thread["frames"][:FRAMES_MAX]),
        )
        for thread in threads[:THREADS_MAX]
    )


def _frame(frame: Mapping[str, Any]) -> StackFrame:
    shown = (
        (local["name"], " ".join(parts(local["repr"]))[:_CHARACTERS_MAX]) for local in frame["locals"] or ()
    )
    names = tuple((name, text) for name, text in shown if text and text != MASK)
    return StackFrame(frame["name"], frame["short_filename"] or frame["filename"], frame["line"], names)


def _masked(threads: Any) -> list[dict[str, Any]]:
    for thread in threads:
        _ = thread["os_thread_id"], thread["active"], thread["owns_gil"]
        thread["thread_name"] = visible(thread["thread_name"] or "")
        for frame in thread["frames"]:
            _ = frame["line"]
            frame["name"] = visible(frame["name"])
            frame["filename"] = short_path(visible(frame["filename"]))
            short = visible(frame["short_filename"] or "")
            frame["short_filename"] = frame["filename"] if short[:1] in {"", "/"} else short
            for local in frame["locals"] or ():
                local["name"] = visible(local["name"])
                local["repr"] = mask_local(frame["name"], local["name"], local["repr"] or "")
    return list(threads)


def _readable(threads: Sequence[Mapping[str, Any]]) -> str:
    lines = []
    for thread in threads:
        marks = [
            word for word, on in (("active", thread["active"]), ("holds the GIL", thread["owns_gil"])) if on
        ]
        state = ", ".join(marks) or "idle"
        lines.append(f"Thread {thread['os_thread_id']} {thread['thread_name'] or ''} ({state})")
        for frame in thread["frames"]:
            lines.append(
                f"  {frame['name']} ({frame['short_filename'] or frame['filename']}:{frame['line']})"
            )
            lines += [f"      {local['name']} = {local['repr']}" for local in frame["locals"] or ()]
        lines.append("")
    return "\n".join(lines)
