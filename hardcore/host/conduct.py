"""What a core does that it never does: foreign children, code that changed under it, open ports, sudden growth.

An outside guard would call it tampering; mostly it is an upgrade in place, or a bug. So each finding is a fact in
words for a yellow light, and nobody is killed for it. Looked at once a second or less, on the survey's thread; the
files on disk as an errand, because the disk they lie on may hang and `maps` waits for a lock of the process.
"""

import os
import re
from collections import deque
from collections.abc import Iterator, Mapping
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from statistics import median

from hardcore.host import vitals
from hardcore.host.errand import Errand
from hardcore.host.locks import name_of
from hardcore.model.looks import Conduct

#: Findings of one kind that are told.
TOLD_MAX = 8
#: Where the kernel does not list a process's children, all processes are asked for their parent.
CHILDREN_EVERY_NS = 5_000_000_000
CODE_EVERY_NS = 10_000_000_000
#: The kernel walks all its connections to list those that listen, which takes it 10 ms.
PORTS_EVERY_NS = 30_000_000_000
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


class ConductWatch:
    """Watches the conduct of one life of the core. Used from one thread."""

    def __init__(self, pid: int) -> None:
        self._pid = pid
        self._children = Errand("children", _ChildrenWatch(pid).look)
        self._code = Errand("code", _CodeWatch(pid).look)
        self._due_ns: dict[str, int] = {}
        self._ports: tuple[str, ...] = ()
        self._threads: deque[int] = deque(maxlen=LOOKS_KEPT)
        self._fds: deque[int] = deque(maxlen=LOOKS_KEPT)

    def look(self, now_ns: int, threads: int | None, fds: int | None) -> Conduct:
        """Return what is strange now. `threads` and `fds` are the newest counts, None if there are none."""
        if self._is_due("children", now_ns, CHILDREN_EVERY_NS):
            self._children.send(now_ns)
        if self._is_due("code", now_ns, CODE_EVERY_NS):
            self._code.send(now_ns)
        if self._is_due("ports", now_ns, PORTS_EVERY_NS):
            self._ports = listening(self._pid)
        jumps = (
            _jump(self._threads, threads, THREADS_JUMP, "threads"),
            _jump(self._fds, fds, FDS_JUMP, "open files"),
        )
        return Conduct(
            children=self._newest(self._children),
            code=self._newest(self._code),
            ports=self._ports,
            jumps=tuple(jump for jump in jumps if jump),
        )

    def _is_due(self, what: str, now_ns: int, every_ns: int) -> bool:
        if now_ns < self._due_ns.get(what, 0):
            return False
        self._due_ns[what] = now_ns + every_ns
        return True

    @staticmethod
    def _newest(errand: Errand[tuple[str, ...]]) -> tuple[str, ...]:
        errand.back(0)
        return errand.last or ()


class _ChildrenWatch:
    """Finds children that a core does not have. An errand: a command line waits for a lock of its process."""

    def __init__(self, pid: int) -> None:
        self._pid = pid
        self._known: frozenset[int] = frozenset()

    def look(self) -> tuple[str, ...]:
        """Return the strange children."""
        pids = _listed_children(self._pid)
        if pids is None:
            pids = _found_children(self._pid)
        own, strange, known = _command(self._pid), [], set()
        for pid in pids:
            command = _command(pid)
            if not command or _EXPECTED.search(command):
                continue
            known.add(pid)
            # Between its fork and its exec every child looks like the core itself; one that stays so is a child.
            if command != own or pid in self._known:
                strange.append(f"process {pid} ({name_of(pid)})")
        self._known = frozenset(known)
        return tuple(strange[:TOLD_MAX])


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
    """Return the TCP ports that the process listens on; a core has none, it listens on a socket of ours.

    What we hold as well is not its own: the gateway's listener, which a core keeps for the guard that it may start.
    """
    open_ports = {**_listeners(pid, "tcp"), **_listeners(pid, "tcp6")}
    if not open_ports:
        return ()
    held = _held_sockets(pid) - _held_sockets(os.getpid())
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


class _CodeWatch:
    """Compares a core's program on disk with what it was when the core began. An errand: the disk may hang."""

    def __init__(self, pid: int, package: str = "core") -> None:
        self._pid = pid
        self._package = _folder_of(package)
        self._known: dict[str, Stamp | None] = {}

    def look(self) -> tuple[str, ...]:
        """Return what has changed."""
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
