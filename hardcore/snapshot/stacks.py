"""The stacks of a process: read from outside by py-spy, with the process's own traceback to fall back on.

py-spy reads the memory of a process that is already stopped, so it neither pauses nor runs anything in it
(`--nonblocking`; without it, it fails on a stopped process and hangs on a frozen one). The traceback comes
from a C handler inside the core that works while the interpreter is stuck, but not while the process is
stopped, so it is asked for before anybody knows whether it is needed. It is asked for only when the kernel
says that the handler stands: otherwise the signal would be the end of the process.
"""

import json
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from shutil import which
from typing import Any

from hardcore.snapshot.masking import mask_local
from hardcore.snapshot.subject import Haul, Subject, Tools
from hardcore.snapshot.threads import stands_still

STACKS_BYTES_MAX = 4 << 20
TRACEBACK_BYTES_MAX = 256 << 10
ERROR_TEXT_MAX = 200
KILL_WAIT_S = 0.5
_POLL_S = 0.001
#: A traceback that has not grown for so long is taken for finished: its writer says no end.
_SETTLED_NS = 4_000_000


def find_tools() -> Tools:
    """Look for py-spy beside this interpreter, then on PATH. To be asked once, at the start."""
    beside = Path(sys.executable).parent / "py-spy"
    found = str(beside) if os.access(beside, os.X_OK) else which("py-spy")
    return Tools(Path(found) if found else None)


def traceback_path(subject: Subject) -> Path:
    """Return the file into which the core's own handlers print its stacks."""
    return subject.recorder.with_name(subject.recorder.name + ".stacks")


def ask_for_traceback(subject: Subject, haul: Haul, until_ns: int) -> None:
    """Have the living process print its stacks, and keep them as `stacks.txt` until better ones come."""
    path = traceback_path(subject)
    if stands_still(subject.pid):
        haul.missing["stacks.txt"] = "the process stood still, so it could not print its own stacks"
        return
    if not _has_handler(subject.pid):
        haul.missing["stacks.txt"] = "the process had not set up the printing of its stacks"
        return
    before_bytes = _size_bytes(path)
    try:
        signal.pidfd_send_signal(subject.pidfd, signal.SIGUSR1)
    except OSError as error:
        haul.missing["stacks.txt"] = f"the process could not be asked for its stacks: {error.strerror}"
        return
    _await_growth(path, before_bytes, until_ns)
    text = _printed(path, before_bytes)
    if isinstance(text, bytes) and text:
        haul.files["stacks.txt"] = text
    else:
        haul.missing["stacks.txt"] = (
            f"the process printed no stacks: {text if isinstance(text, str) else 'nothing came'}"
        )


def keep_last_traceback(subject: Subject, haul: Haul) -> None:
    """Keep what a dead core printed of its stacks. One that was killed had no time to: nothing is missing."""
    text = _printed(traceback_path(subject), 0)
    if isinstance(text, bytes) and text:
        haul.files["stacks.txt"] = text


def _printed(path: Path, after_bytes: int) -> bytes | str:
    """Return what stands in the file from `after_bytes` on, or why it can't be read."""
    try:
        with path.open("rb") as file:
            file.seek(after_bytes)
            return file.read(TRACEBACK_BYTES_MAX)
    except OSError as error:
        return error.strerror or "unreadable"


def collect_stacks(subject: Subject, haul: Haul, tools: Tools, until_ns: int) -> None:
    """Read the stacks with their locals from outside: `stacks.json`, and `stacks.txt` made from it."""
    if tools.py_spy is None:
        haul.missing["stacks.json"] = "py-spy is not installed"
        return
    argv = [str(tools.py_spy), "dump", "--pid", str(subject.pid)]
    answer = run_bounded([*argv, "--locals", "--locals", "--json", "--nonblocking"], until_ns)
    if isinstance(answer, str):
        haul.missing["stacks.json"] = f"py-spy: {answer}"
        return
    try:
        stacks = _masked(json.loads(answer))
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        haul.missing["stacks.json"] = "py-spy: the answer is not in the form known here"
        return
    haul.files["stacks.json"] = json.dumps(stacks, ensure_ascii=False, indent=1).encode("utf-8", "replace")
    haul.files["stacks.txt"] = _readable(stacks).encode("utf-8", "replace")
    haul.missing.pop("stacks.txt", None)


