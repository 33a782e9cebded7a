"""The core's suspended tasks: asked of the core itself, because nobody sees them from outside.

A suspended task has no thread, so no debugger of threads knows of it; but while tasks are only suspended the
loop lives, and the loop can be asked over the core's own control socket. A loop that does not beat is not
asked: then the guilty frame is one that runs, and the stacks show it. What the core says is read as a
stranger's word: bounded, and each value only where it has the form of what it claims to be.
"""

import json
import re
import socket
import time
from pathlib import Path
from typing import Any

from hardcore.host.recorder import PageReader
from hardcore.snapshot.form import as_bytes
from hardcore.snapshot.masking import MASK, is_id
from hardcore.snapshot.subject import Haul, Subject

ANSWER_BYTES_MAX = 128 << 10
TASKS_MAX = 1_000
#: A loop whose last beat is older is not asked.
BEAT_AGE_MS_MAX = 250

_PLACE = re.compile(r"(?:[\w.-]+/){0,3}[\w<>.-]{1,60}:\d{1,7} [\w<>]{1,80}")


def collect_tasks(subject: Subject, haul: Haul, until_ns: int) -> None:
    """Write `tasks.json`: the suspended tasks, or why the loop was not asked."""
    now_ns = time.monotonic_ns()
    if subject.control is None or not _loop_lives(subject, now_ns):
        why = "the loop did not beat" if subject.control is not None else "no control socket is known"
        haul.files["tasks.json"] = as_bytes({"asked": False, "why": why})
        return
    answer = ask(subject.control, until_ns)
    if isinstance(answer, str):
        haul.missing["tasks.json"] = answer
    else:
        haul.files["tasks.json"] = as_bytes({"asked": True, **answer})


def ask(control: Path, until_ns: int) -> dict[str, Any] | str:
    """Return the core's suspended tasks with their count, or why they can't be had until `until_ns`."""
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as door:
            door.settimeout(_left_s(until_ns))
            door.connect(bytes(control))
            door.sendall(b'{"verb": "tasks"}\n')
            raw = _line(door, until_ns)
    except TimeoutError:
        return "the core did not answer in time"
    except OSError as error:
        return f"the core could not be asked: {error.strerror or type(error).__name__}"
    if not raw.endswith(b"\n"):
        return "the core's answer had no end"
    try:
        told = json.loads(raw)
    except (ValueError, RecursionError):
        return "the core's answer was not in the form known here"
    if not isinstance(told, dict) or told.get("ok") is not True or not isinstance(told.get("tasks"), list):
        return "the core's answer was not in the form known here"
    tasks = [_task(task) for task in told["tasks"][:TASKS_MAX] if isinstance(task, dict)]
    count = told.get("count")
    return {"count": count if isinstance(count, int) else len(tasks), "tasks": tasks}


def _line(door: socket.socket, until_ns: int) -> bytes:
    raw = bytearray()
    while len(raw) < ANSWER_BYTES_MAX and not raw.endswith(b"\n"):
        door.settimeout(_left_s(until_ns))
        part = door.recv(1 << 16)
        if not part:
            break
        raw += part
    return bytes(raw)


def _task(raw: dict[str, Any]) -> dict[str, str]:
    place = str(raw.get("waits_at", ""))
    told = {"waits_at": place if _PLACE.fullmatch(place) else MASK if place else ""}
    for name in ("name", "transaction_id", "account_id"):
        text = str(raw.get(name, ""))
        told[name] = text if not text or is_id(text) else MASK
    return told


def _loop_lives(subject: Subject, now_ns: int) -> bool:
    reader = PageReader(subject.recorder, subject.nonce)
    try:
        beats = reader.beats()
    finally:
        reader.close()
    return beats is not None and now_ns - beats.loop_ns < BEAT_AGE_MS_MAX * 1_000_000


def _left_s(until_ns: int) -> float:
    # Not 0: that would mean "do not wait", and an answer that is there would be missed.
    return max(0.001, (until_ns - time.monotonic_ns()) / 1e9)
