"""What a poison among the rows of a bank's file costs: that row, one death, and nothing of the rest.

The file is uploaded, one row in its middle is armed (the core reads that when it begins, so it is changed for another
once), and the import is begun. All other rows have to be booked, once each.
"""

import hashlib
import http.client
import json
import time
import uuid
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from bench.crowd import NONE
from bench.figures import Figure, Target
from bench.instance import ACCOUNTS, Watched, fill
from examples.guarded import GuardError
from examples.line import Line
from examples.reading import read_ledger
from hardcore.quarantine_file import arm

HEADER = "거래일시,적요,출금액,입금액,잔액"
IMPORTS = "/api/ledger/imports"
OVER_S = 300.0
LOOK_EVERY_S = 0.1
NAME_DIGITS = 32


def measure(folder: Path, *, rows: int, say: Callable[[str], None]) -> list[Figure]:
    """Import so many rows, one of them poison; return what was refused, lost, doubled, and how often the core died."""
    with Watched(folder / "row") as instance:
        fill(instance, 0)
        made = _upload(instance, rows)
        poison = f"{made}:{rows // 2}"
        arm(instance.folders, hashlib.sha256(poison.encode()).hexdigest()[:NAME_DIGITS])
        instance.hardcore("restart")
        before = int(instance.running()["core"]["epoch"])
        with Line(instance.address) as line:
            began = time.monotonic()
            line.post(f"{IMPORTS}/{made}/commit", {}, f"commit-{made}")
            told = _done(line, made)
            took_s = time.monotonic() - began
            booked = Counter(str(event["key"]) for event in read_ledger(line).events)
        deaths = int(instance.running()["core"]["epoch"]) - before
    say(f"  {told['rows']}; refused: {[(one['line'], one['reason']) for one in told['problems']]}")
    keys = [f"{made}:{n}" for n in range(1, rows + 1)]
    return [
        Figure("deaths", "", (deaths,), target=Target(1)),
        Figure(
            f"rows refused of {rows:,}, one poison", "", (int(told["rows"]["refused"]),), target=Target(1)
        ),
        Figure(
            "other rows that are not booked", "", (sum(not booked[key] for key in keys) - 1,), target=NONE
        ),
        Figure("rows booked twice", "", (sum(booked[key] > 1 for key in keys),), target=NONE),
        Figure("the whole import", "s", (took_s,)),
    ]


def _upload(instance: Watched, rows: int) -> str:
    balance, lines = 100_000_000, [HEADER]
    for n in range(rows):
        balance -= 100 + n % 7
        lines.append(f"2026-03-{n % 28 + 1:02d} 09:00:00,row-{n},{100 + n % 7},0,{balance}")
    edge = uuid.uuid4().hex
    head = f'--{edge}\r\nContent-Disposition: form-data; name="account"\r\n\r\n{ACCOUNTS[0]}\r\n--{edge}\r\n'
    named = 'Content-Disposition: form-data; name="file"; filename="bank.csv"\r\n\r\n'
    body = f"{head}{named}".encode() + "\n".join(lines).encode() + f"\r\n--{edge}--\r\n".encode()
    connection = http.client.HTTPConnection(*instance.address, timeout=OVER_S)
    try:
        connection.request("POST", IMPORTS, body, {"Content-Type": f"multipart/form-data; boundary={edge}"})
        answer = connection.getresponse()
        told = json.loads(answer.read())
    finally:
        connection.close()
    if answer.status != http.client.CREATED:
        raise GuardError(f"The file was not taken: {told}")
    return str(told["id"])


def _done(line: Line, made: str) -> Any:
    """Wait for the end of the import; return what it tells then."""
    give_up_at = time.monotonic() + OVER_S
    while time.monotonic() < give_up_at:
        told = line.get(f"{IMPORTS}/{made}")
        if told.good and (shown := getattr(told, "body", {})).get("state") in {"done", "failed"}:
            return shown
        time.sleep(LOOK_EVERY_S)
    raise GuardError(f"The import is not over after {OVER_S:g} s.")
