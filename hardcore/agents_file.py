"""What the sentinel leaves word of for its agents: who it is, how it is told to live, and how another is started.

Written at each start and whenever the policy changes, into the run folder, owner-only like everything there. The agents
go by this file alone, because whom they could ask is who is lost. It carries the whole environment of the sentinel: one
that an agent starts must be what the launcher would have started, and a choice of variables would be wrong one day.
"""

import os
import sys
from pathlib import Path

import msgspec

from hardcore.host import files, logs
from hardcore.host.folders import Folders
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.policy import Policy, Word

#: So long nobody may hold the lock, until an agent starts a sentinel.
AFTER_MS = 500
#: A beat older than this is not the guard's usual lateness; with long pauses between two looks, so many of them.
STALE_MS, STALE_LOOKS = 3000, 10
#: What an agent of one side may start in such a time.
STARTS_MAX, WINDOW_S = 5, 60
_LISTENER = "{listen_fd}"


class Guard(msgspec.Struct, frozen=True):
    """Who this sentinel is. `nonce`: at most 32 letters, as in its page."""

    generation: int
    pid: int
    start: int
    nonce: str
    url: str


def write_agents(folders: Folders, guard: Guard, policy: Policy) -> None:
    """Leave word for the agents under this policy. Raises OSError where the run folder takes none."""
    starter = str(Path(__file__).with_name("starter.py"))
    said = folders.run / "sentinel.out"  # in memory: a disk that hangs must not keep us from leaving word
    logs.cut(said)
    argv = [sys.executable, "-I", "-S", starter, str(said)]
    argv += [sys.executable, "-I", "-m", "hardcore.runtime", "--data", str(folders.data)]
    argv += ["--listen-fd", _LISTENER, "--url", guard.url]
    told = {
        "version": 1,
        "generation": guard.generation,
        "sentinel": {"pid": guard.pid, "start": guard.start, "nonce": guard.nonce},
        "page": str(folders.sentinel_page),
        "lock": str(folders.run / "sentinel.lock"),
        "wanted": str(folders.state / "wanted.json"),
        "launcher": str(folders.launcher_lock),
        "argv": argv,
        "environment": dict(os.environ),
        "sentinel_lost": policy.asks(Diagnosis.SENTINEL_LOST, Word.REBOOT_PROCESS),
        "gateway_lost": policy.asks(Diagnosis.GATEWAY_LOST, Word.REBOOT_PROCESS),
        "after_ms": AFTER_MS,
        "stale_ms": max(STALE_MS, STALE_LOOKS * policy.health_check_interval_ms),
        "budget": {"limit": STARTS_MAX, "window_s": WINDOW_S},
    }
    files.write_json(folders.agents, told, durable=False)
