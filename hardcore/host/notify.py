"""The notify socket's receiving end: datagrams with the pid that the kernel vouches for."""

import os
import socket
import struct
from collections.abc import Iterator
from pathlib import Path

DATAGRAMS_A_TURN_MAX = 64
#: What is passed over is told at once, and then this seldom however much comes.
TELL_EVERY_NS = 60_000_000_000
_CREDENTIALS = struct.Struct("3i")


class Tally:
    """Counts datagrams that are passed over, so that a flood of them can't fill the log."""

    def __init__(self) -> None:
        self._untold = 0
        self._told_ns: int | None = None

    def count(self, at_ns: int) -> int:
        """Count one more; return how many are to be told of now, mostly 0."""
        self._untold += 1
        if self._told_ns is not None and at_ns - self._told_ns < TELL_EVERY_NS:
            return 0
        told, self._untold, self._told_ns = self._untold, 0, at_ns
        return told


class NotifySocket:
    """Bound at `path`, owner-only, never blocking."""

    def __init__(self, path: Path, bytes_max: int) -> None:
        self._bytes_max = bytes_max
        self._socket = socket.socket(
            socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC
        )
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_PASSCRED, 1)
        path.unlink(missing_ok=True)
        before = os.umask(0o177)
        try:
            self._socket.bind(str(path))
        finally:
            os.umask(before)
        self._path = path

    def fileno(self) -> int:
        """The descriptor to wait on."""
        return self._socket.fileno()

    def waiting(self) -> Iterator[tuple[int, bytes]]:
        """Yield (pid of the sender, datagram) for what has arrived, at most a turn's worth."""
        for _ in range(DATAGRAMS_A_TURN_MAX):
            try:
                data, ancillary, _flags, _address = self._socket.recvmsg(
                    self._bytes_max + 1, socket.CMSG_SPACE(_CREDENTIALS.size)
                )
            except (BlockingIOError, InterruptedError):
                return
            for level, kind, content in ancillary:
                if level == socket.SOL_SOCKET and kind == socket.SCM_CREDENTIALS:
                    yield _CREDENTIALS.unpack(content[: _CREDENTIALS.size])[0], data

    def close(self) -> None:
        """Stop listening and remove the path."""
        self._socket.close()
        self._path.unlink(missing_ok=True)
