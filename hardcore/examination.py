"""`hardcore doctor`: what this machine lets the guard see, do and keep, before the night it is needed.

Each finding is a fact with a next step where there is one: well, worth knowing, or bad. Looking leaves nothing
behind: a small file is written and removed, because a mode says little about a disk, and one short-lived child of
our own is dumped to see whether dumping works here. Everything that the
guard does works without what is only worth knowing; a `bad` is what would lose evidence or the ledger's room.
"""

import os
import resource
import subprocess
import sys
import time
import tomllib
from collections.abc import Callable, Iterable
from pathlib import Path

import click
import msgspec

from frontend.catalogue_doctor import doctor_text
from hardcore import standing
from hardcore.access import files as access
from hardcore.asked import Asked, ask_policy, is_held, operator, status_of
from hardcore.host import backups, capability, clock, disk, files, memory, muting
from hardcore.host.folders import Folders
from hardcore.lines import wrapped
from hardcore.model.verdicts import Colour
from hardcore.recovery.policy import Policy, PolicyFault
from hardcore.recovery.spare import Lack
from hardcore.snapshot import stacks

KERNEL_MIN = (5, 4)
#: For a program that begins, and a server that answers or does not.
STORE_S = 15.0
FREE_BYTES_GOOD = 1 << 30
FILES_MIN = 1024
MB = 1 << 20
DUMP_MS = 1000
#: None of the guard's own small files is larger.
OWN_FILE_BYTES_MAX = 4 << 20
BACKUP_STALE_S = 48 * 3_600  # one is made each day; a day may be missed
#: The household's own bank formats, beside its ledger; as the ledger bounds them.
FORMATS = "formats"
FORMATS_MAX = 200
FORMAT_BYTES_MAX = 64 << 10
FORMAT_NEEDS = ("schema", "name", "kind", "sure", "header", "columns", "date", "identity", "test")
#: File systems that live in memory: what lies there is gone when the machine is switched off.
_IN_MEMORY = frozenset({"tmpfs", "ramfs"})
#: File systems on which SQLite's locks can't be trusted.
_FAR = frozenset({"nfs", "nfs4", "cifs", "smb3", "fuse.sshfs", "9p"})
_NO_ROOM = frozenset({"ENOSPC", "EDQUOT"})
_MARKS = {Colour.GREEN: "ok  ", Colour.YELLOW: "note", Colour.RED: "BAD "}


class Finding(msgspec.Struct, frozen=True):
    """One thing that was looked at: its name, how it is, and the text that says so, with its values."""

    name: str
    colour: Colour
    text: str
    values: tuple[tuple[str, object], ...] = ()


def _found(name: str, colour: Colour, text: str, **values: object) -> Finding:
    return Finding(name, colour, text, tuple(values.items()))


@click.command()
@operator
def doctor(asked: Asked) -> None:
    """Say what this machine lets the guard see and do. Exit code 1 if something is bad."""
    findings = examine(asked.folders)
    bad = any(finding.colour is Colour.RED for finding in findings)
    if not asked.json:
        for finding in findings:
            words = doctor_text(finding.text, asked.lang, **dict(finding.values))
            click.echo(f"{_MARKS[finding.colour]}  {wrapped(words, 6)}")
        click.echo(doctor_text("sum_bad" if bad else "sum_good", asked.lang))
    asked.tell(
        {
            "ok": not bad,
            "findings": [
                {
                    "name": finding.name,
                    "colour": str(finding.colour),
                    "text": doctor_text(finding.text, asked.lang, **dict(finding.values)),
                    **{name: value for name, value in finding.values if isinstance(value, str | int | float)},
                }
                for finding in findings
            ],
        }
    )
    sys.exit(1 if bad else 0)


def examine(folders: Folders) -> list[Finding]:
    """Look at everything, in the order in which it matters."""
    looks: Iterable[Callable[[Folders], Iterable[Finding]]] = (
        _machine,
        _disk,
        _store,
        _policy,
        _guard,
        _door,
        _spare,
        _alerts,
        _checkpoints,
        _backups,
        _own_files,
        _formats,
        _evidence,
        _limits,
    )
    return [finding for look in looks for finding in look(folders)]


