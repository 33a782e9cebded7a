"""The collectors that need no debugger: the recorder's page, the process's own facts, the end of the logs.

Each takes what it can until its deadline, puts it into the `Haul`, and says in `missing` what it could not
have and why. None of them raises for what it finds on the other side; the writer catches our own bugs.
"""

import os
import signal
import stat
import time
from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec
import psutil
from msgspec import structs

from hardcore.host.recorder import PageReader, PageUnusable
from hardcore.model.looks import ProcessSample
from hardcore.model.recorder import CommandNote, Page
from hardcore.snapshot import threads
from hardcore.snapshot.blanking import blanked
from hardcore.snapshot.form import as_bytes
from hardcore.snapshot.masking import mask_line, mask_payload, readable_payload
from hardcore.snapshot.subject import Haul, Subject
from hardcore.snapshot.unfolding import unfolded

LOG_BYTES_MAX = 64 << 10
LOGS_MAX = 8
#: Open files that are named; above it they are only counted.
OPEN_NAMES_MAX = 256
PROC_BYTES_MAX = 64 << 10

_STATUS_FIELDS = frozenset(
    {"State", "PPid", "TracerPid", "FDSize", "Threads", "SigPnd", "ShdPnd", "SigBlk", "SigIgn", "SigCgt"}
    | {"NoNewPrivs", "Seccomp", "Cpus_allowed_list", "voluntary_ctxt_switches", "nonvoluntary_ctxt_switches"}
)


def collect_recorder(subject: Subject, haul: Haul) -> None:
    """Copy the page as it stands and keep it decoded beside: the best witness of what was going on."""
    reader = PageReader(subject.recorder, subject.nonce)
    try:
        raw, page = reader.raw(), reader.read()
    finally:
        reader.close()
    if isinstance(page, PageUnusable):
        haul.missing["recorder.json"] = page.reason
    if told := blanked(raw):
        haul.files["recorder.bin"] = told
    else:
        haul.missing["recorder.bin"] = haul.missing.get("recorder.json", "The recorder page was not whole.")
    if isinstance(page, PageUnusable):
        return
    haul.page = page
    haul.files["recorder.json"] = as_bytes(page_as_json(page, time.monotonic_ns()))


def page_as_json(page: Page, now_ns: int) -> dict[str, Any]:
    """Return a page in the form of `recorder.json`: its values, with bodies masked and ages beside times."""
    return {
        "taken_at_ns": now_ns,
        **msgspec.to_builtins(page, builtin_types=(bytes,)),
        "in_flight": [_command_as_json(note, now_ns) for note in page.in_flight],
        "finished": [_command_as_json(note, now_ns) for note in page.finished],
        "last_words": _words_as_json(page),
        "events": [structs.asdict(event) | {"text": mask_line(event.text)} for event in page.events],
    }


def _words_as_json(page: Page) -> dict[str, Any] | None:
    words = page.last_words
    return None if words is None else structs.asdict(words) | {"text": mask_line(words.text)}


def _command_as_json(note: CommandNote, now_ns: int) -> dict[str, Any]:
    return {
        **structs.asdict(note),
        "stage": note.stage.name,
        "payload": readable_payload(mask_payload(note.payload)),
        "age_ms": max(0, now_ns - note.started_ns) // 1_000_000 if note.started_ns else None,
    }


def collect_process(subject: Subject, haul: Haul, seen: list[threads.ThreadFacts]) -> None:
    """Ask psutil and /proc about the process: `process.json`."""
    try:
        process = psutil.Process(subject.pid)
        with process.oneshot():
            facts = _process_facts(subject, process)
    except (psutil.Error, OSError) as error:
        haul.missing["process.json"] = f"the kernel would not tell: {type(error).__name__}"
        return
    if not _is_ours(subject):
        # The number may belong to a stranger by now: his facts are no evidence.
        haul.missing["process.json"] = "the process was gone"
        return
    haul.files["process.json"] = as_bytes({**facts, "threads": threads.as_json(seen)})


def _process_facts(subject: Subject, process: psutil.Process) -> dict[str, Any]:
    cpu = process.cpu_times()
    return {
        "pid": subject.pid,
        "nonce": subject.nonce,
        "state": process.status(),
        "created_at_s": process.create_time(),
        "cpu_user_s": cpu.user,
        "cpu_system_s": cpu.system,
        "thread_count": process.num_threads(),
        "host_load": os.getloadavg(),
        "status": _status(subject.pid),
        "io": _pairs(_proc(subject.pid, "io")),
        "limits": _proc(subject.pid, "limits").splitlines()[1:],
        "files": _open_files(subject),
    }


