"""The drills: break the running system on purpose, wait for what should come of it, and tell how it went.

Each fault is a real one, and each has one outcome that its table below promises. A drill that turns out
otherwise is a finding: exit code 1, and the incident to look at. `gc` is the other kind of drill: it makes a
healthy core look ill, and passes if nobody does anything about it. `spare` kills the core that waits: another one has
to come, and the one that serves must not notice.
"""

import sys
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import click

from frontend.catalogue import spare_lack
from frontend.catalogue_drills import done_words, promised_words
from hardcore.asked import LOOK_EVERY_S, Asked, come_back, next_words, operator, status_of
from hardcore.control.protocol import DRILLS, PEACE_S
from hardcore.looking_back import told_incident

#: The longest way back: a transaction's whole time, a full disk's first tries, a restart and its probation.
BACK_S = 120.0
#: A spare starts at low priority and may take as long as any start.
SPARE_S = 90.0
#: Noticed sooner than this is noticed by no watch: the core has said so itself.
AT_ONCE_MS = 0.05


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
    spare               the core that waits is killed: another comes, nobody notices
    """  # noqa: D301  # the escape is click's own mark for a block that is not refilled
    first = status_of(asked)
    before = first.get("last_incident")
    asked.ask(verb="drill", fault=fault, yes=yes)
    promised = promised_words(fault, asked.lang)
    asked.say("drill_begins", fault=fault, done=done_words(fault, asked.lang), promised=promised)
    if fault == "spare":
        _another_waits(asked, first)
        return
    if fault not in PROMISES:
        _stays_calm(asked, before)
        return
    told = come_back(asked, lambda told: told["last_incident"] != before and told["incident"] is None, BACK_S)
    if told["last_incident"] == before:
        asked.fail(asked.words("drill_untold", next=next_words(told, asked.lang)))
    story = told_incident(asked, str(told["last_incident"]))
    kept = (story["diagnosis"], story["outcome"]) == (PROMISES[fault].diagnosis, PROMISES[fault].outcome)
    asked.say(
        "drill_kept" if kept else "drill_other",
        promised=promised,
        summary=story["summary"],
        by=asked.words(way_back(story)),
        detected=noticed(asked, story["detected_ms"]),
        incident=story["id"],
    )
    asked.tell({"ok": kept, "incident": story["id"], "promised": asdict(PROMISES[fault]), "story": story})
    sys.exit(0 if kept else 1)


def way_back(story: Mapping[str, Any]) -> str:
    """Return the name of the text that says who serves since: the spare, a core that was started, or the same one."""
    steps = {step["step"] for step in story["timeline"]}
    if "spawned" in steps:  # also after a spare that took over and failed
        return "back_by_start"
    return "back_by_spare" if "promoted" in steps else "back_by_itself"


def noticed(asked: Asked, detected_ms: float | None) -> str:
    """Return when a fault was noticed, in words: one that the core tells itself is known as soon as it is there."""
    if detected_ms is None:
        return asked.words("noticed_untold")
    if detected_ms < AT_ONCE_MS:
        return asked.words("noticed_at_once")
    return asked.words("noticed_after", ms=f"{detected_ms:.1f}")


def _stays_calm(asked: Asked, before: object) -> None:
    """Watch for a while; the drill has failed if anything was done to the core."""
    core = status_of(asked)["core"]["pid"]
    give_up_at = time.monotonic() + PEACE_S
    while time.monotonic() < give_up_at:
        told = status_of(asked)
        if told["core"]["pid"] != core or told["last_incident"] != before:
            asked.fail(asked.words("drill_disturbed"))
        time.sleep(LOOK_EVERY_S)
    asked.say("drill_calm")
    asked.tell({"ok": True, "incident": None, "story": None})


def _another_waits(asked: Asked, first: Mapping[str, Any]) -> None:
    """Watch until another spare is ready; the drill has failed if none comes, or anything was done to the core."""
    began = time.monotonic()

    def waits(told: Mapping[str, Any]) -> bool:
        if told["core"]["pid"] != first["core"]["pid"] or told["last_incident"] != first["last_incident"]:
            asked.fail(asked.words("drill_disturbed"))
        if told["spare_lack"] is not None:
            asked.fail(
                asked.words(
                    "drill_spareless", why=spare_lack(told["spare_lack"], asked.lang, told["spare_off"])
                )
            )
        spare = told["spare"]
        return bool(spare and spare["ready"] and spare["pid"] != first["spare"]["pid"])

    told = come_back(asked, waits, SPARE_S)
    asked.say("drill_spared", seconds=f"{time.monotonic() - began:.1f}")
    asked.tell({"ok": True, "incident": None, "story": None, "spare": told["spare"]["pid"]})
