"""The drills: break the running system on purpose, wait for what should come of it, and tell how it went.

Each fault is a real one, and each has one outcome that its table below promises. A drill that turns out
otherwise is a finding: exit code 1, and the incident to look at. `gc` is the other kind of drill: it makes a
healthy core look ill, and passes if nobody does anything about it.
"""

import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import click

from hardcore.asked import LOOK_EVERY_S, Asked, come_back, operator, status_of
from hardcore.control.protocol import DRILLS
from hardcore.looking_back import told_incident

#: A collection over some millions of objects is over after a few seconds; so long nobody may have acted.
PEACE_S = 12.0
#: The longest way back: a transaction's whole time, a full disk's first tries, a restart and its probation.
BACK_S = 120.0


@dataclass(frozen=True, slots=True)
class Promise:
    """What a drill must lead to."""

    diagnosis: str
    outcome: str = "recovered"


PROMISES: Mapping[str, Promise] = {
    "crash": Promise("CRASHED"),
    "segv": Promise("CRASHED"),
    "exit": Promise("EXITED"),
    "freeze": Promise("FROZEN"),
    "block": Promise("LOOP_BLOCKED"),
    "spin": Promise("SPINNING"),
    "gil": Promise("GIL_HELD"),
    "deadlock": Promise("DEADLOCK"),
    "slow-tx": Promise("TRANSACTION_TIMEOUT"),
    "oom": Promise("OUT_OF_MEMORY"),
    "dblock": Promise("DB_LOCKED"),
    "diskfull": Promise("DISK_FULL", "safe_mode"),
}


@click.command()
@click.argument("fault", metavar="FAULT", type=click.Choice(list(DRILLS)))
@click.option("--yes", is_flag=True, help="Even while others are connected.")
@operator
def drill(asked: Asked, fault: str, *, yes: bool) -> None:
    """Break the core on purpose, wait for it to come back, and tell how it went.

    \b
    crash segv exit     it dies: by abort, by a bad memory access, by leaving
    freeze block        it stands still: the whole process, its event loop
    spin gil            it computes for ever, or holds the interpreter in C
    deadlock slow-tx    the writer: two locks in a circle, a transaction without end
    oom                 it takes memory until the kernel ends it (needs a memory cgroup)
    dblock              another process holds the ledger's lock: told, nothing is killed
    diskfull            the disk takes no write: reads go on, writes wait for room
    gc                  a long garbage collection: nothing may happen
    """  # noqa: D301  # the escape is click's own mark for a block that is not refilled
    before = status_of(asked).get("last_incident")
    asked.ask(verb="drill", fault=fault, yes=yes)
    asked.say("drill_begins" if fault in PROMISES else "drill_begins_peaceful", fault=fault)
    if fault not in PROMISES:
        _stays_calm(asked, before)
        return
    told = come_back(asked, lambda told: told["last_incident"] != before and told["incident"] is None, BACK_S)
    story = told_incident(asked, str(told["last_incident"]))
    kept = (story["diagnosis"], story["outcome"]) == (PROMISES[fault].diagnosis, PROMISES[fault].outcome)
    asked.say(_verdict(story, kept=kept), **_particulars(story))
    asked.tell({"ok": kept, "incident": story["id"], "story": story})
    sys.exit(0 if kept else 1)


def _verdict(story: Mapping[str, Any], *, kept: bool) -> str:
    if not kept:
        return "drill_other"
    return "drill_done" if story["outage_ms"] is not None else "drill_done_serving"


def _particulars(story: Mapping[str, Any]) -> dict[str, object]:
    return {
        "diagnosis": story["diagnosis"],
        "outcome": story["outcome"],
        "detected": story["detected_ms"],
        "outage": story["outage_ms"],
        "incident": story["id"],
    }


def _stays_calm(asked: Asked, before: object) -> None:
    """Watch for a while; the drill has failed if anything was done to the core."""
    core = status_of(asked)["core"]["pid"]
    give_up_at = time.monotonic() + PEACE_S
    while time.monotonic() < give_up_at:
        told = status_of(asked)
        if told["core"]["pid"] != core or told["last_incident"] != before:
            asked.fail(asked.words("drill_disturbed", incident=told["last_incident"] or told["incident"]))
        time.sleep(LOOK_EVERY_S)
    asked.say("drill_calm")
    asked.tell({"ok": True, "incident": None, "story": None})
