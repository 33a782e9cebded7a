"""Programs that are run beside the evidence (a debugger, a dumper): started, read, and ended in time.

Two halves, so that other evidence is taken while a program works: `start`, and later `finish` until a moment.
A plain child of the calling thread: an asyncio child would need the loop's child watcher and wake the
deciding loop a dozen times, for an answer that nobody else waits for.
"""

import os
import select
import signal
import subprocess
import time
from collections.abc import Callable, Sequence
from contextlib import suppress

ERROR_TEXT_MAX = 200
KILL_WAIT_S = 0.5
#: How often what a program makes is looked at while it works.
LOOK_EVERY_MS = 50
#: What such a program makes belongs to its owner alone.
_UMASK = 0o077

Child = subprocess.Popen[bytes]


def start(argv: Sequence[str]) -> Child | str:
    """Start a program in a session of its own; return it, or one sentence on why there is none."""
    try:
        return subprocess.Popen(
            argv,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env={"PATH": os.defpath, "LC_ALL": "C.UTF-8"},
            umask=_UMASK,
            start_new_session=True,  # a fork of it must not outlive it, and no terminal may stop it
        )
    except OSError as error:
        return f"could not be started: {error.strerror}"


def _nothing_wrong() -> str | None:
    return None


def finish(
    child: Child, until_ns: int, bytes_max: int, look: Callable[[], str | None] = _nothing_wrong
) -> bytes | str:
    """Read a program to its end, until `until_ns` at most; return its output, or why there is none.

    `look` is asked meanwhile and says why it must be ended, or None. The program and its whole group are gone when this returns.
    """
    try:
        output = _read_both(child, until_ns, bytes_max, look)
    finally:
        end(child)
    if isinstance(output, str):
        return output
    out, err = output
    if child.returncode == 0:
        return out
    lines = err.decode("utf-8", "replace").strip().splitlines() or ["no word about it"]
    return f"ended with {child.returncode}: {lines[0][:ERROR_TEXT_MAX]}"


def kill(child: Child) -> None:
    """Send the program and its group the end, without waiting for it."""
    with suppress(ProcessLookupError):
        if child.returncode is None:
            os.killpg(child.pid, signal.SIGKILL)


def end(child: Child) -> None:
    """End the program and its group, and let go of it. May be called twice."""
    assert child.stdout is not None
    assert child.stderr is not None
    kill(child)
    child.stdout.close()
    child.stderr.close()
    # A child that even SIGKILL does not end at once hangs in the kernel; it is left to the reaper.
    with suppress(subprocess.TimeoutExpired):
        child.wait(KILL_WAIT_S)


def _read_both(
    child: Child, until_ns: int, bytes_max: int, look: Callable[[], str | None]
) -> tuple[bytes, bytes] | str:
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
        if (why := look()) is not None:
            return why
        for handle, _ in poller.poll(min(wait_ms, LOOK_EVERY_MS)):
            part = os.read(handle, 1 << 16)
            texts[handle] += part
            if not part:
                poller.unregister(handle)
                left -= 1
        if len(out) + len(err) > bytes_max:
            return f"it said more than {bytes_max} bytes"
    try:
        child.wait(max(0.0, (until_ns - time.monotonic_ns()) / 1e9))
    except subprocess.TimeoutExpired:
        return "it took too long"
    return bytes(out), bytes(err)
