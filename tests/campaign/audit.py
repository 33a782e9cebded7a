"""The invariants, held against a house that has come to rest: by its ledger, its incidents and its processes.

The truth comes from outside the guard: what clients were told, what the ledger's own events say, what the kernel says
of processes. Where several faults fell into one run the audit allows what each of them may have caused, and nothing
else.
"""

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Final

from postmortem import bundle
from tests.campaign.faults import CORE, FAULTS, GATEWAY, SENTINEL, SPARE, Fault
from tests.integration.clients import Clients, assert_exactly_once
from tests.integration.house import START_S, House
from tests.waiting import until

#: What one of ours may have grown by over a whole campaign.
FDS_MORE_MAX: Final = 40
MEMORY_MORE_MAX_BYTES: Final = 64 << 20
EVENTS_A_PAGE: Final = 500
LONG_READS: Final = ("/api/ledger/transactions?limit=500", "/api/ledger/verify")
#: A switch that somebody asked for needs no diagnosis of a fault.
ALWAYS_CALLED: Final = frozenset({"OPERATOR", "PLANNED_SWITCH"})
#: What an operator asks for, and drills: the guard's own memory of them ends with it.
ORDERS: Final = frozenset(f.name for f in FAULTS if f.name.startswith(("restart", "drill")))
#: It waits for a spare, which may only come once we have looked.
AWAITS_SPARE: Final = frozenset({"restart"})
#: Who of ours is told of by an incident of its own, whatever the core does meanwhile.
LOST: Final = {SENTINEL: "SENTINEL_LOST", GATEWAY: "GATEWAY_LOST"}


class Broken(Exception):  # noqa: N818  # it is a law that broke, not an error of ours
    """An invariant does not hold; the text says which and how."""


def hold(kept: object, law: str) -> None:
    """Raise Broken with the law in words if it is not kept."""
    if not kept:
        raise Broken(law)


@dataclass(frozen=True)
class Before:
    """What was true before a run."""

    incidents: frozenset[str]
    epoch: int
    seq: int


