"""A sentinel arrives: it takes the lock, and finds out where the guard before it stood.

What it needs for that is read from the data folder and written to the run folder, which lies in memory: where a disk
hangs, a guard that died must still be followed by another. What the disk has to know is written behind, on a thread
that nobody waits for.
"""

import datetime as dt
import os
import sys
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec

from hardcore import quarantine_file, standing
from hardcore.agents_file import Guard, write_agents
from hardcore.court_words import unruled
from hardcore.host import clock, files, leftovers, steps, suspects
from hardcore.host.folders import Folders, Unusable, laid_out, locate, prepare_data, prepare_run
from hardcore.host.ids import new_id
from hardcore.host.leftovers import Leftovers
from hardcore.host.processes import start_of
from hardcore.host.sentinel_page import LAST_WORDS, SentinelPage, read_page
from hardcore.model.phases import Wanted
from hardcore.model.trials import CourtMemory, Letter
from hardcore.quarantine_file import Aside
from hardcore.recovery.letters import letter
from hardcore.snapshot import writer

EXIT_ANOTHER_WATCHES = 3
EXIT_UNUSABLE = 78
#: Longer than somebody needs who only looks, and shorter than a guard lives.
LOOKS_MAX, LOOK_S = 3, 0.02


class Before(msgspec.Struct, frozen=True):
    """How the guard before this one was lost. `unwatched_ns` None: none was, or nobody can tell. `drilled`: it ended itself."""

    unwatched_ns: int | None = None
    found_frozen: bool = False
    drilled: bool = False


class Setup(msgspec.Struct):
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
    guard: Guard  # who we are, for those who watch us
    page: SentinelPage
    before: Before


def set_up(data: Path, listen_fd: int, url: str) -> Setup | int:
    """Take the lock and find out where we stand. Returns an exit code when we may not watch."""
    # What is laid out is not tried for writing: a disk that hangs would keep us there, and the core without a guard.
    found = laid_out(data)
    made = found if found is not None else prepare_data(data)
    # Kept until we end, and taken before the link is touched: one guard for one data folder.
    guarding = None if isinstance(made, Unusable) else _take(made.guard_lock)
    folders = made if guarding is None or isinstance(made, Unusable) else prepare_run(locate(data))
    if isinstance(folders, Unusable):
        sys.stderr.write(f"{folders.reason}\n")
        return EXIT_UNUSABLE
    lock_fd = None if guarding is None else _take(folders.run / "sentinel.lock")
    if lock_fd is None:
        sys.stderr.write("Another sentinel watches this data folder.\n")
        return EXIT_ANOTHER_WATCHES
    standing.own_run_folder(folders)
    generation = standing.next_generation(folders)
    before = _before(folders)
    guard, page = _name(folders, generation, url)
    standing.ship_policy(folders)
    threading.Thread(target=_behind, args=(folders, generation), daemon=True, name="behind").start()
    in_force = standing.policy_in_force(folders)
    with suppress(
        OSError
    ):  # then there are no agents, as in a run folder that is full; the launcher is there
        write_agents(folders, guard, in_force.policy)
    noted = steps.incident_left(folders)
    court, court_since = suspects.read(folders, dt.datetime.now(dt.UTC))
    aside, rules_fault = quarantine_file.take_in(folders)
    wanted = standing.wanted(folders)
    abandoned = writer.find_abandoned(folders.incidents, folders.shelter, str(noted.get("id", "")))
    return Setup(
        folders,
        lock_fd,
        listen_fd,
        url,
        generation,
        in_force,
        leftovers.find_leftovers(folders, adopt=wanted is not Wanted.DOWN, reads_only=wanted is Wanted.SAFE),
        abandoned,
        noted if any(one.id == noted.get("id") for one in abandoned) else {},
        aside,
        rules_fault,
        tuple(map(letter, unruled(court, aside))),
        court,
        court_since,
        guard,
        page,
        before,
    )


def _take(path: Path) -> int | None:
    """Take a lock; who only looks whether it is held (a launcher, a command) has it for a moment and is waited for."""
    for _ in range(LOOKS_MAX):
        if (lock := files.take_lock(path)) is not None:
            return lock
        time.sleep(LOOK_S)
    return files.take_lock(path)


def _name(folders: Folders, generation: int, url: str) -> tuple[Guard, SentinelPage]:
    """Say who we are, to the launcher and to the agents."""
    start = start_of(os.getpid())
    assert start is not None, "this very process is there"
    guard = Guard(generation, os.getpid(), start, new_id().replace("-", ""), url)
    files.write_json(
        folders.sentinel,
        {
            "pid": guard.pid,
            "start": guard.start,
            "nonce": guard.nonce,
            "generation": generation,
            "launcher": os.getppid(),
            "url": url,
            "boot": clock.boot_id(),
            "argv": sys.orig_argv,
        },
        durable=False,
    )
    return guard, SentinelPage(folders.sentinel_page, generation, guard.start, guard.nonce)


def _before(folders: Folders) -> Before:
    """Return how the guard before was lost: its page is left as it was at its last beat, unless it ended as it was told."""
    page, named = read_page(folders.sentinel_page), files.read_json(folders.sentinel)
    # Times of another boot mean nothing: only a run folder that is no tmpfs has a page of one.
    if page is None or named.get("boot") != clock.boot_id() or named.get("nonce") != page.nonce:
        return Before()
    ended = [files.read_json(note).get("ended") for note in folders.run.glob("agent-budget-*.json")]
    drilled = files.read_json(folders.run / LAST_WORDS).get("nonce") == page.nonce
    unwatched_ns = max(0, clock.now_ns() - max(page.began_ns, page.loop_ns))
    return Before(unwatched_ns, found_frozen=page.nonce in ended, drilled=drilled)


def _behind(folders: Folders, generation: int) -> None:
    """Do what may wait for a disk as long as that likes."""
    leftovers.sweep_drafts(folders)
    standing.keep(folders, generation)
