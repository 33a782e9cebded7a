"""The parent of all: starts the sentinel, starts it again when it dies, and decides nothing.

A file that imports nothing of ours and is run by the bare interpreter (`python -I -S launcher.py …`), so that
hardly anything in it can break: it is the one process that nobody watches. It is a child subreaper: the
children of a dead sentinel become its own, so that their exit statuses can be read; they are written to
`exits/`. It holds the TCP listener open over every death below it. Ctrl-C and TERM are passed on to whichever
sentinel holds the lock; that one stops everything and ends with 0, and then so does this. Of one that is not its
child it can't read the 0; it goes by what only a sentinel that has stopped everything takes away, its page.

It reads no policy: that a guard is followed by another while `up` runs is what `up` means. Guards that end quickly or
often are followed more slowly, never not.

A service manager above it is told three things, each taken from what can be seen from here: READY when somebody answers
at the listener, WATCHDOG while the sentinel's own beat goes on, STOPPING when it was told to stop.

Arguments: the data folder, the run folder, the listener's descriptor, the URL.
"""

import _thread
import contextlib
import ctypes
import fcntl
import os
import select
import signal
import sys
import time

PR_SET_CHILD_SUBREAPER = 36
EXITS_KEPT_MAX = 64
#: A sentinel that lived shorter than this is started again only after a pause, which doubles each time up to the last.
SHORT_LIFE_S = 1.0
PAUSE_S, PAUSE_S_MAX = 0.5, 8.0
#: After so many ends within such a time the longest pause is made, however long each lived.
ENDS_MAX, ENDS_WINDOW_S = 20, 60.0
ANOTHER_WATCHES = 3
UNUSABLE = 78

#: What a service manager says to the process it has started, and to none of that one's children.
FOR_US_ALONE = (
    "NOTIFY_SOCKET",
    "WATCHDOG_USEC",
    "WATCHDOG_PID",
    "LISTEN_PID",
    "LISTEN_FDS",
    "LISTEN_FDNAMES",
)
#: How often it is tried whether somebody answers, until somebody does; and how long one try may take.
TRY_MS, TRY_S = 250, 0.2
#: Where the beat of the sentinel's loop stands in its page (docs/wires.md section 17).
BEAT_AT, BEAT_BYTES = 40, 8


def start_of(pid: int) -> int | None:
    """Return the start time of a process in ticks since boot, or None if there is none."""
    return stat_of(pid, 19)


def parent_of(pid: int) -> int | None:
    """Return the number of its parent, or None if there is no such process."""
    return stat_of(pid, 1)


def stat_of(pid: int, field: int) -> int | None:
    """Return a number that the kernel gives of a process, counted from its state on."""
    try:
        with open(f"/proc/{pid}/stat", encoding="utf-8", errors="replace") as file:  # noqa: PTH123  # pathlib costs memory here
            return int(file.read().rpartition(")")[2].split()[field])
    except (OSError, ValueError, IndexError):
        return None


def keep_descriptors() -> None:
    """Keep what we inherited to ourselves: a sentinel that held our lock would outlive us as a launcher."""
    for name in os.listdir("/proc/self/fd"):  # noqa: PTH208  # pathlib costs memory here
        if int(name) > 2:
            with contextlib.suppress(OSError):  # the listing's own is closed by now
                os.set_inheritable(int(name), False)


_saying = _thread.allocate_lock()


def say(words: bytes) -> None:
    """Tell the terminal, on a thread that nobody waits for: it may be closed, or a file on a disk that hangs.

    While it takes nothing, what would be said after is lost.
    """
    if words and _saying.acquire(blocking=False):
        try:
            _thread.start_new_thread(_write, (words,))
        except RuntimeError:  # no thread can be had: then nothing is said
            _saying.release()


def _write(words: bytes) -> None:
    fd = 2
    try:
        with contextlib.suppress(OSError):  # a socket can't be opened anew, and lies on no disk
            # By a description of our own: a sentinel that begins asks for its place in the one that we share with it,
            # and waits there for whoever writes.
            fd = os.open("/proc/self/fd/2", os.O_WRONLY | os.O_APPEND | os.O_CLOEXEC | os.O_NOCTTY)
        with contextlib.suppress(OSError):
            os.write(fd, words)
    finally:
        if fd != 2:
            os.close(fd)
        _saying.release()


def took_leave(run: str) -> bool:
    """Return whether the last sentinel has stopped everything: its page is the last thing that it takes away.

    One that died in the middle of that has left it; where the whole folder was removed, so was the name beside it.
    """
    return os.path.exists(f"{run}/sentinel.json") and not os.path.exists(f"{run}/sentinel.page")  # noqa: PTH110  # pathlib costs memory here


