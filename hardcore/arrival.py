"""A sentinel arrives: it takes the lock, and finds out where the guard before it stood.

What it needs for that is read from the data folder and written to the run folder, which lies in memory: where a disk
hangs, a guard that died must still be followed by another. What the disk has to know is written behind, on a thread
that nobody waits for.
"""

import datetime as dt
import os
import sys
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hardcore import quarantine_file, standing
from hardcore.court_words import unruled
from hardcore.host import files, leftovers, steps, suspects
from hardcore.host.folders import Folders, Unusable, prepare, prepare_data
from hardcore.host.ids import new_id
from hardcore.host.leftovers import Leftovers
from hardcore.host.processes import start_of
from hardcore.model.phases import Wanted
from hardcore.model.trials import CourtMemory, Letter
from hardcore.quarantine_file import Aside
from hardcore.recovery.letters import letter
from hardcore.snapshot import writer

EXIT_ANOTHER_WATCHES = 3
EXIT_UNUSABLE = 78


@dataclass(slots=True)
class Setup:
    """What the sentinel process begins with."""

    folders: Folders
    lock_fd: int
    listen_fd: int
    url: str
    generation: int
    in_force: standing.PolicyInForce
    leftovers: Leftovers
    abandoned: tuple[writer.Abandoned, ...]
    noted: Mapping[str, Any]  # what the guard before knew of the incident that was open when it ended
    aside: Aside  # what is set aside, and by which rules
    rules_fault: str  # what is wrong with the file that says it
    unruled: tuple[Letter, ...]  # what was set aside though no rule says so
    court: CourtMemory  # what the guard before remembered of suspects
    court_since: Mapping[str, str]  # and since when


def set_up(data: Path, listen_fd: int, url: str) -> Setup | int:
    """Take the lock and find out where we stand. Returns an exit code when we may not watch."""
    made = prepare_data(data)
    # Kept until we end, and taken before the link is touched: one guard for one data folder.
    guarding = None if isinstance(made, Unusable) else files.take_lock(made.guard_lock)
    folders = prepare(data) if guarding is not None else made
    if isinstance(folders, Unusable):
        sys.stderr.write(f"{folders.reason}\n")
        return EXIT_UNUSABLE
    lock_fd = None if guarding is None else files.take_lock(folders.run / "sentinel.lock")
    if lock_fd is None:
        sys.stderr.write("Another sentinel watches this data folder.\n")
        return EXIT_ANOTHER_WATCHES
    standing.own_run_folder(folders)
    generation = standing.next_generation(folders)
    files.write_json(
        folders.sentinel,
        {
            "pid": os.getpid(),
            "start": start_of(os.getpid()),
            "nonce": new_id(),
            "generation": generation,
            "launcher": os.getppid(),
            "url": url,
            "argv": sys.orig_argv,
        },
        durable=False,
    )
    standing.ship_policy(folders)
    threading.Thread(target=_behind, args=(folders, generation), daemon=True, name="behind").start()
    in_force = standing.policy_in_force(folders)
    noted = steps.incident_left(folders)
    court, court_since = suspects.read(folders, dt.datetime.now(dt.UTC))
    aside, rules_fault = quarantine_file.take_in(folders)
    abandoned = writer.find_abandoned(folders.incidents, folders.shelter, str(noted.get("id", "")))
    return Setup(
        folders,
        lock_fd,
        listen_fd,
        url,
        generation,
        in_force,
        leftovers.find_leftovers(folders, adopt=standing.wanted(folders) is Wanted.UP),
        abandoned,
        noted if any(one.id == noted.get("id") for one in abandoned) else {},
        aside,
        rules_fault,
        tuple(map(letter, unruled(court, aside))),
        court,
        court_since,
    )


def _behind(folders: Folders, generation: int) -> None:
    """Do what may wait for a disk as long as that likes."""
    leftovers.sweep_drafts(folders)
    standing.keep(folders, generation)
