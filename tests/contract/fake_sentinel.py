"""A stand-in for the sentinel, as its agents see one: it takes the lock, leaves its page and its word, and beats as it is told.

`python fake_sentinel.py RUN HOW LISTENER`; HOW: `beats`, `busy` (its loop computes for ever), `stuck` (its loop sleeps in one
place), `slow` (its loop beats now and then). What it found around it at its start is appended to `RUN/started`.
"""

import json
import os
import sys
import threading
from pathlib import Path

from hardcore.host import files
from hardcore.host.processes import start_of
from hardcore.host.sentinel_page import SentinelPage

ANOTHER_WATCHES = 3


def main() -> int:
    run, how, listener = Path(sys.argv[1]), sys.argv[2], sys.argv[3]
    if files.take_lock(run / "sentinel.lock") is None:
        return ANOTHER_WATCHES
    pid = os.getpid()
    start = start_of(pid)
    assert start is not None
    word = json.loads((run / "agents.json").read_text("utf-8"))
    word["sentinel"] = {"pid": pid, "start": start, "nonce": f"{pid}-{start}"}
    word["argv"] = ["beats" if part == how else part for part in word["argv"]]
    page = SentinelPage(Path(word["page"]), 1, start, word["sentinel"]["nonce"])
    found = {
        "pid": pid,
        "session": os.getsid(0),
        "environment": dict(os.environ),
        "listener": Path(f"/proc/self/fd/{listener}").readlink().name,
    }
    with (run / "started").open("a", encoding="utf-8") as file:
        file.write(json.dumps(found) + "\n")
    page.beat()
    files.write_json(run / "agents.json", word, durable=False)
    while how == "busy":
        pass
    if how == "stuck":
        asleep = threading.Lock()
        asleep.acquire()
        asleep.acquire()
    pause = threading.Event()
    while True:
        page.beat()
        pause.wait(0.3 if how == "slow" else 0.02)


if __name__ == "__main__":
    sys.exit(main())
