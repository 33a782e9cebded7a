"""What the core's memory is made of: the kernel's sums, the core's own census, and who ran out of it.

The roll-up of the memory map is the one part that may hang: it is looked at `aside`, and missing if it did not
come. Everything else here is counters that wait for nothing. The map itself stays unread: it names every file.
"""

from pathlib import Path
from typing import Any

import msgspec
import psutil

from hardcore.model.recorder import Census, Page
from hardcore.snapshot.aside import Aside
from hardcore.snapshot.form import as_bytes
from hardcore.snapshot.subject import Haul, Subject

PROC_BYTES_MAX = 64 << 10

Rollup = Aside[dict[str, int] | str]


def begin_rollup(pid: int) -> Rollup:
    """Begin to read the sums of a process's memory map."""
    return Aside(lambda: read_rollup(pid))


def collect_memory(subject: Subject, haul: Haul, rollup: Rollup | None, until_ns: int) -> None:
    """Write `memory.json`; without a roll-up only what a dead core's page and the host still say."""
    facts: dict[str, Any] = {**census_facts(haul.page), "host": _host()}
    if rollup is not None:
        facts |= {"kernel": status_sizes(subject.pid), "group": group_counters(subject.pid)}
        sums = rollup.wait(until_ns)
        if isinstance(sums, str):
            haul.missing["memory-rollup"] = sums
        else:
            facts["rollup_bytes"] = sums
    haul.files["memory.json"] = as_bytes(facts)


def read_rollup(pid: int) -> dict[str, int] | str:
    """Return the sums of a process's memory map in bytes by name, or why they can't be had. May hang."""
    try:
        return _sizes(Path(f"/proc/{pid}/smaps_rollup").read_text("ascii", "replace"))
    except OSError as error:
        return f"the kernel would not tell: {error.strerror}"


def census_facts(page: Page | None) -> dict[str, Any]:
    """Return the last two censuses and what grew between them, the largest growth first."""
    censuses = page.censuses if page is not None else ()
    return {
        "censuses": msgspec.to_builtins(censuses),
        "growth": growth(censuses[-2], censuses[-1]) if len(censuses) > 1 else None,
    }


def growth(before: Census, after: Census) -> dict[str, Any]:
    """Return what changed from one census to the next one."""
    old = {kind.name: kind for kind in before.types}
    types = [
        {
            "name": kind.name,
            "count": kind.count - (old[kind.name].count if kind.name in old else 0),
            "size_bytes": kind.size_bytes - (old[kind.name].size_bytes if kind.name in old else 0),
            "new": kind.name not in old,
        }
        for kind in after.types
    ]
    return {
        "over_ms": max(0, after.at_ns - before.at_ns) // 1_000_000,
        "rss_bytes": after.rss_bytes - before.rss_bytes,
        "objects": after.objects - before.objects,
        "types": sorted(types, key=lambda kind: -int(kind["size_bytes"])),
    }


def status_sizes(pid: int) -> dict[str, int]:
    """Return the sizes that the kernel keeps as counters, in bytes by name; empty when it is gone."""
    sizes = _sizes(_read(Path(f"/proc/{pid}/status")))
    return {name: size for name, size in sizes.items() if name.startswith(("Vm", "Rss"))}


def group_counters(pid: int) -> dict[str, str]:
    """Return what the process's memory group counts: its limit, its use, and how often it was too much."""
    told: dict[str, str] = {}
    for folder, names in _groups(pid):
        told |= {name: text for name in names if (text := _read(folder / name).strip())}
    return told


def _groups(pid: int) -> list[tuple[Path, tuple[str, ...]]]:
    """Return where the counters of the process's memory group stand, of either kind of groups."""
    root = Path("/sys/fs/cgroup")
    found: list[tuple[Path, tuple[str, ...]]] = []
    for line in _read(Path(f"/proc/{pid}/cgroup")).splitlines():
        number, kinds, path = [*line.split(":", 2), "", ""][:3]
        inside = path.lstrip("/")
        if number == "0":
            found.append((root / inside, ("memory.max", "memory.current", "memory.peak", "memory.events")))
        elif "memory" in kinds.split(","):
            names = ("memory.limit_in_bytes", "memory.usage_in_bytes", "memory.failcnt", "memory.oom_control")
            found.append((root / "memory" / inside, names))
    return found


def _host() -> dict[str, int]:
    memory = psutil.virtual_memory()
    return {"available_bytes": memory.available, "total_bytes": memory.total}


def _sizes(text: str) -> dict[str, int]:
    """Return the lines `Name:  12 kB` of a file of the kernel's as bytes."""
    lines = (line.split() for line in text.splitlines())
    return {
        words[0].rstrip(":"): int(words[1]) * 1024
        for words in lines
        if len(words) == 3 and words[2] == "kB" and words[1].isdecimal()
    }


def _read(path: Path) -> str:
    try:
        with path.open("rb") as file:
            return file.read(PROC_BYTES_MAX).decode("utf-8", "replace")
    except OSError:
        return ""
