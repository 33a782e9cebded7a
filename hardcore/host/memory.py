"""The kernel's account of memory: its kills for want of it, what is free, what one has, and a group of its own for one.

That a process ended by SIGKILL says nothing about who sent it; the counter that rose meanwhile does. The nearest
one counts: of the process's own control group (version 2 or 1), else of the whole machine. A group of its own is
what the drill needs, so that the kernel ends the core and nobody beside it: a limit on address space was not
chosen, because it raises MemoryError in the core, which is another death.
"""

import os
from contextlib import suppress
from pathlib import Path

import msgspec

TEXT_BYTES_MAX = 64 << 10
#: A confined core may grow by this: what it had before stays with the group it came from.
CONFINED_BYTES = 128 << 20

_MOUNT = Path("/sys/fs/cgroup")
_VMSTAT = Path("/proc/vmstat")
_MEMINFO = Path("/proc/meminfo")
_PREFIX = "hardcore-core-"
#: Of version 1: the limit, what is used, and how much of that are files nobody needs at the moment.
_NAMES_1 = ("limit_in_bytes", "usage_in_bytes", "total_inactive_file")


class Group(msgspec.Struct, frozen=True):
    """A memory control group: its folder, and the version of its interface."""

    folder: Path
    version: int

    @property
    def counter(self) -> Path:
        """The file that counts the kernel's kills."""
        return self.folder / ("memory.events" if self.version == 2 else "memory.oom_control")

    @property
    def above(self) -> "Group":
        """The group that this one is in; its limit holds too."""
        return Group(self.folder.parent, self.version)

    def free_bytes(self) -> int | None:
        """Return what may still be taken in this group alone, cached files let go; None where nothing limits it."""
        names = ("max", "current", "inactive_file") if self.version == 2 else _NAMES_1
        limit = _number(_read(self.folder / f"memory.{names[0]}"))
        used = _number(_read(self.folder / f"memory.{names[1]}"))
        if limit is None or used is None:
            return None
        cached = _line(self.folder / "memory.stat", names[2]) or 0
        return max(0, limit - max(0, used - cached))


class OomCounter(msgspec.Struct, frozen=True):
    """Where the kernel counts what it has killed, and how many that were at the beginning."""

    path: Path
    before: int

    @property
    def kind(self) -> str:
        """Which counter it is."""
        kinds = {"memory.events": "cgroup2", "memory.oom_control": "cgroup1"}
        return kinds.get(self.path.name, "vmstat")

    def risen(self) -> int | None:
        """Return how many it has killed since the beginning; None if it can't be read any more."""
        now = _kills(self.path)
        return None if now is None else max(0, now - self.before)


def oom_counter(pid: int) -> OomCounter | None:
    """Return the nearest counter for this process, as it stands now; None where nobody counts."""
    group = group_of(pid)
    paths = [group.counter] if group is not None else []
    for path in (*paths, _VMSTAT):
        before = _kills(path)
        if before is not None:
            return OomCounter(path, before)
    return None


def free_bytes(pid: int) -> int | None:
    """Return how much memory a process of this one's group could have now; None where nobody says.

    What the machine has to give, or less where a group limits it, or one that it is in.
    """
    told = _line(_MEMINFO, "MemAvailable:")
    found = [] if told is None else [told << 10]
    group = group_of(pid)
    while group is not None and group.folder.is_relative_to(_MOUNT):
        free = group.free_bytes()
        found += [] if free is None else [free]
        group = group.above
    return min(found, default=None)


def private_bytes(pid: int) -> int | None:
    """Return the memory that this process has for itself, swapped out or not; None: it is gone, or nobody says.

    Its anonymous pages by the kernel's own counters: what `smaps` adds up costs milliseconds and waits for a lock that
    a stuck process holds.
    """
    status = Path(f"/proc/{pid}/status")
    held = _line(status, "RssAnon:")
    return None if held is None else (held + (_line(status, "VmSwap:") or 0)) << 10