class Pace:
    """How long to wait before the next sentinel, from how long each has lived and how many have ended lately."""

    def __init__(self) -> None:
        self.ends: list[float] = []
        self.short_lives = 0

    def pause_s(self, began: float, ended: float) -> float:
        """Return it after a life between these two times, in seconds of one clock."""
        self.ends = [*(at for at in self.ends if ended - at < ENDS_WINDOW_S), ended][-ENDS_MAX - 1 :]
        self.short_lives = self.short_lives + 1 if ended - began < SHORT_LIFE_S else 0
        if len(self.ends) > ENDS_MAX:
            return PAUSE_S_MAX
        return min(PAUSE_S * 2 ** (self.short_lives - 1), PAUSE_S_MAX) if self.short_lives else 0.0


class Manager:
    """A service manager that asked to be told how it goes; without one, nothing is looked at and nothing is said."""

    def __init__(self, page: str, listen_fd: int) -> None:
        told = {name: os.environ.pop(name, "") for name in FOR_US_ALONE}
        self.page, self.listen_fd = page, listen_fd
        self.address = told["NOTIFY_SOCKET"].replace("@", "\0", 1)
        usec = told["WATCHDOG_USEC"] if told["WATCHDOG_PID"] in {"", str(os.getpid())} else ""
        # A third of what it waits for: half is what it asks for, and a turn may be late.
        self.beat_ms = max(1, int(usec) // 3000) if usec.isdigit() else None
        self.ready = False
        self.beat = b""

    def pause_ms(self) -> int | None:
        """How long to wait until there may be something to tell; None: for ever."""
        if not self.address:
            return None
        return self.beat_ms if self.ready else TRY_MS

    def tell(self) -> None:
        """Say what has become true since the last time."""
        if not self.address:
            return
        if not self.ready and self.answered():
            self.ready = self.say(b"READY=1")
        beat = self.last_beat()
        if self.beat_ms is not None and beat not in {b"", self.beat}:
            self.beat = beat
            self.say(b"WATCHDOG=1")

    def last_beat(self) -> bytes:
        """Return the time of the sentinel's last beat as it stands in its page; empty if there is none."""
        try:
            fd = os.open(self.page, os.O_RDONLY | os.O_CLOEXEC)
        except OSError:
            return b""
        try:
            return os.pread(fd, BEAT_BYTES, BEAT_AT)
        finally:
            os.close(fd)

    def answered(self) -> bool:
        """Ask at our own listener; return whether somebody has answered. What was answered is not our business."""
        import socket  # half a megabyte, which only a launcher under a service manager needs

        try:
            with socket.socket(fileno=os.dup(self.listen_fd)) as ours:
                family, address = ours.family, ours.getsockname()
            with socket.socket(family, socket.SOCK_STREAM) as client:
                client.settimeout(TRY_S)
                client.connect(address)
                client.sendall(b"GET /livez HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n")
                return client.recv(5) == b"HTTP/"
        except OSError:
            return False

    def say(self, words: bytes) -> bool:
        """Send it a datagram; return whether it was taken. It may be restarting itself, and must not stop us."""
        if not self.address:
            return False
        import socket  # as above

        try:
            with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) as out:
                out.sendto(words, self.address)
        except OSError:
            return False
        return True


