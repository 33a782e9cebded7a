"""Starts a program as nobody's child: forks, ends, and leaves the rest to whoever adopts orphans here.

An agent that lost its sentinel runs this by the bare interpreter (`python -I -S starter.py LOG PROGRAM …`). Its own process
must not be the new sentinel's parent: a core that is killed with everything in its session would take the sentinel along
that is to bring the next core. The fork is made here and not in the agent, because a process with threads must not fork.
Imports nothing of ours.
"""

import contextlib
import os
import signal
import sys

#: What the program gets: no input, its log, and the listener.
LISTENER = 3


def main() -> None:
    """Start the program, and end."""
    log, *argv = sys.argv[1:]
    if os.fork():
        os._exit(0)
    os.setsid()
    os.closerange(LISTENER + 1, os.sysconf("SC_OPEN_MAX"))
    with contextlib.suppress(OSError):
        # A core is ended first when memory runs out; a sentinel is not.
        rank = os.open("/proc/self/oom_score_adj", os.O_WRONLY)
        os.write(rank, b"0")
        os.close(rank)
    with contextlib.suppress(OSError):  # a disk that takes no log must not keep a guard from coming back
        out = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
        os.dup2(out, 1)
        os.dup2(out, 2)
        if out > LISTENER:
            os.close(out)
    signal.pthread_sigmask(signal.SIG_SETMASK, {signal.SIGTERM})  # kept back until the sentinel can hear it
    os.execv(argv[0], argv)  # noqa: S606  # to become it is the point


if __name__ == "__main__":
    main()
