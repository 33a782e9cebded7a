"""What a core does that it never does: foreign children, code that changed under it, open ports, sudden growth.

An outside guard would call it tampering; mostly it is an upgrade in place, or a bug. So each finding is a fact in
words for a yellow light, and nobody is killed for it. Looked at once a second or less, on the survey's thread; the
files on disk as an errand, because the disk they lie on may hang and `maps` waits for a lock of the process.
"""

import os
import re
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from statistics import median

from hardcore.host import vitals
from hardcore.host.errand import Errand
from hardcore.host.locks import name_of
from hardcore.model.observations import Conduct

#: Findings of one kind that are told.
TOLD_MAX = 8
#: Where the kernel does not list a process's children, all processes are asked for their parent, this often.
SCAN_EVERY_NS = 5_000_000_000
CODE_EVERY_NS = 10_000_000_000
FILES_MAX = 4096
HANDLES_MAX = 4096
PROC_BYTES_MAX = 1 << 20
WORDS_BYTES_MAX = 4096
#: A jump is so much more than the middle of the life's last looks, once there are enough of them.
LOOKS_KEPT = 120
LOOKS_NEEDED = 20
THREADS_JUMP = 16
FDS_JUMP = 128

#: Programs that a core starts by itself: the reader of a bank's file.
_EXPECTED = re.compile(rb"\0-m\0core\.imports\.reading\0")
_LISTEN = "0A"
_SOCKET = re.compile(r"socket:\[(\d+)\]")

Stamp = tuple[int, int, int, int]


@dataclass(slots=True)
class ConductWatch:
    """Watches the conduct of one life of the core. Used from one thread."""

    pid: int
    _children: tuple[str, ...] = ()
    _once: frozenset[int] = frozenset()
    _scanned_ns: int | None = None
    _listed: bool = True
    _code: "CodeWatch" = field(init=False)
    _threads: deque[int] = field(default_factory=lambda: deque(maxlen=LOOKS_KEPT))
    _fds: deque[int] = field(default_factory=lambda: deque(maxlen=LOOKS_KEPT))

    def __post_init__(self) -> None:
        self._code = CodeWatch(self.pid)

    def look(self, now_ns: int, threads: int | None, fds: int | None) -> Conduct:
        """Return what is strange now. `threads` and `fds` are the newest counts, None if there are none."""
        jumps = (
            _jump(self._threads, threads, THREADS_JUMP, "threads"),
            _jump(self._fds, fds, FDS_JUMP, "open files"),
        )
        return Conduct(
            children=self._strange_children(now_ns),
            code=self._code.look(now_ns),
            ports=listening(self.pid),
            jumps=tuple(jump for jump in jumps if jump),
        )

    def _strange_children(self, now_ns: int) -> tuple[str, ...]:
        pids = _listed_children(self.pid) if self._listed else None
        if pids is None:
            self._listed = False
            if self._scanned_ns is not None and now_ns - self._scanned_ns < SCAN_EVERY_NS:
                return self._children
            self._scanned_ns = now_ns
            pids = _found_children(self.pid)
        ours, strange, once = _command(self.pid), [], set()
        for pid in pids:
            command = _command(pid)
            if _EXPECTED.search(command) or not command:
                continue
            # Between its fork and its exec every child looks like the core itself; one that stays so is a child.
            if command == ours and pid not in self._once:
                once.add(pid)
                continue
            once.add(pid)
            strange.append(f"process {pid} ({name_of(pid)})")
        self._once, self._children = frozenset(once), tuple(strange[:TOLD_MAX])
        return self._children


def _listed_children(pid: int) -> list[int] | None:
    """Return the children as the kernel lists them for each thread; None where it keeps no such list."""
    found: list[int] = []
    try:
        for task in os.scandir(f"/proc/{pid}/task"):
            found += map(int, Path(f"{task.path}/children").read_text("ascii").split())
    except (OSError, ValueError):
        return None
    return found


def _found_children(pid: int) -> list[int]:
    found = []
    for entry in os.scandir("/proc"):
        if entry.name.isdigit():
            try:
                if int(vitals.stat_fields(int(entry.name))[1]) == pid:
                    found.append(int(entry.name))
            except (OSError, ValueError, IndexError):
                continue
    return found


def _command(pid: int) -> bytes:
    try:
        with Path(f"/proc/{pid}/cmdline").open("rb") as file:
            return file.read(WORDS_BYTES_MAX)
    except OSError:
        return b""


