"""The stacks that the core prints itself: what is left where nobody may look into it from outside.

They come from a C handler inside the core that works while the interpreter is stuck, but not while the
process is stopped, so they are asked for before anybody knows whether they are needed, and picked up later:
other evidence is taken while they are being printed. They are asked for only when the kernel says that the
handler stands: otherwise the signal would be the end of the process.
"""

import re
import signal
import time
from pathlib import Path

from hardcore.snapshot.masking import mask_line, short_path, visible
from hardcore.snapshot.subject import Haul, Subject
from hardcore.snapshot.threads import stands_still

TRACEBACK_BYTES_MAX = 256 << 10
_POLL_S = 0.0005
#: A traceback that has not grown for so long is taken for finished: its writer says no end.
_SETTLED_NS = 3_000_000
_FRAME = re.compile(r'\s*File "(?P<path>[^"]*)", line (?P<line>\d+|\?\?\?) in (?P<function>.*)')
#: A frame in C, as the handler prints it from Python 3.14 on.
_NATIVE = re.compile(
    r'\s*Binary file "(?P<path>[^"]*)", at (?P<function>[A-Za-z_]\w{0,120})?\+0x(?P<at>[0-9a-f]{1,16}).*'
)
#: The handler's own sentences; any other line is somebody's text.
_OWN_LINE = re.compile(
    r"Current thread's C stack trace \(most recent call first\):|(?:Current thread|Thread) 0x[0-9a-f]+(?: \[[^\]]{0,64}\])? \(most recent call first\):|  <[\w ]{1,40}>"
    r"|(?:Fatal Python error|Extension modules|Python runtime state): .*"
)


def traceback_path(subject: Subject) -> Path:
    """Return the file into which the core's own handlers print its stacks."""
    return subject.recorder.with_name(subject.recorder.name + ".stacks")


def ask(subject: Subject, haul: Haul) -> int | None:
    """Have the living process print its stacks. Returns from where on they will stand; None: not asked."""
    if stands_still(subject.pid):
        haul.missing["stacks.txt"] = "the process stood still, so it could not print its own stacks"
        return None
    if not _has_handler(subject.pid):
        haul.missing["stacks.txt"] = "the process had not set up the printing of its stacks"
        return None
    before_bytes = _size_bytes(traceback_path(subject))
    try:
        signal.pidfd_send_signal(subject.pidfd, signal.SIGUSR1)
    except OSError as error:
        haul.missing["stacks.txt"] = f"the process could not be asked for its stacks: {error.strerror}"
        return None
    return before_bytes


def pick_up(subject: Subject, haul: Haul, after_bytes: int, until_ns: int) -> None:
    """Wait for the stacks that were asked for, and keep them as `stacks.txt` until better ones come."""
    path = traceback_path(subject)
    _await_growth(path, after_bytes, until_ns)
    text = _printed(path, after_bytes)
    if isinstance(text, bytes) and text:
        haul.files["stacks.txt"] = text
    else:
        haul.missing["stacks.txt"] = (
            f"the process printed no stacks: {text if isinstance(text, str) else 'nothing came'}"
        )


def keep_last(subject: Subject, haul: Haul) -> None:
    """Keep what a dead core printed of its stacks. One that was killed had no time to: nothing is missing."""
    text = _printed(traceback_path(subject), 0)
    if isinstance(text, bytes) and text:
        haul.files["stacks.txt"] = text


def _printed(path: Path, after_bytes: int) -> bytes | str:
    """Return what stands in the file from `after_bytes` on, or why it can't be read."""
    try:
        with path.open("rb") as file:
            file.seek(after_bytes)
            text = file.read(TRACEBACK_BYTES_MAX).decode("utf-8", "replace")
    except OSError as error:
        return error.strerror or "unreadable"
    return "".join(f"{told(line)}\n" for line in text.splitlines()).encode()


def told(line: str) -> str:
    """Return one line that the handler printed as evidence shows it: without the folders of the machine."""
    if frame := _FRAME.fullmatch(line):
        path, function = short_path(visible(frame["path"])), visible(frame["function"])
        return f'  File "{path}", line {frame["line"]} in {function}'
    if frame := _NATIVE.fullmatch(line):
        library = visible(frame["path"]).rpartition("/")[2]
        return f'  Binary file "{library}", at {frame["function"] or ""}+0x{frame["at"]}'
    return visible(line if _OWN_LINE.fullmatch(line) else mask_line(line))


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
