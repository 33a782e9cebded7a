"""The instance that is measured: the one of the examples, looked at without weighing on what is measured.

`hardcore status` costs a third of a second of a processor, which is fine for a person and not beside a
stopwatch; here the same question goes to the control socket directly. What has to be over before the next
round may begin (the report of the last incident is written by a process of its own) is waited for.
"""

import json
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from examples.guarded import Guarded, GuardError
from examples.line import Answer, Line
from hardcore.control import client
from hardcore.host.folders import locate
from hardcore.status import from_files

#: More deaths than a guard would put up with are the point here; and a short probation saves time.
POLICY = {"max_restart_count": 1000, "probation_ms": 200}
REPORT_S = 20.0
COMEBACK_S = 60.0
ACCOUNTS = ("assets:bank", "expenses:food")
ONE_ACCOUNT = f"/api/ledger/accounts/{ACCOUNTS[0]}"
TRANSACTIONS = "/api/ledger/transactions"
LOOK_EVERY_S = 0.01
#: What the guard's table calls it when it knows: an end, a verdict, a trouble that ends nobody.
NOTICED = frozenset({"EXITED", "LOST", "TROUBLED"})


class Watched(Guarded):
    """An instance under measurement."""

    def __init__(self, data: Path, policy: Mapping[str, object] | None = None) -> None:
        """Prepare; `policy` names what differs from that of all measurements."""
        super().__init__(data, {**POLICY, **(policy or {})})
        self.folders = locate(data)

    def status(self) -> dict[str, Any]:
        """Return the status, asked at the control socket."""
        try:
            return client.ask(self.folders.control, {"verb": "status"})
        except client.Unreachable:
            return from_files(self.folders)

    def quiet(self) -> None:
        """Wait until nothing of the last incident is under way any more."""
        last = self.running()["last_incident"]
        report = self.folders.incidents / str(last) / "report.md"
        give_up_at = time.monotonic() + REPORT_S
        while last and not report.exists():
            if time.monotonic() > give_up_at:
                raise GuardError(f"The report of {last} is not written after {REPORT_S:g} s.")
            time.sleep(LOOK_EVERY_S)

    def until_later(self, epoch: int) -> None:
        """Wait until a core of a later epoch serves."""
        self.until(lambda told: (told["core"]["epoch"] or 0) > epoch, "the next core", COMEBACK_S)

    def core_socket(self) -> Path:
        """Return the socket of the serving core: the youngest."""
        return max(self.folders.run.glob("core-*.sock"), key=lambda path: path.stat().st_ctime_ns)

    def last_exit_ns(self) -> int:
        """Return when the guard last saw a core end, by its own log."""
        lines = (self.folders.logs / "sentinel.log").read_text("utf-8").splitlines()
        notes = [json.loads(line) for line in lines]
        return max(
            int(note["at_ns"]) for note in notes if note["kind"] == "phase" and note["trigger"] == "EXITED"
        )

    def noticed_ns(self, after_ns: int) -> int:
        """Return when the guard first knew of a fault that was made at `after_ns`, by its own log."""
        lines = (self.folders.logs / "sentinel.log").read_text("utf-8").splitlines()
        notes = [json.loads(line) for line in lines]
        return min(
            int(note["at_ns"])
            for note in notes
            if note["kind"] == "phase" and note["trigger"] in NOTICED and note["at_ns"] >= after_ns
        )

    def last_timeline(self) -> dict[str, float]:
        """Return how long after the fault each step of the last incident came, in ms."""
        last = self.folders.incidents / str(self.status()["last_incident"]) / "incident.json"
        steps = json.loads(last.read_text("utf-8"))["timeline"]
        return {step["step"]: step["offset_ms"] for step in steps}


def transaction(words: str) -> dict[str, Any]:
    """Return the body of an ordinary small transaction."""
    amounts = zip(ACCOUNTS, ("-12000", "12000"), strict=True)
    lines = [{"account": account, "amount": amount, "currency": "KRW"} for account, amount in amounts]
    return {"date": "2026-11-21", "description": words, "postings": lines}


def fill(instance: Watched, transactions: int) -> None:
    """Open the accounts and book so many transactions. Raises GuardError when it can't be done."""
    with Line(instance.address) as line:
        for account in ACCOUNTS:
            kind = "asset" if account.startswith("assets") else "expense"
            body = {"id": account, "name": account, "type": kind, "currency": "KRW"}
            _done(line.post("/api/ledger/accounts", body, f"open {account}".replace(" ", "-")))
        for number in range(transactions):
            _done(line.post(TRANSACTIONS, transaction("filling"), f"fill-{number}"))


def _done(answer: object) -> None:
    if not isinstance(answer, Answer) or not answer.good:
        raise GuardError(f"The ledger could not be filled: {answer}")