def _machine(_: Folders) -> Iterable[Finding]:
    release = os.uname().release
    numbers = tuple(int(part) for part in release.split("-")[0].split(".")[:2] if part.isdigit())
    colour = Colour.GREEN if numbers >= KERNEL_MIN else Colour.RED
    text = "kernel" if colour is Colour.GREEN else "kernel_old"
    yield _found("kernel", colour, text, release=release, python=".".join(map(str, sys.version_info[:3])))
    sleeping = _readable("/proc/self/wchan") and _readable("/proc/self/schedstat")
    yield _found(
        "threads",
        Colour.GREEN if sleeping else Colour.YELLOW,
        "threads" if sleeping else "threads_hidden",
    )


def _disk(folders: Folders) -> Iterable[Finding]:
    data = folders.data
    if not data.is_dir():
        yield _found("data", Colour.YELLOW, "data_missing", path=data)
        return
    why = disk.write_once(data / f".doctor-{os.getpid()}")
    if why and why not in _NO_ROOM:
        yield _found("data", Colour.RED, "data_not_writable", path=data, why=why)
        return
    yield _room(folders, full=bool(why))
    kind = _file_system(data)
    if kind in _IN_MEMORY:
        yield _found("file system", Colour.YELLOW, "in_memory", kind=kind)
    elif kind in _FAR:
        yield _found("file system", Colour.RED, "far", kind=kind)
    else:
        yield _found("file system", Colour.GREEN, "file_system", kind=kind or "?")


