"""The listener that a guard has left in the hands of its gateway and its core, taken back by whoever starts anew.

Both hold the socket that people dial, so nobody else can open its address, and one who starts elsewhere leaves connections
at the old one that are accepted by the kernel and answered by nobody. A descriptor of another process is given to
whoever may trace it (`pidfd_getfd`): a core lets its own user, a gateway where the system does. Asking them for it
over a socket was not chosen: a gateway has none that one could dial, and one that stands still would not answer.
"""

import ctypes
import os
import socket
from contextlib import suppress

import msgspec

from hardcore.host import leftovers
from hardcore.host.folders import Folders
from hardcore.host.processes import Handle

_PIDFD_GETFD = 438
_CORES_WORD = "HARDCORE_LISTEN_FD="
_GATEWAYS_WORD = "--listen-fd"


class Left(msgspec.Struct, frozen=True):
    """Who holds the listener, by number, and a duplicate of it if it could be taken; it is the caller's to close."""

    pids: tuple[int, ...]
    listener: socket.socket | None


def find_listener(folders: Folders) -> Left:
    """Look for processes of a guard that is gone, and take the listener that they hold."""
    found = leftovers.find_leftovers(folders)
    cores = [life.handle for life in found.cores if life.handle is not None]
    others = (*found.courts, *found.investigators)
    try:
        takes = (_take(handle, number) for handle, number in _numbers(cores, found.gateways))
        listener = next((taken for taken in takes if taken is not None), None)
        return Left(tuple(handle.pid for handle in (*found.gateways, *cores)), listener)
    finally:
        for handle in (*cores, *found.gateways, *others):
            handle.close()


def _numbers(cores: list[Handle], gateways: tuple[Handle, ...]) -> list[tuple[Handle, str]]:
    found = []
    for handle in cores:
        told = leftovers.read_environment(handle.pid)
        found += [(handle, one.removeprefix(_CORES_WORD)) for one in told if one.startswith(_CORES_WORD)]
    for handle in gateways:
        argv = leftovers.read_command_line(handle.pid)
        if _GATEWAYS_WORD in argv[:-1]:
            found.append((handle, argv[argv.index(_GATEWAYS_WORD) + 1]))
    return found


def _take(handle: Handle, number: str) -> socket.socket | None:
    """Return a duplicate of what a process has under this number, if that is a listener."""
    if not number.isdigit():
        return None
    fd = ctypes.CDLL(None, use_errno=True).syscall(_PIDFD_GETFD, handle.pidfd, int(number), 0)
    if fd < 0:
        return None
    try:
        taken = socket.socket(fileno=fd)
    except OSError:  # no socket
        os.close(fd)
        return None
    with suppress(OSError):
        if taken.family in {socket.AF_INET, socket.AF_INET6} and taken.getsockopt(
            socket.SOL_SOCKET, socket.SO_ACCEPTCONN
        ):
            return taken
    taken.close()
    return None
