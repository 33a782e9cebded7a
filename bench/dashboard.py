"""What a person at the dashboard waits for: each page, with as much in the archive as is ever kept.

One real incident is made (a deadlock drill: the largest story, with stacks, a ring and a recording) and its folder is
copied under new numbers as often as folders are kept; ten thousand lines of older ones and a thousand letters with
their requests stand beside them. The pages are asked for over the investigator's own socket, without a guard.
"""

import base64
import http.client
import json
import shutil
import socket
import subprocess
import sys
import time
import uuid
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Final

from msgspec.structs import replace

from bench.figures import Figure, Target
from bench.instance import ACCOUNTS, Watched, fill, transaction
from examples.guarded import GuardError
from postmortem import intake
from postmortem.bundle import Found, find_bundles
from postmortem.dead_letters import slip as slips
from postmortem.records import letters, stories
from postmortem.records.opening import Records, open_records
from postmortem.views import IncidentLine

GROUPS: Final = 2_000
PAGE_MS_MAX: Final = 100
START_S: Final = 60.0
#: So long nothing may have been written before the pages are timed: the investigator has read all folders.
SETTLED_S: Final = 3.0


def measure(
    folder: Path, *, folders: int, lines: int, held: int, rounds: int, say: Callable[[str], None]
) -> list[Figure]:
    """Fill an archive and time each page."""
    data = folder / "dashboard"
    with Watched(data) as instance:
        fill(instance, 20)
        instance.hardcore("drill", "deadlock", "--yes")
        instance.quiet()
    [real, *_] = find_bundles(data / "incidents")
    newest = _multiply(real, folders)
    records = open_records(data / "hardcore.db")
    if not isinstance(records, Records):
        raise GuardError(records.reason)
    with closing(records):
        letter = _fill(records, real, lines, held)
    say(f"  {folders} folders, {lines:,} lines, {held:,} letters are there")
    pages = {
        "now": "",
        "incidents, in groups": "incidents",
        "incidents, all": "incidents?view=all",
        "one incident": f"incidents/{newest}",
        "letters": "dlq",
        "letters of an account": f"dlq?account={ACCOUNTS[1]}",
        "one letter": f"dlq/{letter}",
        "evidence": "snapshots",
        "trends": "trends",
        "settings": "settings",
    }
    path = folder / "i.sock"
    argv = [sys.executable, "-I", "-m", "postmortem", "serve", "--data", str(data), "--socket", str(path)]
    process = subprocess.Popen([*argv, "--control", str(folder / "nobody.sock")], stderr=subprocess.DEVNULL)
    try:
        _settle(data / "hardcore.db-wal", path)
        return [
            Figure(name, "ms", tuple(_ask(path, page) for _ in range(rounds)), target=Target(PAGE_MS_MAX))
            for name, page in pages.items()
        ]
    finally:
        process.terminate()
        process.wait()


def _multiply(real: Found, folders: int) -> str:
    """Copy an incident's folder under new numbers; return the last of them."""
    made = real.id
    for number in range(1, folders):
        made = str(uuid.UUID(int=uuid.UUID(real.id).int + (number << 80)))
        copy = real.path.with_name(made)
        shutil.copytree(real.path, copy)
        manifest = copy / "manifest.json"
        manifest.write_text(manifest.read_text("utf-8").replace(real.id, made), "utf-8")
    return made


def _fill(records: Records, real: Found, lines: int, held: int) -> str:
    """Write lines like that of the real incident, each of GROUPS kinds, and letters; return one of the letters."""
    like = intake.read_story(real)
    at = time.time()
    with records.writing() as connection:
        for number in range(lines):
            opened_at = _moment(at - 600 * (number + 1))
            line: IncidentLine = replace(
                like.line, id=f"old-{number:06}", opened_at=opened_at, closed_at=opened_at, drill=None,
                fingerprint=f"{number % GROUPS:016x}",
            )  # fmt: skip
            stories.put(connection, replace(like, line=line), "gone")
        for number in range(held):
            letter = slips.letter(_letter(number, _moment(at - 60 * number)))
            assert letter is not None, "a letter of ours can be read"
            letters.take(connection, letter)
    return str(_letter(0, "")["id"])


def _letter(number: int, at: str) -> dict[str, object]:
    body = base64.b64encode(json.dumps(transaction(f"letter {number}")).encode()).decode()
    headers = [["Content-Type", "application/json"]]
    request = {"method": "POST", "path": "/api/ledger/transactions", "headers": headers, "body": body}
    return {
        "id": f"letter-{number:05}", "state": "QUARANTINED", "reason": "CRASHED_CORE", "name": f"{number:032x}",
        "idempotency_key": f"key-{number}", "kind": "transaction.post", "source": "peer:127.0.0.1",
        "account_ids": list(ACCOUNTS), "deaths": 1, "quarantined_at": at, "case": {"request": request},
        "trial": {"ordeal": "died", "exit": {"signal": 11}},
    }  # fmt: skip


def _moment(at_s: float) -> str:
    return time.strftime("%Y-%m-%dT%H:%M:%S.000Z", time.gmtime(at_s))


def _settle(log: Path, path: Path) -> None:
    """Wait until the investigator listens and has read what is new. Raises GuardError."""
    give_up_at = time.monotonic() + START_S
    last, since = -1, time.monotonic()
    while time.monotonic() < give_up_at:
        now = log.stat().st_mtime_ns if log.exists() else -1
        if now != last:
            last, since = now, time.monotonic()
        if path.exists() and time.monotonic() - since > SETTLED_S:
            return
        time.sleep(0.05)
    raise GuardError("The investigator did not come to rest.")


def _ask(path: Path, page: str) -> float:
    """Ask for one page; return how long that took, in ms. Raises GuardError for another answer than the page."""
    connection = http.client.HTTPConnection("localhost", timeout=30)
    with socket.socket(socket.AF_UNIX) as connection.sock:
        began_ns = time.perf_counter_ns()
        connection.sock.connect(str(path))
        connection.request("GET", f"/admin/{page}", headers={"X-Admin": "1", "Connection": "close"})
        answer = connection.getresponse()
        answer.read()
        took_ms = (time.perf_counter_ns() - began_ns) / 1e6
    if answer.status != http.client.OK:
        raise GuardError(f"/admin/{page} was answered with {answer.status}.")
    return took_ms