def _jump(before: deque[int], now: int | None, over: int, what: str) -> str:
    if now is None:
        return ""
    usual = int(median(before)) if len(before) >= LOOKS_NEEDED else now
    before.append(now)
    return f"{now} {what}, usually {usual}" if now > usual + over else ""


def listening(pid: int) -> tuple[str, ...]:
    """Return the TCP ports that the process listens on; a core has none, it listens on a socket of ours."""
    open_ports = {**_listeners(pid, "tcp"), **_listeners(pid, "tcp6")}
    if not open_ports:
        return ()
    held = _held_sockets(pid)
    return tuple(sorted({f"port {port}" for inode, port in open_ports.items() if inode in held})[:TOLD_MAX])


def _listeners(pid: int, kind: str) -> Mapping[str, int]:
    """Return inode: port of the listening sockets in the process's network; they come first in the kernel's table."""
    try:
        with Path(f"/proc/{pid}/net/{kind}").open("rb") as file:
            lines = file.read(PROC_BYTES_MAX).decode("ascii", "replace").splitlines()[1:]
    except OSError:
        return {}
    found = {}
    for line in lines:
        words = line.split()
        if len(words) > 9 and words[3] == _LISTEN:
            found[words[9]] = int(words[1].rpartition(":")[2], 16)
    return found


def _held_sockets(pid: int) -> set[str]:
    held = set()
    try:
        for entry in islice(os.scandir(f"/proc/{pid}/fd"), HANDLES_MAX):
            try:
                match = _SOCKET.fullmatch(str(Path(entry.path).readlink()))
            except OSError:
                continue
            if match:
                held.add(match[1])
    except OSError:
        return set()
    return held


class CodeWatch:
    """Compares a core's program on disk with what it was when the core began. Used from one thread."""

    def __init__(self, pid: int, package: str = "core") -> None:
        self._pid = pid
        self._package = _folder_of(package)
        self._known: dict[str, Stamp | None] = {}
        self._errand = Errand("code", self._compare)
        self._asked_ns: int | None = None

    def look(self, now_ns: int) -> tuple[str, ...]:
        """Return what has changed, as of the last comparison."""
        if self._asked_ns is None or now_ns - self._asked_ns >= CODE_EVERY_NS:
            self._asked_ns = now_ns
            self._errand.send(now_ns)
        self._errand.back(0)
        return self._errand.last or ()

    def _compare(self) -> tuple[str, ...]:
        first = not self._known
        changed = []
        ours = set(_sources(self._package)) if self._package else set()
        mapped = set(_mapped(self._pid))
        for path in sorted(ours | mapped | self._known.keys())[:FILES_MAX]:
            stamp = _stamp(path)
            if path not in self._known:
                # A library is mapped when it is needed; a source that was not there at the start is news.
                self._known[path] = stamp if first or path not in ours else None
            before = self._known[path]
            if before != stamp:
                what = "is new" if before is None else "is gone" if stamp is None else "has changed"
                changed.append(f"{self._shown(path)} {what}")
        return tuple(changed[:TOLD_MAX])

    def _shown(self, path: str) -> str:
        base = Path(self._package).parent if self._package else Path("/")
        inside = Path(path).is_relative_to(base)
        return str(Path(path).relative_to(base)) if inside else Path(path).name


def _folder_of(package: str) -> str | None:
    """Return where a package of this installation lies, without importing it."""
    found = find_spec(package)
    places = found.submodule_search_locations if found else None
    return next(iter(places), None) if places else None


def _sources(folder: str) -> Iterator[str]:
    waiting, seen = [folder], 0
    while waiting and seen < FILES_MAX:
        try:
            entries = list(islice(os.scandir(waiting.pop()), FILES_MAX))
        except OSError:
            continue
        for entry in entries:
            seen += 1
            if entry.is_dir(follow_symlinks=False):
                if entry.name != "__pycache__":
                    waiting.append(entry.path)
            elif entry.name.endswith((".py", ".so")):
                yield entry.path


def _mapped(pid: int) -> Iterator[str]:
    """Return the executable files that the process has in its memory: the interpreter and its libraries."""
    try:
        with Path(f"/proc/{pid}/maps").open("rb") as file:
            lines = file.read(PROC_BYTES_MAX).decode("utf-8", "surrogateescape").splitlines()
    except OSError:
        return
    for line in lines:
        words = line.split(None, 5)
        if len(words) == 6 and "x" in words[1] and words[5].startswith("/"):
            yield words[5].removesuffix(" (deleted)")


def _stamp(path: str) -> Stamp | None:
    try:
        about = Path(path).stat()
    except OSError:
        return None
    return about.st_dev, about.st_ino, about.st_mtime_ns, about.st_size
