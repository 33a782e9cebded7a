"""Has the report of an incident made, by a process of its own that nothing of the guard waits for.

What reads an incident's files must not be able to hurt whoever guards the ledger: it may be slow, hang or fall over a
damaged file. A thread was not chosen for that reason.
"""

import shutil
import sys
from pathlib import Path

from hardcore.host import lives, logs, processes
from hardcore.host.folders import Folders
from hardcore.snapshot.filing import Hands

#: A report is made in a second or two; one that takes this long hangs.
REPORT_S = 20.0


async def have_report(hands: Hands, folders: Folders, folder: Path) -> None:
    """Have the investigators read the box: a process of its own, which nothing of the guard waits for."""
    log = await hands.in_hand(logs.place, folders.logs / "postmortem.log", folders.run)
    argv = [sys.executable, "-I", "-m", "postmortem", "report", str(folder)]
    handle = await hands.in_hand(
        processes.spawn,
        ["nice", "-n", "19", *argv] if shutil.which("nice") else argv,
        lives.clean_environment(),
        log,
        folders.data,
    )
    ended = False
    try:
        ended = await processes.gone(handle, REPORT_S)
    finally:
        if not ended:  # it hangs, or the guard ends and can't wait for it
            hands.note("report", incident=folder.name, failed="it did not end by itself")
            handle.kill_tree()
            await processes.gone(handle, lives.KILL_S)
        handle.reap()
        handle.close()