def run_bounded(argv: Sequence[str], until_ns: int) -> bytes | str:
    """Run a program until `until_ns` at most; return its output, or one sentence on why there is none.

    The program and its whole group are gone when this returns.
    """
    try:
        child = subprocess.Popen(
            argv,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env={"PATH": os.defpath, "LC_ALL": "C.UTF-8"},
            start_new_session=True,  # a fork of it must not outlive it, and no terminal may stop it
        )
    except OSError as error:
        return f"could not be started: {error.strerror}"
    try:
        output = _read_both(child, until_ns)
    finally:
        _end(child)
    if isinstance(output, str):
        return output
    out, err = output
    if child.returncode == 0:
        return out
    lines = err.decode("utf-8", "replace").strip().splitlines() or ["no word about it"]
    return f"ended with {child.returncode}: {lines[0][:ERROR_TEXT_MAX]}"


def _end(child: "subprocess.Popen[bytes]") -> None:
    assert child.stdout is not None
    assert child.stderr is not None
    with suppress(ProcessLookupError):
        if child.returncode is None:
            os.killpg(child.pid, signal.SIGKILL)
    child.stdout.close()
    child.stderr.close()
    # A child that even SIGKILL does not end at once hangs in the kernel; it is left to the reaper.
    with suppress(subprocess.TimeoutExpired):
        child.wait(KILL_WAIT_S)


def _read_both(child: "subprocess.Popen[bytes]", until_ns: int) -> tuple[bytes, bytes] | str:
    """Read both pipes to their ends and take the exit status."""
    assert child.stdout is not None
    assert child.stderr is not None
    texts = {child.stdout.fileno(): bytearray(), child.stderr.fileno(): bytearray()}
    out, err = texts.values()
    poller = select.poll()
    for handle in texts:
        poller.register(handle, select.POLLIN)
    left = len(texts)
    while left:
        wait_ms = (until_ns - time.monotonic_ns()) // 1_000_000
        if wait_ms <= 0:
            return "it took too long"
        for handle, _ in poller.poll(wait_ms):
            part = os.read(handle, 1 << 16)
            texts[handle] += part
            if not part:
                poller.unregister(handle)
                left -= 1
        if len(out) + len(err) > STACKS_BYTES_MAX:
            return f"it said more than {STACKS_BYTES_MAX} bytes"
    try:
        child.wait(max(0.0, (until_ns - time.monotonic_ns()) / 1e9))
    except subprocess.TimeoutExpired:
        return "it took too long"
    return bytes(out), bytes(err)


def _masked(threads: Any) -> list[dict[str, Any]]:
    for thread in threads:
        for frame in thread["frames"]:
            for local in frame["locals"] or ():
                local["repr"] = mask_local(frame["name"], local["name"], local["repr"] or "")
    return list(threads)


def _readable(threads: Sequence[dict[str, Any]]) -> str:
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


def _has_handler(pid: int) -> bool:
    """Tell whether the process catches SIGUSR1."""
    try:
        status = Path(f"/proc/{pid}/status").read_text("ascii", "replace")
    except OSError:
        return False
    caught = next((line for line in status.splitlines() if line.startswith("SigCgt:")), "SigCgt: 0")
    return bool(int(caught.split()[1], 16) >> (signal.SIGUSR1 - 1) & 1)


def _await_growth(path: Path, before_bytes: int, until_ns: int) -> None:
    last_bytes, since_ns = before_bytes, time.monotonic_ns()
    while (now_ns := time.monotonic_ns()) < until_ns:
        size_bytes = _size_bytes(path)
        if size_bytes != last_bytes:
            last_bytes, since_ns = size_bytes, now_ns
        elif size_bytes > before_bytes and now_ns - since_ns > _SETTLED_NS:
            return
        time.sleep(_POLL_S)


def _size_bytes(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return 0
