"""What a gateway is started with, and whether one that runs was started with the same."""

import dataclasses
import json
import os
import sys
from pathlib import Path
from typing import Final

from hardcore.access.files import read_doorway
from hardcore.host import build, leftovers, lives
from hardcore.host.folders import Folders
from hardcore.host.processes import Handle
from hardcore.recovery.policy import Policy

_LISTENER: Final = "--listen-fd"
#: Under what the door stood open when a gateway was started: one of another `up` is not gone on with.
_DOORWAY: Final = "HARDCORE_DOORWAY"
_LIMITS: Final = "HARDCORE_LIMITS"
_BUILD: Final = "HARDCORE_BUILD"


def environment(folders: Folders, policy: Policy) -> dict[str, str]:
    """The environment of a gateway."""
    return {
        **leftovers.environment_of_gateway(folders),
        _LIMITS: json.dumps(dataclasses.asdict(policy.gateway)),
        _BUILD: build.guard_build_id(),
        _DOORWAY: read_doorway(folders.state).mark,
    }


def argv(folders: Folders, listen_fd: int) -> list[str]:
    """The command line of a gateway."""
    words = [sys.executable, "-I", "-m", "hardcore.crisis"]
    words += [_LISTENER, str(listen_fd), "--control", str(folders.control)]
    if os.environ.get(lives.DEMO_SWITCH) == "1":
        words.append("--demo")
    words += ["--recoveries", str(folders.state / "recoveries.json")]
    words += ["--receipts", str(folders.data / "receipts.db")]
    words += ["--state", str(folders.state), "--investigator", str(folders.investigator)]
    words += ["--own-door", str(folders.gateway), "--page", str(folders.gateway_page)]
    words += ["--agents", str(folders.agents)]
    return words


def fits(older: Handle, folders: Folders, policy: Policy, listen_fd: int) -> bool:
    """Whether a gateway is what we would start now, but for the number that its listener has there."""
    told = dict(line.partition("=")[::2] for line in leftovers.read_environment(older.pid))
    ours = environment(folders, policy)
    if any(told.get(name) != ours[name] for name in (_LIMITS, _BUILD, _DOORWAY)):
        return False
    theirs = leftovers.read_command_line(older.pid)
    return _told_alike(argv(folders, listen_fd), theirs) and _shares_listener(older, theirs, listen_fd)


def _told_alike(ours: list[str], theirs: list[str]) -> bool:
    """Whether two command lines differ in the number of the listener alone."""
    if _LISTENER not in theirs or len(ours) != len(theirs):
        return False
    number = ours.index(_LISTENER) + 1
    return [*ours[:number], *ours[number + 1 :]] == [*theirs[:number], *theirs[number + 1 :]]


def _shares_listener(older: Handle, theirs: list[str], listen_fd: int) -> bool:
    """Whether what browsers dial is the same socket for both; a new launcher may hold another."""
    number = theirs[theirs.index(_LISTENER) + 1]
    try:
        return os.path.samestat(Path(f"/proc/{older.pid}/fd/{number}").stat(), os.fstat(listen_fd))
    except OSError:
        return False
