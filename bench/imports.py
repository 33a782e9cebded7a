"""How fast a bank's file is booked, and what everybody else waits meanwhile.

One file is imported twice: row by row, as after a death (a drill is armed for a row that no file has, so that every row
must have a name of its own), and in waves. Beside both somebody books and reads as people do, and is watched; what he
waits while nothing is imported is the baseline. How far an import is, is asked as its page asks it.
"""

import hashlib
import http.client
import json
import threading
import time
import uuid
from collections.abc import Callable
from pathlib import Path
from typing import Any

from bench.figures import Baseline, Figure, Target
from bench.instance import ACCOUNTS, ONE_ACCOUNT, TRANSACTIONS, Watched, fill, transaction
from examples.guarded import GuardError
from examples.line import Line
from hardcore.quarantine_file import arm, disarm

HEADER = "거래일시,적요,출금액,입금액,잔액"
IMPORTS = "/api/ledger/imports"
OVER_S = 600.0
LOOK_EVERY_S = 0.1
PAUSE_S = 0.02
QUIET_S = 5.0
WHOLE_S = 30.0  # for 100,000 rows
OTHERS_MS = 50.0
NAME_DIGITS = 32
LATE = 0.95


def measure(folder: Path, *, rows: int, one_by_one: int, say: Callable[[str], None]) -> list[Figure]:
    """Import so many rows in waves, and fewer row by row; return how long each took and what others waited."""
    with Watched(folder / "imports") as instance:
        fill(instance, 0)
        none = hashlib.sha256(b"no row is called so").hexdigest()[:NAME_DIGITS]
        arm(instance.folders, none)
        instance.hardcore("restart")
        slow_s, slow_ms = _watched(instance, lambda line: _import(instance, line, one_by_one, "single"))
        disarm(instance.folders, none)
        instance.hardcore("restart")
        _, quiet_ms = _watched(instance, lambda _: time.sleep(QUIET_S))
        took_s, others_ms = _watched(instance, lambda line: _import(instance, line, rows, "wave"))
    say(f"  {rows:,} rows at {rows / took_s:,.0f}/s in waves, {one_by_one / slow_s:,.0f}/s row by row")
    return [
        Figure(
            f"{rows:,} rows in waves",
            "s",
            (took_s,),
            Baseline("as many row by row", (slow_s * rows / one_by_one,)),
            Target(WHOLE_S * rows / 100_000),
        ),
        Figure(
            "others meanwhile (95th percentile)",
            "ms",
            (others_ms,),
            Baseline("nothing is imported", (quiet_ms,)),
            Target(OTHERS_MS),
        ),
        Figure("others beside row by row (95th percentile)", "ms", (slow_ms,)),
    ]


def _watched(instance: Watched, work: Callable[[Line], object]) -> tuple[float, float]:
    """Do this while somebody else books and reads; return how long it took (s), and what he waited (ms)."""
    over, waits = threading.Event(), list[float]()
    other = threading.Thread(target=_ask_on, args=(instance, over, waits))
    other.start()
    began = time.monotonic()
    try:
        with Line(instance.address) as line:
            work(line)
        took_s = time.monotonic() - began
    finally:
        over.set()
        other.join()
    return took_s, sorted(waits)[int(len(waits) * LATE)]


def _ask_on(instance: Watched, over: threading.Event, waits: list[float]) -> None:
    with Line(instance.address) as line:
        while not over.wait(PAUSE_S):
            began = time.perf_counter()
            answer = line.post(TRANSACTIONS, transaction("beside"), uuid.uuid4().hex)
            booked = time.perf_counter()
            line.get(ONE_ACCOUNT)
            if not answer.good:
                raise GuardError(f"Somebody else was refused: {answer}")
            waits += [(booked - began) * 1_000, (time.perf_counter() - booked) * 1_000]


def _import(instance: Watched, line: Line, rows: int, mark: str) -> None:
    made = _upload(instance, rows, mark)
    line.post(f"{IMPORTS}/{made}/commit", {}, f"commit-{made}")
    give_up_at = time.monotonic() + OVER_S
    while time.monotonic() < give_up_at:
        told = line.get(f"{IMPORTS}/{made}")
        shown = getattr(told, "body", {}) if told.good else {}
        if shown.get("state") in {"done", "failed"}:
            if shown["rows"]["new"] != rows:
                raise GuardError(f"Not every row was booked: {shown['rows']}")
            return
        time.sleep(LOOK_EVERY_S)
    raise GuardError(f"The import is not over after {OVER_S:g} s.")


def _upload(instance: Watched, rows: int, mark: str) -> str:
    balance, lines = 1_000_000_000, [HEADER]
    for n in range(rows):
        balance -= 100 + n % 7
        lines.append(f"2026-03-{n % 28 + 1:02d} 09:00:00,{mark}-{n},{100 + n % 7},0,{balance}")
    edge = uuid.uuid4().hex
    head = f'--{edge}\r\nContent-Disposition: form-data; name="account"\r\n\r\n{ACCOUNTS[0]}\r\n--{edge}\r\n'
    named = 'Content-Disposition: form-data; name="file"; filename="bank.csv"\r\n\r\n'
    body = f"{head}{named}".encode() + "\n".join(lines).encode() + f"\r\n--{edge}--\r\n".encode()
    connection = http.client.HTTPConnection(*instance.address, timeout=OVER_S)
    try:
        connection.request("POST", IMPORTS, body, {"Content-Type": f"multipart/form-data; boundary={edge}"})
        answer = connection.getresponse()
        told: Any = json.loads(answer.read())
    finally:
        connection.close()
    if answer.status != http.client.CREATED:
        raise GuardError(f"The file was not taken: {told}")
    return str(told["id"])