def _room(folders: Folders, *, full: bool) -> Finding:
    """Hold the room on the disk against the floor that the guard goes by. `full`: our own write found none."""
    free = disk.told_free_bytes(os.statvfs(folders.data), reserve_is_ours=disk.has_reserve())
    policy = ask_policy(folders) or standing.policy_at_next_start(folders).policy
    if free is None:
        return _found("room", Colour.GREEN, "room_untold", path=folders.data)
    colour, text = Colour.YELLOW, "room_little"
    if full or free < policy.disk_floor_mb * MB:
        colour, text = Colour.RED, "room_none"
    elif free >= FREE_BYTES_GOOD:
        colour, text = Colour.GREEN, "room"
    return _found("room", colour, text, free_mb=free // MB, floor_mb=policy.disk_floor_mb, path=folders.data)


def _store(folders: Folders) -> Iterable[Finding]:
    """Ask what the ledger lies in, by the core's own program: the guard knows no database."""
    argv = [sys.executable, "-I", "-m", "core", "look-at-store", "--data", str(folders.data)]
    try:
        done = subprocess.run(argv, capture_output=True, text=True, check=False, timeout=STORE_S)
    except subprocess.TimeoutExpired:
        yield _found("store", Colour.RED, "store_away", why=f"{STORE_S:g} s")
        return
    if done.returncode == 0:
        kind, _, version = done.stdout.strip().partition(" ")
        if kind != "sqlite":
            yield _found("store", Colour.GREEN, "store", version=done.stdout.strip())
            return
        race = version.endswith(" race")
        version = version.removesuffix(" race")
        # A note: nothing of ours can bring it about, but a tool that somebody opens the file with can.
        yield _found(
            "store",
            Colour.YELLOW if race else Colour.GREEN,
            "sqlite_race" if race else "sqlite",
            version=version,
        )
        return
    why = (done.stderr.strip().splitlines() or ["-"])[-1]
    yield _found("store", Colour.RED, "store_away", why=why)


def _policy(folders: Folders) -> Iterable[Finding]:
    if not folders.policy.exists():
        yield _found("policy", Colour.GREEN, "policy_default")
        return
    found = standing.load_policy_file(folders.policy)
    if isinstance(found, Policy):
        yield _found("policy", Colour.GREEN, "policy")
        return
    first: PolicyFault = found[0]
    yield _found("policy", Colour.RED, "policy_faulty", fault=str(first), path=folders.policy)


def _guard(folders: Folders) -> Iterable[Finding]:
    if not is_held(folders):
        yield _found("guard", Colour.YELLOW, "guard_off")
        return
    told = status_of(Asked(folders.data, json=True, lang="en"))
    if told["sentinel"]["pid"] is None:
        yield _found("guard", Colour.RED, "guard_silent")
        return
    yield _found("guard", Colour.GREEN, "guard", state=told["state"], pid=told["sentinel"]["pid"])
    if told["start_fault"]:
        yield _found("core", Colour.RED, "core_unstartable", why=told["start_fault"])
    yield _watched(folders, told["sentinel"]["pid"])


def _watched(folders: Folders, pid: int) -> Finding:
    """Say whether the sentinel itself would be missed: its agents go by what it has left word of, and by its page."""
    word = files.read_json(folders.agents, OWN_FILE_BYTES_MAX)
    who = word.get("sentinel")
    pages = (folders.sentinel_page, folders.gateway_page)
    lacking = [page.name for page in pages if not page.is_file()]
    if not isinstance(who, dict) or who.get("pid") != pid:
        lacking.append(folders.agents.name)
    if lacking:
        return _found("agents", Colour.YELLOW, "agents_blind", files=", ".join(lacking))
    if word.get("sentinel_lost") is not True:
        return _found("agents", Colour.YELLOW, "agents_forbidden")
    return _found("agents", Colour.GREEN, "agents")


def _door(folders: Folders) -> Iterable[Finding]:
    """Who may come in, and what a password travels in."""
    people, doorway = access.read_people(folders.state), access.read_doorway(folders.state)
    if isinstance(people, access.Unreadable):
        yield _found(
            "door", Colour.RED, "door_unreadable", path=folders.state / access.PEOPLE, why=people.why
        )
    elif not people.closed:
        yield _found("door", Colour.GREEN, "door_here")
    elif doorway.insecure_lan and doorway.open and not doorway.encrypted:
        yield _found("door", Colour.YELLOW, "door_plain")
    else:
        text = "door_open" if doorway.open else "door_closed"
        yield _found("door", Colour.GREEN, text, people=len(people.people), tokens=len(people.tokens))
    for path in filter(None, (doorway.tls_cert, doorway.tls_key)):
        if not _readable(path):
            yield _found("door_files", Colour.RED, "door_files", path=path)


def _spare(folders: Folders) -> Iterable[Finding]:
    """Say whether a second core waits, or could be kept here. Without one everything works; a way back takes longer."""
    policy = ask_policy(folders) or standing.policy_at_next_start(folders).policy
    if not policy.spare:
        yield _found("spare", Colour.YELLOW, "spare_off")
        return
    told = status_of(Asked(folders.data, json=True, lang="en"))
    if told["spare"] is not None and told["spare"]["ready"]:
        yield _found("spare", Colour.GREEN, "spare_waits", pid=told["spare"]["pid"])
        return
    if told["spare_lack"] == Lack.DIED:
        yield _found("spare", Colour.YELLOW, "spare_died", why=told["spare_off"])
        return
    free = memory.free_bytes(os.getpid())
    if free is None:
        yield _found("spare", Colour.YELLOW, "spare_untold")
        return
    room = free >= policy.spare_memory_mb * MB
    text, colour = ("spare_room", Colour.GREEN) if room else ("spare_little", Colour.YELLOW)
    yield _found("spare", colour, text, free_mb=free // MB, floor_mb=policy.spare_memory_mb)


def _alerts(folders: Folders) -> Iterable[Finding]:
    """Say whether anybody would be told: whom the policy names, how it went last, and whether it is muted."""
    policy = standing.policy_at_next_start(folders).policy
    if not policy.alerts:
        yield _found("alerts", Colour.YELLOW, "alerts_nobody")
        return
    until_ms = muting.muted_until_ms(folders)
    if until_ms > time.time() * 1000:
        yield _found("alerts muted", Colour.YELLOW, "alerts_muted", minutes=_minutes_until(until_ms))
    told = files.read_json(folders.alerts, OWN_FILE_BYTES_MAX).get("channels")
    channels = [one for one in told if isinstance(one, dict)] if isinstance(told, list) else []
    failing = [str(one.get("number")) for one in channels if one.get("ok") is False]
    if failing:
        yield _found("alerts", Colour.YELLOW, "alerts_failing", channels=", ".join(failing))
    else:
        yield _found("alerts", Colour.GREEN, "alerts", count=len(policy.alerts))


def _minutes_until(until_ms: int) -> int:
    return max(1, round((until_ms - time.time() * 1000) / 60_000))


def _checkpoints(folders: Folders) -> Iterable[Finding]:
    """Count the checkpoints that a start may go by. Whether one is whole is judged by whoever uses it."""
    count = sum(1 for _ in folders.checkpoints.glob("*.json"))
    yield _found("checkpoints", Colour.GREEN, "checkpoints" if count else "checkpoints_none", count=count)


def _backups(folders: Folders) -> Iterable[Finding]:
    """Look whether there is a backup, and a fresh one; where nothing was ever served none is missed."""
    kept = backups.kept_in(folders.data)
    age_s = backups.age_s(kept, time.time())
    if age_s is None:
        served = folders.generation.exists()
        yield _found(
            "backups",
            Colour.YELLOW if served else Colour.GREEN,
            "backups_none" if served else "backups_later",
        )
    elif age_s > BACKUP_STALE_S:
        yield _found("backups", Colour.YELLOW, "backups_old", days=int(age_s // 86_400), file=kept.name)
    else:
        yield _found("backups", Colour.GREEN, "backups", count=kept.count, hours=max(0, int(age_s // 3_600)))


def _own_files(folders: Folders) -> Iterable[Finding]:
    """Find what the guard keeps for itself and could not read at its next start: it would begin anew without a word."""
    kept = (
        *(folders.history, folders.counters, folders.alerts, folders.refused_paths, folders.calendar),
        *(folders.state / name for name in ("wanted.json", "alerts_muted.json", "recoveries.json")),
    )
    broken = [one.name for one in kept if one.exists() and not files.read_json(one, OWN_FILE_BYTES_MAX)]
    if broken:
        yield _found(
            "own files", Colour.YELLOW, "own_files_broken", files=", ".join(broken), path=folders.state
        )
    else:
        yield _found("own files", Colour.GREEN, "own_files")


def _formats(folders: Folders) -> Iterable[Finding]:
    """Find the household's own bank formats that can't be meant; what is in a good one, the ledger itself looks at."""
    found = sorted((folders.data / FORMATS).glob("*.toml"))[:FORMATS_MAX]
    faults = [(path.name, why) for path in found if (why := _fault_of_format(path)) is not None]
    for name, why in faults:
        yield _found("formats", Colour.YELLOW, "format_faulty", file=name, why=why)
    if found and not faults:
        yield _found("formats", Colour.GREEN, "formats", count=len(found))


def _fault_of_format(path: Path) -> str | None:
    try:
        if not path.is_file() or path.stat().st_size > FORMAT_BYTES_MAX:
            return "it is no plain file, or too large"
        told = tomllib.loads(path.read_text("utf-8-sig"))
    except (OSError, ValueError) as error:
        return str(error) or "it can't be read"
    if told.get("id") != path.stem:
        return "id is not the name of its file"
    missing = [name for name in FORMAT_NEEDS if name not in told]
    return f"{', '.join(missing)} missing" if missing else None


def _evidence(folders: Folders) -> Iterable[Finding]:
    able = files.read_json(folders.capability) if is_held(folders) else {}
    able = able or _try()
    if able.get("can_dump"):
        yield _found("stacks", Colour.GREEN, "stacks")
    else:
        text = "stacks_forbidden" if able.get("py_spy") else "stacks_missing"
        yield _found("stacks", Colour.YELLOW, text, why=able.get("why"))
    image = "image" if able.get("gcore") else "image_missing"
    yield _found("memory image", Colour.GREEN if able.get("gcore") else Colour.YELLOW, image)
    counter = able.get("oom_counter", "none")
    if counter == "none":
        yield _found("out of memory", Colour.YELLOW, "oom_hidden")
    else:
        yield _found("out of memory", Colour.GREEN, "oom", source=counter)


def _try() -> dict[str, object]:
    """Try it ourselves where no sentinel has: one short-lived child is made and looked at."""
    tools = stacks.find_tools()

    def dump(pid: int) -> str:
        found = stacks.sample(pid, tools, clock.now_ns() + DUMP_MS * 1_000_000)
        return found if isinstance(found, str) else ""

    return capability.examine(tools.py_spy, tools.gcore, dump)


def _limits(_: Folders) -> Iterable[Finding]:
    soft = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    text, colour = ("files", Colour.GREEN) if soft >= FILES_MIN else ("files_few", Colour.YELLOW)
    yield _found("open files", colour, text, soft=soft, least=FILES_MIN)


def _readable(path: str) -> bool:
    try:
        return bool(Path(path).read_text().strip())
    except OSError:
        return False


def _file_system(path: Path) -> str | None:
    """Return the kind of file system that `path` lies on, as the kernel's table of mounts names it."""
    best, kind = "", None
    where = str(path.resolve())
    try:
        lines = Path("/proc/self/mounts").read_text("utf-8", "replace").splitlines()
    except OSError:
        return None
    for line in lines:
        _, mount, name, *_ = line.split(" ")
        mount = mount.replace("\\040", " ")
        inside = where == mount or where.startswith(mount.rstrip("/") + "/")
        if inside and len(mount) >= len(best):
            best, kind = mount, name
    return kind
