"""Whether somebody has asked not to be alerted for a while: one small file, written by whoever a person asks.

A file of its own, because the sender writes the book of alerts at the same time, and because it has to work with
everything stopped.
"""

import datetime as dt
import time
from pathlib import Path
from typing import Final

from hardcore.host import files
from hardcore.host.folders import Folders

MUTED_S_MAX: Final = 30 * 86_400
#: So far a clock may have been set back since somebody asked.
CLOCK_S: Final = 3600


def muted_until_ms(folders: Folders) -> int:
    """Return until when alerts are muted, in milliseconds of the wall clock; 0: they are not.

    What lies further ahead than anybody may ask for was written by a clock that was wrong, or by nobody who may.
    """
    told = files.read_json(_file(folders)).get("until")
    try:
        until_s = dt.datetime.fromisoformat(str(told)).timestamp()
    except (ValueError, OverflowError, OSError):
        return 0
    return int(until_s * 1000) if until_s <= time.time() + MUTED_S_MAX + CLOCK_S else 0


def mute(folders: Folders, seconds: int) -> str:
    """Mute alerts for so long; return until when (RFC 3339). Raises OSError where that can't be written down."""
    assert 0 < seconds <= MUTED_S_MAX, "whoever asks has judged it"
    moment = dt.datetime.fromtimestamp(time.time() + seconds, tz=dt.UTC)
    until = moment.isoformat(timespec="seconds").replace("+00:00", "Z")
    files.write_json(_file(folders), {"until": until})
    return until


def unmute(folders: Folders) -> None:
    """Let alerts be sent again. Raises OSError where the disk takes no change."""
    _file(folders).unlink(missing_ok=True)


def silence(folders: Folders, seconds: int) -> str | None:
    """Mute alerts for so long, at most MUTED_S_MAX, or with 0 no longer; return until when, None: they are not."""
    if seconds:
        return mute(folders, min(seconds, MUTED_S_MAX))
    unmute(folders)
    return None


def _file(folders: Folders) -> Path:
    return folders.state / "alerts_muted.json"
