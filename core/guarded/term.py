"""Hears a TERM together with the process that sent it.

A Python signal handler is told the signal's number only, and whether a TERM came from our guard or from
somebody else decides whether the end that follows is an incident. So TERM is blocked in every thread and
one thread waits for it by `sigwaitinfo`, which tells the sender. A signal mask is inherited: by threads,
which is what we want, and by forked children, which get theirs back at once. A program started by
`subprocess` would keep it; the core starts none. Not chosen: a C handler through ctypes, which would run
Python code at any instruction.
"""

import os
import signal
import threading
from collections.abc import Callable

_TERM = frozenset({signal.SIGTERM})


def hold_term() -> None:
    """Keep TERM from this thread and all it starts; call it on the main thread before there are others."""
    if signal.SIGTERM in signal.pthread_sigmask(signal.SIG_BLOCK, _TERM):
        return
    os.register_at_fork(after_in_child=_release_term)


def _release_term() -> None:
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _TERM)


class TermWatch:
    """The thread that waits for TERM. `hold_term` comes first, or the signal goes elsewhere."""

    def __init__(self, heard: Callable[[int], None]) -> None:
        """Call `heard(pid of the sender)` on the waiting thread for each TERM; 0: the kernel sent it."""
        self._heard = heard
        self._ending = False
        self._thread = threading.Thread(target=self._run, name="term", daemon=True)

    def start(self) -> None:
        """Listen from now on, also to a TERM that came before."""
        self._thread.start()

    def stop(self) -> None:
        """Listen no more; returns when the thread has ended. A TERM after this has no effect."""
        self._ending = True
        assert self._thread.ident is not None, "only what was started can be stopped"
        if self._thread.is_alive():
            signal.pthread_kill(self._thread.ident, signal.SIGTERM)
        self._thread.join()

    def _run(self) -> None:
        while True:
            sender = signal.sigwaitinfo(_TERM).si_pid
            if self._ending:
                return
            self._heard(sender)
