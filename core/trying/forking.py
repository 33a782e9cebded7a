"""Forking a throw-away core: a process of its own that can outlive nobody and take no more than it may.

Everything is loaded once, before, so that a core which dies costs its successor not the half second of a fresh start
(measured: 40 ms against 450). A fork is safe while its parent has one thread and no open database, and that is
asserted each time: no lock can be held by a thread that is not there afterwards. The core is the leader of a session, so
that what it starts is ended with it; the kernel ends it when its parent is gone; its limits are belts behind the parent's
watch. Not chosen: `multiprocessing`, whose fork server would be a process that nobody watches.
"""

import faulthandler
import json
import os
import resource
import signal
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final, NoReturn

import msgspec

from core.collecting import collect_from_now_on
from core.departure import ExitCode
from core.guarded.last_words import story
from core.mortality import die_with

_ASKING_TO_END: Final = frozenset({signal.SIGTERM, signal.SIGINT, signal.SIGHUP})
_PAGE_BYTES: Final = os.sysconf("SC_PAGE_SIZE")
#: Of address space above its bound of memory: threads reserve far more than they use.
_RESERVED_BYTES: Final = 2 << 30
WRITTEN_BYTES_MAX: Final = 256 << 20  # of a single file, above what the copy has


class Bounds(msgspec.Struct, frozen=True):
    """How much of everything a throw-away core may take before the kernel itself stops it."""

    memory_bytes: int
    cpu_s: int
    file_bytes: int


class Forked(msgspec.Struct, frozen=True):
    """A child: its number, a descriptor that tells its death, and the socket on which it says words."""

    pid: int
    death: int
    words: socket.socket


def fork(live: Callable[[socket.socket], None], stacks: Path, bounds: Bounds) -> Forked:
    """Fork a child that calls `live` with its end of the words and ends. `stacks`: where its last stacks will stand."""
    threads = len(list(Path("/proc/self/task").iterdir()))
    assert threads == 1, f"a fork of {threads} threads has locks that nobody will ever let go"
    ours, theirs = socket.socketpair()
    parent = os.getpid()
    pid = os.fork()
    if pid == 0:
        ours.close()
        _be(parent, live, theirs, stacks, bounds)
    theirs.close()
    ours.setblocking(False)
    return Forked(pid, os.pidfd_open(pid), ours)


@contextmanager
def term_held_back() -> Iterator[None]:
    """Let nobody's wish that we end come between the fork of a core and the note of it."""
    signal.pthread_sigmask(signal.SIG_BLOCK, _ASKING_TO_END)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _ASKING_TO_END)


def say(words: socket.socket, **word: Any) -> None:
    """Say one word to the parent; blocks until it is taken, and where nobody listens there is no parent any more."""
    with suppress(OSError):
        words.sendall(json.dumps(word).encode() + b"\n")


def _be(
    parent: int, live: Callable[[socket.socket], None], words: socket.socket, stacks: Path, bounds: Bounds
) -> NoReturn:
    """Become a process of one's own; whatever happens, the parent's code is never gone on with."""
    try:
        os.setsid()
        if not die_with(parent):
            os._exit(ExitCode.ASKED)
        for number in _ASKING_TO_END:
            signal.signal(number, signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _ASKING_TO_END)
        _say_nothing()
        _keep_within(bounds)
        # What was loaded lives as long as the process, as in any core.
        collect_from_now_on()
        _keep_stacks(stacks)
        live(words)
    # Any mistake of ours: the way back would lead into the parent's work.
    except BaseException as error:  # noqa: BLE001  as said above
        say(words, fault=story(error))
        os._exit(ExitCode.BUG)
    os._exit(ExitCode.ASKED)


def _say_nothing() -> None:
    """Its words are on its socket: standard output is the parent's protocol, and a log could be a flood."""
    nothing = os.open(os.devnull, os.O_RDWR)
    for standard in (0, 1, 2):
        os.dup2(nothing, standard)
    os.close(nothing)


def _keep_stacks(stacks: Path) -> None:
    descriptor = os.open(stacks, os.O_CREAT | os.O_WRONLY | os.O_APPEND | os.O_CLOEXEC, 0o600)
    faulthandler.enable(descriptor, all_threads=True)
    faulthandler.register(signal.SIGUSR1, descriptor, all_threads=True, chain=False)


def _keep_within(bounds: Bounds) -> None:
    has_bytes = int(Path("/proc/self/statm").read_text().split()[0]) * _PAGE_BYTES
    for kind, most in (
        (resource.RLIMIT_AS, has_bytes + 2 * bounds.memory_bytes + _RESERVED_BYTES),
        (resource.RLIMIT_CPU, bounds.cpu_s),
        (resource.RLIMIT_FSIZE, bounds.file_bytes),
        (resource.RLIMIT_CORE, 0),  # an image of its memory would have everything in it
    ):
        _, hard = resource.getrlimit(kind)
        within = most if hard == resource.RLIM_INFINITY else min(most, hard)
        resource.setrlimit(kind, (within, within))