def _is_ours(subject: Subject) -> bool:
    try:
        signal.pidfd_send_signal(subject.pidfd, 0)
    except OSError:
        return False
    return True


def _status(pid: int) -> dict[str, str]:
    return {name: text for name, text in _pairs(_proc(pid, "status")).items() if name in _STATUS_FIELDS}


def _pairs(text: str) -> dict[str, str]:
    return {name: value.strip() for name, _, value in (line.partition(":") for line in text.splitlines())}


def _proc(pid: int, name: str) -> str:
    try:
        with Path(f"/proc/{pid}/{name}").open("rb") as file:
            return file.read(PROC_BYTES_MAX).decode("utf-8", "replace")
    except OSError:
        return ""


def _open_files(subject: Subject) -> dict[str, Any]:
    """Return what the process has open: names inside the data folder, mere counts of everything else."""
    counts: Counter[str] = Counter()
    names: list[str] = []
    home = str(subject.data.resolve()) + "/"
    for handle in _handles(subject.pid):
        try:
            target = str(handle.readlink())
        except OSError:
            continue
        if target.startswith(home):
            counts["data"] += 1
            names.append(target.removeprefix(home))
        else:
            # "socket:[123]" and "anon_inode:[eventpoll]" say a kind; a path outside is nobody's business.
            counts["outside" if target.startswith("/") else target.partition("[")[0].rstrip(":")] += 1
    return {"count": counts.total(), "kinds": dict(counts), "in_data": sorted(names)[:OPEN_NAMES_MAX]}


def _handles(pid: int) -> list[Path]:
    try:
        return list(Path(f"/proc/{pid}/fd").iterdir())
    except OSError:
        return []


def collect_sample(subject: Subject, haul: Haul, sample: ProcessSample | None) -> None:
    """Keep the last look that the watch had at a process which is gone."""
    if sample is None:
        haul.missing["process.json"] = "the watch had not seen the process before it died"
        return
    facts: Mapping[str, Any] = {
        "pid": subject.pid,
        "nonce": subject.nonce,
        "last_sample": msgspec.to_builtins(sample),
    }
    haul.files["process.json"] = as_bytes(facts)


def collect_log(subject: Subject, haul: Haul, until_ns: int) -> None:
    """Keep the last lines of each log as `log.txt`, without what looks like a secret."""
    parts, faults = [], []
    for path in subject.logs[:LOGS_MAX]:
        if time.monotonic_ns() > until_ns:
            faults.append(f"{path.name}: the time was over")
            continue
        try:
            parts.append(f"== {path.name}\n{_tail(path)}\n")
        except OSError as error:
            faults.append(f"{path.name}: {error.strerror}")
    if parts:
        haul.files["log.txt"] = "".join(parts).encode("utf-8", "backslashreplace")
    if faults or not parts:
        haul.missing["log.txt"] = "; ".join(faults) or "the core has no log"


def _tail(path: Path) -> str:
    end, begins_before = _end_of(path, LOG_BYTES_MAX)
    if end is None:
        return "(not a plain file)"
    if not begins_before:
        with suppress(OSError):  # none older, as long as it has never been cut
            older, begins_before = _end_of(path.with_name(f"{path.name}.1"), LOG_BYTES_MAX - len(end))
            end = (older or b"") + end
    # The first line of a tail is cut somewhere, perhaps between a secret's name and its value.
    lines = end.decode("utf-8", "replace").splitlines()[1 if begins_before else 0 :]
    # Unfolded before it is masked: inside a JSON text no mask would know where a word begins.
    return "\n".join(mask_line(one) for line in lines for one in unfolded(line))


def _end_of(path: Path, count: int) -> tuple[bytes | None, bool]:
    """Return the last `count` bytes of a file, and whether it begins before them; None: it is no plain file."""
    handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        info = os.fstat(handle)
        if not stat.S_ISREG(info.st_mode):
            return None, False
        start = max(0, info.st_size - count)
        return os.pread(handle, count, start), start > 0
    finally:
        os.close(handle)