def _kills(path: Path) -> int | None:
    return _line(path, "oom_kill")


def _line(path: Path, name: str) -> int | None:
    """Return the number beside this name, in a file that has one on each line."""
    for line in _read(path).splitlines():
        words = line.split()
        if len(words) > 1 and words[0] == name:
            return _number(words[1])
    return None


def _number(text: str) -> int | None:
    return int(text) if text.strip().isdigit() else None


def group_of(pid: int) -> Group | None:
    """Return the memory control group that this process is in, if it can be found."""
    for line in _read(Path(f"/proc/{pid}/cgroup")).splitlines():
        _, controllers, path = (*line.split(":", 2), "", "")[:3]
        if "memory" in controllers.split(","):
            return _found(Group(_MOUNT / "memory" / path.lstrip("/"), 1))
        if not controllers and (group := _found(Group(_MOUNT / path.lstrip("/"), 2))) is not None:
            return group
    return None


def _found(group: Group) -> Group | None:
    return group if group.counter.exists() else None


class Confined(msgspec.Struct, frozen=True):
    """A process is in a memory group of its own."""

    group: Group


def confine(pid: int, limit_bytes: int = CONFINED_BYTES) -> Confined | str:
    """Put a process into a memory group of its own that may grow by `limit_bytes`; or say why that can't be done.

    The group is to be given to `dissolve` once the process is gone.
    """
    group = group_of(pid)
    if group is None:
        return "this machine gives no memory control group"
    made = _make_beside(group, f"{_PREFIX}{pid}")
    if isinstance(made, str):
        return made
    try:
        _limit(made, limit_bytes)
        (made.folder / "cgroup.procs").write_text(f"{pid}\n")
    except OSError as error:
        dissolve(Confined(made))
        return f"the memory control group can't be used: {error.strerror}"
    return Confined(made)


def _make_beside(group: Group, name: str) -> Group | str:
    """Make a group: below the present one, or with version 2 beside it, as a group with processes has none below."""
    above = group.folder if group.version == 1 else group.folder.parent
    if group.version == 2 and group.folder == _MOUNT:
        return "the memory control group of this container can't be divided"
    _sweep(above)
    made = Group(above / name, group.version)
    try:
        made.folder.mkdir(exist_ok=True)
    except OSError as error:
        return f"no memory control group can be made: {error.strerror}"
    if made.counter.exists():
        return made
    dissolve(Confined(made))
    return "a new memory control group has no limits here"


def _limit(group: Group, limit_bytes: int) -> None:
    """Set the limit, on memory and on what is swapped out. Raises OSError if there can be none."""
    if group.version == 2:
        (group.folder / "memory.max").write_text(str(limit_bytes))
        with suppress(OSError):  # a kernel that does not count what is swapped out has no such file
            (group.folder / "memory.swap.max").write_text("0")
        return
    (group.folder / "memory.limit_in_bytes").write_text(str(limit_bytes))
    with suppress(OSError):  # as above
        (group.folder / "memory.memsw.limit_in_bytes").write_text(str(limit_bytes))


def dissolve(confined: Confined) -> bool:
    """Remove a group whose process is gone; return whether it is gone too."""
    with suppress(OSError):
        confined.group.folder.rmdir()
    return not confined.group.folder.exists()


def _sweep(above: Path) -> None:
    """Remove the groups of processes that are long gone: a guard that died could not. One in use stays."""
    for folder in above.glob(f"{_PREFIX}*"):
        with suppress(OSError):
            folder.rmdir()


def can_confine() -> bool:
    """Tell whether a process could get a memory group of its own, by making one and removing it."""
    group = group_of(os.getpid())
    made = _make_beside(group, f"{_PREFIX}try-{os.getpid()}") if group is not None else ""
    return isinstance(made, Group) and dissolve(Confined(made))


def _read(path: Path) -> str:
    try:
        with path.open("rb") as file:
            return file.read(TEXT_BYTES_MAX).decode("utf-8", "replace")
    except OSError:
        return ""
