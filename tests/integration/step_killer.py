"""Kills the guard at a step: `python -m tests.integration.step_killer FILE STEP PIDFD`, a process of its own.

It reads the file of the guard's steps without a pause, because a step may last for less than a millisecond, and no
thread of the test may be in its way. Ends with 0 once it has killed.
"""

import json
import os
import signal
import sys


def run(path: str, step: str, pidfd: int) -> None:
    mark = f'"step": {json.dumps(step)}'.encode()
    sys.stdout.write("looking\n")
    sys.stdout.flush()
    while True:
        try:
            fd = os.open(path, os.O_RDONLY)
        except OSError:
            continue
        told = os.read(fd, 65536)
        os.close(fd)
        if mark in told:
            signal.pidfd_send_signal(pidfd, signal.SIGKILL)
            return


if __name__ == "__main__":
    run(sys.argv[1], sys.argv[2], int(sys.argv[3]))