@dataclass
class Audit:
    """Looks at one house, run after run."""

    house: House
    stranger: "subprocess.Popen[bytes]"
    _grown: dict[tuple[str, int], tuple[int, int]] = field(default_factory=dict)

    def before(self) -> Before:
        """Remember what is true now."""
        core = self.house.status()["core"]
        return Before(
            frozenset(item["id"] for item in self.house.incidents()), core["epoch"], core["last_seq"] or 0
        )

    def after(
        self, before: Before, hit: Sequence[Fault], clients: Clients
    ) -> list[tuple[str, int | None, int | None]]:
        """Hold every invariant against the house as it is now. Raises Broken, or AssertionError."""
        hold(all(told.status == 201 for told in clients.told), "(5) every request is answered in the end")
        # A core that still collects millions of objects may give a long read up; it is asked again until it has done so.
        until(self._reads_in_peace, "the ledger to be read", START_S)
        assert_exactly_once(self.house, clients)
        verdict = self.house.ask("GET", "/api/ledger/verify").body
        hold(verdict.get("ok"), f"(3) the ledger is whole: {verdict}")
        self._epochs(before, hit)
        hold(not self._rules(), f"(15) nobody innocent is set aside: {self._rules()}")
        hold(self.stranger.poll() is None, "(13) nobody outside our own process tree is signalled")
        hold(self.house.status().get("wanted") == "UP", "(11) what the operator wants holds")
        self._bounded()
        return self._incidents(before, hit)

    def _reads_in_peace(self) -> bool:
        """Whether the longest reads are answered, some of them in a row."""
        return all(self.house.ask("GET", path).status == 200 for path in (*LONG_READS, *LONG_READS))

    def _epochs(self, before: Before, hit: Sequence[Fault]) -> None:
        """Commits never go back to an epoch, and no core ended but by what was done to it."""
        events, after = [], before.seq
        while True:
            page = self.house.ask("GET", f"/api/ledger/events?after={after}&limit={EVENTS_A_PAGE}")
            items = page.body["items"]
            if not items:
                break
            events += [item["epoch"] for item in items]
            after = items[-1]["seq"]
        hold(events == sorted(events), "(4) commits never go back to a lower epoch")
        now = self.house.status()["core"]["epoch"]
        may_end = sum(CORE in fault.ends for fault in hit)
        # A guard that is lost in the middle of a switch may leave a core that had begun to write and served nobody.
        lost = sum(SENTINEL in fault.ends for fault in hit) if may_end else 0
        hold(
            now - before.epoch <= may_end + lost,
            f"(8) no healthy core is ended: {now - before.epoch} new epochs after {[f.name for f in hit]}",
        )

    def _rules(self) -> list[Any]:
        told = self.house.order("quarantine").get("quarantine")
        return list(told.get("rules", [])) if isinstance(told, dict) else [told]

    def _bounded(self) -> None:
        """Neither guard nor gateway grows from run to run."""
        status = self.house.status()
        for who in ("sentinel", "gateway"):
            pid = status[who]["pid"]
            fds, memory = _weight(pid)
            first = self._grown.setdefault((who, pid), (fds, memory))
            hold(fds - first[0] <= FDS_MORE_MAX, f"(10) {who} keeps descriptors: {first[0]} to {fds}")
            hold(
                memory - first[1] <= MEMORY_MORE_MAX_BYTES, f"(10) {who} keeps memory: {first[1]} to {memory}"
            )

    def _incidents(self, before: Before, hit: Sequence[Fault]) -> list[tuple[str, int | None, int | None]]:
        allowed = ALWAYS_CALLED.union(*(fault.called for fault in hit))
        until(lambda: all(item["closed_at"] for item in self._new(before)), "every incident to end", START_S)
        new = self._new(before)
        for item in new:
            hold(
                item["diagnosis"] in allowed,
                f"(8) nothing is called what it was not: {item['diagnosis']} after {[f.name for f in hit]}",
            )
            folder = self.house.folders.incidents / item["id"]
            until(partial(_reported, folder), f"(6) a report of {item['id']}", START_S)
        if any(fault.name == "kill all" for fault in hit):
            # Nobody was left to see who ended of what: that nobody watched is told, and what else is found out.
            hold(new, "(6) all were killed and nobody told of it")
            return [(item["diagnosis"], item["detected_ms"], item["outage_ms"]) for item in new]
        lasting = [fault for fault in hit if not _undone(fault, hit)]
        for who, lost in LOST.items():
            struck = [fault.name for fault in lasting if lost in fault.called]
            found = [item for item in new if item["diagnosis"] == lost]
            hold(found or not struck, f"(6) {struck} ended the {who} and left no {lost}")
        # What was asked of a guard that died before it was done is a wish nobody remembers, and no incident.
        forgotten = ORDERS if any(SENTINEL in fault.ends for fault in hit) else frozenset()
        if any(SPARE in fault.ends for fault in hit):
            forgotten |= AWAITS_SPARE
        struck = [f.name for f in lasting if f.called - set(LOST.values()) and f.name not in forgotten]
        # Struck in the same moment as its guard, it was seen by nobody: one incident tells of both, and of the outage.
        found = [item for item in new if item["diagnosis"] not in LOST.values() or _tells_of_both(item)]
        hold(found or not struck, f"(6) {struck} left no incident of the core")
        return [(item["diagnosis"], item["detected_ms"], item["outage_ms"]) for item in new]

    def _new(self, before: Before) -> list[dict[str, Any]]:
        return [item for item in self.house.incidents() if item["id"] not in before.incidents]


def _tells_of_both(item: dict[str, Any]) -> bool:
    return item["diagnosis"] == LOST[SENTINEL] and item["outage_ms"] is not None


def _undone(fault: Fault, hit: Sequence[Fault]) -> bool:
    """Whether another blow of the run may have let go on whom this one had stopped."""
    return fault.name.startswith("freeze ") and any(
        other.thaws and fault.name.endswith(other.thaws) for other in hit
    )


def _reported(folder: Path) -> bool:
    told = bundle.read_manifest(folder)
    return not isinstance(told, bundle.BundleFailed) and "report.md" in told.files


def _weight(pid: int) -> tuple[int, int]:
    """Return how many descriptors a process has, and its resident bytes."""
    fds = len(os.listdir(f"/proc/{pid}/fd"))  # noqa: PTH208  # only counted
    pages = int(Path(f"/proc/{pid}/statm").read_text("ascii").split()[1])
    return fds, pages * os.sysconf("SC_PAGE_SIZE")


def bystander() -> "subprocess.Popen[bytes]":
    """Start a process that is none of the house's and looks as if it might be: nobody may signal it."""
    words = "import signal; signal.pause()  # core serve hardcore.runtime hardcore.crisis"
    return subprocess.Popen([sys.executable, "-I", "-c", words], start_new_session=True)


def dismiss(stranger: "subprocess.Popen[bytes]") -> None:
    """End the bystander."""
    with contextlib.suppress(ProcessLookupError):
        stranger.send_signal(signal.SIGKILL)
    stranger.wait(10)
