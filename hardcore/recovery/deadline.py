"""The one deadline of a phase, and the amnesty for whoever overslept it.

A deadline that rings far too late says more about us than about the core: the machine slept, and the core
with it, so nobody had the time that is over now. Then the phase begins its time anew, a few times and not
for ever: a machine that is always late must still get rid of a core that hangs.
"""

import msgspec

AMNESTIES_MAX = 3


class Deadline(msgspec.Struct):
    """When the present phase's time is over. Times are monotonic; `due_ns` None: never by itself."""

    late_ns: int
    due_ns: int | None = None
    _wait_ns: int = 0
    _amnesties: int = 0

    def set(self, now_ns: int, wait_ns: int | None, *, forgiving: bool) -> None:
        """Begin a phase that may last `wait_ns`. `forgiving`: its time is the core's, not ours."""
        self.due_ns = None if wait_ns is None else now_ns + wait_ns
        self._wait_ns = wait_ns or 0
        self._amnesties = AMNESTIES_MAX if forgiving else 0

    def extend(self, until_ns: int) -> None:
        """Let the phase last until then, if it has a deadline that is earlier."""
        if self.due_ns is not None:
            self.due_ns = max(self.due_ns, until_ns)

    def rings(self, now_ns: int) -> bool:
        """Return whether the time is over; it says so once."""
        if self.due_ns is None or now_ns < self.due_ns:
            return False
        if now_ns - self.due_ns > self.late_ns and self._amnesties:
            self._amnesties -= 1
            self.due_ns = now_ns + self._wait_ns
            return False
        self.due_ns = None
        return True
