"""The gateway's agent: watches the sentinel from a thread of its own, and starts another when it is lost.

The launcher is quicker; the agent is for when there is none, and for a sentinel that stands still. It starts what the
sentinel itself has left word of, as an orphan, and never takes its lock: of several that were started the one that gets
the lock goes on. It can't know whether a start was needed, only that nobody watches; so what it may do is bounded by the
operator's will, by the policy, and by a budget that outlives this process. It is worth nothing in a process that hangs;
the gateway has one too. It acts first and speaks after, into the run folder, which is memory: a log on a disk that hangs
would hold it, and with it whoever else writes there. Not chosen: a signal to a sentinel whose identity was not proven,
whatever it looks like.
"""

import contextlib
import fcntl
import json
import logging
import os
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from hardcore.crisis import sentinel_seen
from hardcore.crisis.agent_table import LOOK_NS, Finding, Seen, Table
from hardcore.crisis.sentinel_seen import Held, Orders

SIDE: Final = "gateway"
NS_PER_S: Final = 1_000_000_000
#: One that was started has this long to take the lock, until another is tried.
START_NS: Final = 5 * NS_PER_S
#: While the launcher lives, which starts one at once, an agent waits so many times as long: on a busy machine that start
#: takes a second, and one that comes in vain is an act that the next loss may need.
LAUNCHED_TIMES: Final = 4
#: Where the listener is in what is started.
LISTENER: Final = 3
#: Where the agents and what they start speak, beside the orders; the sentinel keeps it in its bounds.
SAID: Final = "sentinel.out"

logger = logging.getLogger("agent")


