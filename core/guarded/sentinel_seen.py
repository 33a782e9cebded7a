"""What can be found out about the sentinel from inside this process: what it has left word of, its beats, its body.

Three sources that lie in three ways: a file that the sentinel wrote at its start, a page that it beats into, and the
kernel, which alone can't be wrong about who ran. None of them is asked with a signal, and nothing is held but a pidfd.
`None` always means "nobody can tell", which is never taken for death. Not chosen: to ask the sentinel's socket; one that
is busy would be late there, and one that is stopped still has its connections accepted by the kernel.
"""

import json
import os
import select
import signal
import struct
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec

from core.guarded.agent_table import Body

FILE_BYTES_MAX = 1 << 20
THREADS_MAX = 128
NS_PER_MS = 1_000_000
_PAGE = struct.Struct("<8s7Q32s")
_MAGIC = b"HCSENT01"
_GATEWAY_WHO = struct.Struct("<2Q")
_GATEWAY_WHO_AT = 32


class Orders(msgspec.Struct, frozen=True):
    """What the sentinel has left word of (docs/wires.md section 17). Times in nanoseconds."""

    pid: int
    start: int
    nonce: str
    run: Path
    page: Path
    lock: Path
    wanted: Path
    launcher: Path
    argv: tuple[str, ...]
    sentinel_lost: bool
    gateway_lost: bool
    after_ns: int
    stale_ns: int
    starts_max: int
    window_ns: int
    environment: Mapping[str, str] = {}


def read_orders(path: Path) -> Orders | None:
    """Return what stands there; None: nothing that can be understood."""
    told = read_object(path)
    try:
        who, budget = told["sentinel"], told["budget"]
        return Orders(
            pid=int(who["pid"]),
            start=int(who["start"]),
            nonce=str(who["nonce"]),
            run=path.parent,
            page=Path(told["page"]),
            lock=Path(told["lock"]),
            wanted=Path(told["wanted"]),
            launcher=Path(told["launcher"]),
            argv=tuple(map(str, told["argv"])),
            sentinel_lost=told["sentinel_lost"] is True,
            gateway_lost=told["gateway_lost"] is True,
            after_ns=int(told["after_ms"]) * NS_PER_MS,
            stale_ns=int(told["stale_ms"]) * NS_PER_MS,
            starts_max=int(budget["limit"]),
            window_ns=int(budget["window_s"]) * 1000 * NS_PER_MS,
            environment={str(name): str(value) for name, value in told["environment"].items()},
        )
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError):
        return None


def has_taken_leave(orders: Path) -> bool:
    """Whether the orders were taken back by their sentinel: its name is left beside them, which is never taken back."""
    return orders.with_name("sentinel.json").exists()


def read_object(path: Path) -> dict[str, Any]:
    """Return the JSON object at `path`; empty when there is none, or none that can be read."""
    try:
        with path.open("rb") as file:
            value = json.loads(file.read(FILE_BYTES_MAX))
    except (OSError, ValueError, RecursionError):
        return {}
    return value if isinstance(value, dict) else {}