class Launcher:
    """Holds the listener, a sentinel's pidfd, and whether we were told to stop."""

    def __init__(self, data: str, run: str, listen_fd: int, url: str) -> None:
        self.data, self.run, self.listen_fd, self.url = data, run, listen_fd, url
        self.manager = Manager(f"{run}/sentinel.page", listen_fd)
        self.told = False
        self.child = 0
        self.pidfd = -1
        self.status: int | None = None  # of our own child, once it was reaped
        self.pace = Pace()
        self.wakeup, wakeup_in = os.pipe2(os.O_CLOEXEC | os.O_NONBLOCK)
        signal.set_wakeup_fd(wakeup_in, warn_on_full_buffer=False)
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self.stop)
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        signal.signal(signal.SIGCHLD, lambda _number, _frame: None)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT, signal.SIGTERM})  # kept back until now

    def stop(self, _number: int, _frame: object) -> None:
        """Pass a stop on, once; the next one says that it is under way."""
        first, self.told = not self.told, True
        self.forward()
        if first:
            self.manager.say(b"STOPPING=1")
            say(b"\nStopping: the core finishes what it has.\n")

    def forward(self) -> None:
        """Tell the sentinel to stop everything."""
        if self.pidfd >= 0:
            try:
                signal.pidfd_send_signal(self.pidfd, signal.SIGTERM)
            except ProcessLookupError:
                return

    def start(self) -> None:
        """Start a sentinel in a session of its own."""
        argv = [sys.executable, "-I", "-m", "hardcore.runtime", "--data", self.data]
        argv += ["--listen-fd", str(self.listen_fd), "--url", self.url]
        os.set_inheritable(self.listen_fd, True)
        quiet = [(os.POSIX_SPAWN_OPEN, 0, "/dev/null", os.O_RDONLY, 0)]
        self.child = os.posix_spawn(
            sys.executable,
            argv,
            os.environ,
            file_actions=quiet,
            setsid=True,
            setsigdef=[signal.SIGCHLD],
            setsigmask=[signal.SIGTERM],  # kept back until the sentinel can hear it
        )
        self.pidfd = os.pidfd_open(self.child)

    def attach(self) -> bool:
        """Find the sentinel that holds the lock, if there is one; never by its number alone."""
        try:
            os.makedirs(self.run, 0o700, exist_ok=True)  # noqa: PTH103  # as above; a logout may have removed it
            fd = os.open(f"{self.run}/sentinel.lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        except OSError:
            return False  # with the folder above it: the sentinel finds another place
        try:
            fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return self.hold(*self.named())
        finally:
            os.close(fd)
        return False

    def named(self) -> tuple[int, int]:
        """Return pid and start time of the sentinel that named itself last; zeros if none did."""
        import json  # only a launcher that finds a living sentinel needs it: a megabyte of memory

        try:
            with open(f"{self.run}/sentinel.json", encoding="utf-8") as file:  # noqa: PTH123  # as above
                told = json.load(file)
            return int(told["pid"]), int(told["start"])
        except (OSError, ValueError, KeyError, TypeError):
            return 0, 0

    def hold(self, pid: int, start: int) -> bool:
        """Hold a process by a pidfd if it is still the one that is meant."""
        try:
            pidfd = os.pidfd_open(pid)
        except OSError:
            return False
        if start_of(pid) != start:
            os.close(pidfd)
            return False
        # One that an agent has started is ours all the same, if it was orphaned below us.
        self.child, self.pidfd = pid if parent_of(pid) == os.getpid() else 0, pidfd
        return True

    def wait(self) -> int | None:
        """Wait until the sentinel is gone, reaping whoever else ends. Returns its status if it was ours."""
        self.status = None
        poll = select.poll()
        poll.register(self.wakeup, select.POLLIN)
        poll.register(self.pidfd, select.POLLIN)
        gone = False
        while not gone:
            self.manager.tell()
            gone = any(fd == self.pidfd for fd, _event in poll.poll(self.manager.pause_ms()))
            with contextlib.suppress(BlockingIOError):
                os.read(self.wakeup, 4096)
            self.reap()
        os.close(self.pidfd)
        self.pidfd = -1
        return self.status

    def reap(self) -> None:
        """Take the exit status of every child that has ended."""
        while True:
            try:
                pid, status = os.waitpid(-1, os.WNOHANG)
            except ChildProcessError:
                return
            if pid == 0:
                return
            code = os.waitstatus_to_exitcode(status)
            if pid == self.child:
                self.status = code
            else:
                self._write_exit(pid, code)

    def _write_exit(self, pid: int, code: int) -> None:
        """Write an orphan's exit status down; a full disk must not end us."""
        folder = f"{self.run}/exits"
        try:
            with open(f"{folder}/{pid}", "w", encoding="ascii") as file:  # noqa: PTH123  # as above
                file.write(f'{{"pid": {pid}, "status": {code}, "at_ns": {time.monotonic_ns()}}}\n')
            names = sorted(os.listdir(folder), key=lambda name: os.stat(f"{folder}/{name}").st_mtime_ns)  # noqa: PTH208, PTH116  # as above
            for name in names[:-EXITS_KEPT_MAX]:
                os.unlink(f"{folder}/{name}")  # noqa: PTH108  # as above
        except OSError:
            return

    def wanted_down(self) -> bool:
        """Return whether the operator wants everything stopped, as it stands on disk."""
        try:
            with open(f"{self.data}/state/wanted.json", encoding="utf-8") as file:  # noqa: PTH123  # as above
                return '"DOWN"' in file.read()
        except OSError:
            return False

    def ended_as_told(self, status: int | None) -> bool:
        """Return whether the sentinel has stopped everything before it ended; `status` None: it was not our child."""
        if status is not None or not (self.told or self.wanted_down()):
            return status == 0
        return took_leave(self.run)

    def _rest(self, pause_s: float) -> None:
        """Wait so long, unless we are told to stop meanwhile."""
        until = time.monotonic() + pause_s
        while not self.told and (left := until - time.monotonic()) > 0:
            select.select([self.wakeup], [], [], left)
            with contextlib.suppress(BlockingIOError):
                os.read(self.wakeup, 4096)
            self.reap()

    def keep(self) -> int:
        """Keep a sentinel running until it ends as asked. Returns the exit code."""
        words = b""
        while True:
            began = time.monotonic()
            if not self.attach():
                self.start()
            say(words)  # only now: nothing that takes words may keep a guard from coming
            if self.told:
                self.forward()
            status = self.wait()
            if self.ended_as_told(status):
                return 0
            if status == UNUSABLE:
                return 1
            # One that died while stopping left its work half done: the next one goes on with it.
            if status == ANOTHER_WATCHES:
                words = b""
                self._rest(PAUSE_S)
            else:
                words = b"The sentinel ended; another was started.\n"
                self._rest(self.pace.pause_s(began, time.monotonic()))


def main() -> int:
    """Run the launcher."""
    data, run, listen_fd, url = sys.argv[1:5]
    keep_descriptors()
    ctypes.CDLL(None, use_errno=True).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    return Launcher(data, run, int(listen_fd), url).keep()


if __name__ == "__main__":
    sys.exit(main())
