"""The restart budget on disk: deaths with their boot, because a monotonic stamp means nothing after a reboot.

A stamp of a million seconds in a boot that is an hour old would never age: the budget would be spent for ever.
"""

import time
from pathlib import Path

from hardcore.host import clock, files
from hardcore.host.folders import Folders
from hardcore.model.verdicts import Diagnosis

DEATHS_MAX = 1024


def read_deaths(folders: Folders, window_ns: int) -> tuple[int, ...]:
    """Return the deaths that count, as monotonic times of this boot.

    After a reboot the old stamps mean nothing: their age is taken from the wall clock, at least 0 and at
    most the window.
    """
    stored = files.read_json(_path(folders))
    deaths = stored.get("deaths")
    if not isinstance(deaths, list):
        return ()
    now_ns = clock.now_ns()
    same_boot = stored.get("boot_id") == clock.boot_id()
    stamps = [
        d.get("monotonic_ns" if same_boot else "wall_ns") for d in deaths[-DEATHS_MAX:] if isinstance(d, dict)
    ]
    whole = [stamp for stamp in stamps if isinstance(stamp, int)]
    if same_boot:
        return tuple(min(stamp, now_ns) for stamp in whole)
    return tuple(now_ns - min(window_ns, max(0, time.time_ns() - stamp)) for stamp in whole)


def read_shut(folders: Folders) -> Diagnosis | None:
    """Return why the policy has shut the service down, or None if it has not. A word that is not known says nothing."""
    shut = files.read_json(_path(folders)).get("shut")
    return Diagnosis(shut) if shut in {str(one) for one in Diagnosis} else None


def write_deaths(folders: Folders, deaths_ns: tuple[int, ...], shut: Diagnosis | None = None) -> None:
    """Write the deaths that count down, and why the policy has shut the service down, for a successor of this guard."""
    offset_ns = time.time_ns() - clock.now_ns()
    entry = {
        "boot_id": clock.boot_id(),
        "deaths": [{"monotonic_ns": at, "wall_ns": at + offset_ns} for at in deaths_ns],
        "shut": shut,
    }
    files.write_json(_path(folders), entry)


def _path(folders: Folders) -> Path:
    return folders.state / "budget.json"