class Held:
    """The sentinel that is meant, by a pidfd that can't come to mean another. `gone`: it was there, and is no more."""

    def __init__(self, pid: int, start: int) -> None:
        """Hold it: the descriptor first, and only then is it asked who that is. Raises OSError: nobody can tell."""
        self.pid, self.start = pid, start
        self.pidfd = -1
        try:
            self.pidfd = os.pidfd_open(pid)
        except ProcessLookupError:
            return
        try:
            fields = _stat(pid)
        except OSError:
            self.let_go()
            raise
        if fields is None or int(fields[19]) != start:
            self.let_go()  # the number is a stranger's

    @property
    def gone(self) -> bool:
        """Whether it has ended: its number is free, another's, or its descriptor says so."""
        return self.pidfd < 0 or self.ends_within(0)

    def ends_within(self, limit_ns: int) -> bool:
        """Wait so long for its end; return whether it has come."""
        waiting = (
            select.poll()
        )  # not `select`: a process of many connections has descriptors beyond its reach
        waiting.register(self.pidfd, select.POLLIN)
        return bool(waiting.poll(limit_ns // NS_PER_MS))

    def end(self) -> None:
        """Kill it; whoever has its number by now is not meant."""
        with suppress(ProcessLookupError):
            signal.pidfd_send_signal(self.pidfd, signal.SIGKILL)

    def let_go(self) -> None:
        """Give the descriptor back."""
        if self.pidfd >= 0:
            os.close(self.pidfd)
            self.pidfd = -1


def beats(orders: Orders) -> tuple[int, int] | None:
    """Return the last beats of loop and thread; None: there is no page, or it is another sentinel's."""
    try:
        with orders.page.open("rb") as file:
            magic, _generation, pid, start, began, loop, _count, thread, _nonce = _PAGE.unpack(
                file.read(_PAGE.size)
            )
    except (OSError, struct.error):
        return None
    if magic != _MAGIC or (pid, start) != (orders.pid, orders.start):
        return None
    return max(began, loop), max(began, thread)


def body(pid: int) -> Body | None:
    """Return what the kernel says of a process that is held; None: it can't be seen whole."""
    try:
        tids = os.listdir(f"/proc/{pid}/task")  # noqa: PTH208  # names alone, no objects
        if len(tids) > THREADS_MAX:
            return None
        threads = {int(tid): _thread(f"/proc/{pid}/task/{tid}/status") for tid in tids}
    except (OSError, ValueError, KeyError, IndexError):
        return None
    states = {state for state, _turns in threads.values()}
    loop_state, loop_turns = threads.get(pid, ("", 0))
    return Body(
        stopped=states <= {"T", "t"},
        asleep=states <= {"S"},
        turns=sum(turns for _state, turns in threads.values()),
        loop_asleep=loop_state == "S",
        loop_turns=loop_turns,
    )


def _thread(path: str) -> tuple[str, int]:
    told = dict(line.partition(":")[::2] for line in Path(path).read_text().splitlines())
    turns = int(told["voluntary_ctxt_switches"]) + int(told["nonvoluntary_ctxt_switches"])
    return told["State"].split()[0], turns


def _stat(pid: int) -> list[str] | None:
    """Return what the kernel says of a number, from the third field on; None: nobody has it."""
    try:
        return Path(f"/proc/{pid}/stat").read_text(errors="replace").rpartition(")")[2].split()
    except (FileNotFoundError, ProcessLookupError):
        return None


def is_held(lock: Path) -> bool:
    """Whether somebody holds the sentinel's lock, from the kernel's table: to try it would be to take it.

    Where that table can't be read nobody is seen to hold it. It is asked only of a sentinel that is certainly dead, and
    another that comes in vain ends at once; nobody coming would be worse.
    """
    try:
        about = lock.stat()
        table = Path("/proc/locks").read_text()
    except OSError:
        return False
    where = f"{os.major(about.st_dev):02x}:{os.minor(about.st_dev):02x}:{about.st_ino}"
    return any(
        words[1] == "FLOCK" and words[5] == where
        for words in map(str.split, table.splitlines())
        if len(words) == 8
    )


def is_down(wanted: Path) -> bool:
    """Whether the operator wants everything stopped."""
    return read_object(wanted).get("wanted") == "DOWN"


def gateway_is_gone(run: Path) -> bool:
    """Whether the gateway that has this page is no more; one that nobody can tell of is not gone."""
    try:
        with (run / "gateway.page").open("rb") as file:
            pid, start = _GATEWAY_WHO.unpack(os.pread(file.fileno(), _GATEWAY_WHO.size, _GATEWAY_WHO_AT))
        if not pid:
            return False
        held = Held(pid, start)
    except (OSError, struct.error):
        return False
    try:
        return held.gone
    finally:
        held.let_go()