class Agent:
    """Looks four times a second. `orders`: the file of the sentinel's last word; `listen_fd`: the listener, or a duplicate."""

    def __init__(self, orders: Path, listen_fd: int) -> None:
        self._path, self._listen_fd = orders, listen_fd
        self._read: tuple[int, int] | None = None
        self._orders: Orders | None = None
        self._held: Held | None = None
        self._table = Table()
        self._budget = orders.with_name(f"agent-budget-{SIDE}.json")
        self._acts_ns: list[int] = []
        self._ended = ""  # whose end has paid for the start that follows it
        self._not_before_ns: int | None = None
        self._said = ""

    def start(self) -> None:
        """Watch from now on, on a daemon thread."""
        threading.Thread(target=self._run, name="agent", daemon=True).start()

    def _run(self) -> None:
        pause = threading.Event()
        while True:
            try:
                self.look(time.monotonic_ns())
            except (OSError, ValueError, TypeError, OverflowError) as error:
                # No descriptor is left, /proc is not to be read, a file says what no file of ours says: nobody can tell.
                self._say(f"The sentinel can't be watched now ({error}).")
            if self._held is None or self._held.gone:
                pause.wait(LOOK_NS / NS_PER_S)
            else:
                self._held.ends_within(LOOK_NS)

    def look(self, now_ns: int) -> None:
        """Look once, and do what follows. Raises OSError when nobody can tell."""
        orders = self._heed()
        if orders is None:
            return
        assert self._held is not None, "who is meant is held, dead or alive"
        gone = self._held.gone
        beats = None if gone else sentinel_seen.beats(orders)
        late = beats is not None and now_ns - beats[0] > orders.stale_ns // 2
        body = sentinel_seen.body(orders.pid) if late else None
        match self._table.judge(Seen(now_ns, gone, beats, body), orders.stale_ns, orders.after_ns):
            case Finding.WELL:
                self._not_before_ns = None
            case Finding.FROZEN:
                self._end(orders, now_ns)
            case Finding.DEAD:
                self._replace(orders, now_ns)

    def _heed(self) -> Orders | None:
        """Return the sentinel's last word, and hold whom it names."""
        try:
            about = self._path.stat()
            if self._read != (about.st_ino, about.st_mtime_ns):
                told = sentinel_seen.read_orders(self._path)
                self._read = (about.st_ino, about.st_mtime_ns)
                self._orders = told if told is not None else self._orders
        except FileNotFoundError:
            # Taken back by one that ended as it was told: nobody is to come. Where the run folder was removed, so was
            # the name beside it, and the last word still holds.
            if sentinel_seen.has_taken_leave(self._path):
                self._read = self._orders = None
        orders, held = self._orders, self._held
        if orders is not None and (held is None or (held.pid, held.start) != (orders.pid, orders.start)):
            self._held = Held(orders.pid, orders.start)
            self._table, self._not_before_ns = Table(), None
            if held is not None:
                held.let_go()
        return orders

    def _end(self, orders: Orders, now_ns: int) -> None:
        """End one that stands still, if another may be started; the two are one act."""
        if self._held is None or not self._may(orders, now_ns):
            return
        if self._ended != orders.nonce:
            self._ended = orders.nonce
            self._acts_ns.append(now_ns)
            self._note(orders.nonce)
        self._held.end()
        self._say(f"The sentinel (process {orders.pid}) stood still and was ended.")

    def _replace(self, orders: Orders, now_ns: int) -> None:
        """Start another, if nobody else has in the meantime."""
        if self._not_before_ns is None:
            times = LAUNCHED_TIMES if sentinel_seen.is_held(orders.launcher) else 1
            self._not_before_ns = now_ns + times * orders.after_ns
        if (
            now_ns < self._not_before_ns
            or sentinel_seen.is_held(orders.lock)
            or self._another_began(orders, now_ns)
            or not self._may(orders, now_ns)
        ):
            return
        self._not_before_ns = now_ns + START_NS
        if self._ended != orders.nonce:
            self._acts_ns.append(now_ns)
            self._note(None, orders.nonce)
        self._ended = ""  # a second start for the same one is an act of its own
        begin(orders, self._listen_fd)
        self._say(f"The sentinel (process {orders.pid}) is gone and nobody watches: another was started.")

    def _another_began(self, orders: Orders, now_ns: int) -> bool:
        """Whether another process of our side (a core and its spare are two) has just started one for this very loss."""
        kept = sentinel_seen.read_object(self._budget)
        return kept.get("lost") == orders.nonce and any(now_ns - at < START_NS for at in _stamps(kept))

    def _may(self, orders: Orders, now_ns: int) -> bool:
        stamps = {*self._acts_ns, *_stamps(sentinel_seen.read_object(self._budget))}
        self._acts_ns = sorted(at for at in stamps if 0 <= now_ns - at < orders.window_ns)
        wished = orders.sentinel_lost or (orders.gateway_lost and sentinel_seen.gateway_is_gone(orders.run))
        paid = self._ended == orders.nonce
        return (
            wished
            and (paid or len(self._acts_ns) < orders.starts_max)
            and not sentinel_seen.is_down(orders.wanted)
        )

    def _note(self, ended: str | None, lost: str | None = None) -> None:
        """Leave word for the other cores' agents, and for the next sentinel: `ended` stood still, `lost` was replaced."""
        kept = sentinel_seen.read_object(self._budget)
        told = {"version": 1, "acts_ns": self._acts_ns, "ended": ended or kept.get("ended"), "lost": lost}
        draft = self._budget.with_name(f".{self._budget.name}.{threading.get_native_id()}.tmp")
        with contextlib.suppress(OSError):  # the budget in memory holds all the same
            draft.write_text(json.dumps(told), "ascii")
            draft.replace(self._budget)

    def _say(self, words: str) -> None:
        """Say once what has happened, where no disk is asked."""
        if words == self._said:
            return
        self._said = words
        line = f"{time.strftime('%Y-%m-%dT%H:%M:%SZ', time.gmtime())} agent in the {SIDE}: {words}\n"
        with contextlib.suppress(OSError):
            fd = os.open(
                self._path.with_name(SAID), os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o600
            )
            try:
                os.write(fd, line.encode())
            finally:
                os.close(fd)


def _stamps(kept: Mapping[str, object]) -> list[int]:
    found = kept.get("acts_ns")
    return [at for at in found if isinstance(at, int)] if isinstance(found, list) else []


def begin_if_told(orders: Path | None, listen_fd: int | None) -> None:
    """Watch the sentinel from now on, if there is word of it and the listener to hand on."""
    if orders is None or listen_fd is None:
        return
    try:
        # A duplicate that nobody else closes, and that nothing we start inherits by chance.
        os.set_inheritable(listen_fd, False)
        kept = fcntl.fcntl(listen_fd, fcntl.F_DUPFD_CLOEXEC, LISTENER)
    except OSError as error:
        logger.warning("Without the listener the sentinel is not watched (%s).", error.strerror)
        return
    Agent(orders, kept).start()


def begin(orders: Orders, listen_fd: int) -> None:
    """Start what was left word of, with nothing of ours but the listener. Raises OSError when it can't be started."""
    argv = [str(LISTENER) if word == "{listen_fd}" else word for word in orders.argv]
    # On itself, too, this takes the mark away that would have it closed.
    listener = (os.POSIX_SPAWN_DUP2, listen_fd, LISTENER)
    quiet = (os.POSIX_SPAWN_OPEN, 0, os.devnull, os.O_RDONLY, 0)
    starter = os.posix_spawn(argv[0], argv, dict(orders.environment), file_actions=[listener, quiet])
    with contextlib.suppress(ChildProcessError):  # somebody else has waited for it
        os.waitpid(starter, 0)  # it forks and ends
