"""One life of the core as the guard holds it: a nonce, a recorder page, sockets, a process.

A life's files are never reused: the page of a dead core stays what it was at its death. A life that an
earlier guard left behind is one too (`leftovers.py` finds it).
"""

import os
import secrets
import sys
from collections.abc import Iterable
from pathlib import Path

import msgspec

from hardcore.host import clock, files, logs, memory, processes, vitals
from hardcore.host.folders import Folders
from hardcore.host.processes import Handle
from hardcore.host.recorder import PageReader, make_page
from hardcore.host.said import LogEnd
from hardcore.host.steps import BRAND
from hardcore.model.looks import ProcessSample
from hardcore.model.observations import Exit, Sampled
from hardcore.model.recorder import Beats, CommandNote, ComponentBeat, Page, SlotStage, Threads, Witness

#: Files of so many dead lives are kept in the run folder, for whoever still reads them.
DEAD_LIVES_KEPT = 2
#: Commands in flight are read only while some wait this long after the last one was completed.
LOOK_CLOSER_NS = 200_000_000
#: They are read every so often while any wait, whatever is completed beside them.
IN_FLIGHT_EVERY_TICKS = 5
#: The thread samples cost three reads each: only a beat this old is worth them.
STALE_NS = 80_000_000
#: All threads are counted through only while neither beat goes on, for this long.
BOTH_STALE_NS = 200_000_000
FDS_EVERY_TICKS = 10
COMPONENTS_EVERY_TICKS = 10
#: A killed process that is not gone after this hangs in the kernel; waiting longer would not help.
KILL_S = 2.0

_PASSED_ON = ("PATH", "HOME", "LANG", "LC_ALL", "TZ", "TMPDIR")

#: Passed from `hardcore up --demo` to each sentinel of that launcher: pages of this address may break the core.
DEMO_SWITCH = "HARDCORE_DEMO"


def _is_slow(note: CommandNote, now_ns: int) -> bool:
    return note.stage is SlotStage.DECIDING and now_ns - max(note.stage_ns, note.progress_ns) > LOOK_CLOSER_NS


def clean_environment() -> dict[str, str]:
    """Return what a process of ours inherits: nothing that could change how Python behaves."""
    kept = {name: os.environ[name] for name in _PASSED_ON if name in os.environ}
    return {"PATH": "/usr/bin:/bin", **kept}


class Life(msgspec.Struct):
    """A core's life. `number` counts from 1 in one guard; 0 is one that an earlier guard left behind."""

    number: int
    nonce: str
    folders: Folders
    reader: PageReader | None = None
    handle: Handle | None = None
    sample: ProcessSample | None = None
    fds: int | None = None  # from the last time they were counted
    oom: memory.OomCounter | None = None
    confined: memory.Confined | None = None
    log: Path | None = None  # what it says goes there
    log_end: LogEnd | None = None
    spare: bool = False  # it was started as one and has not been promoted
    ended: bool = False  # its end was seen
    adopted_ns: int = 0  # since when it is this guard's, if another one started it
    build: str = ""  # the name of the code that it runs, once it is known
    schema: int | None = None  # of the store as it found it, if it said so
    _ticks: int = 0
    _threads: Threads = msgspec.field(default_factory=Threads)
    _one_is_slow: bool = False

    def look(self) -> Sampled:
        """Return what can be seen of the core now."""
        now_ns = clock.now_ns()
        seen = self.reader.look() if self.reader else None
        beats, witness = (None, None) if seen is None else seen
        in_flight = self._in_flight(beats, now_ns)
        self._ticks += 1
        if self.handle is not None:
            self.sample = self.handle.sample(self._wanted(beats, in_flight, now_ns))
            if self.sample is not None and self.sample.fds is not None:
                self.fds = self.sample.fds
        page_fault = self.reader.why_blind() if self.reader is not None and beats is None else ""
        process_fault = _why_unseen(self.handle) if self.handle is not None and self.sample is None else ""
        at_ns, others = clock.together()
        return Sampled(
            at_ns, self.number, beats, self._threads, self.sample, in_flight, witness, others,
            page_fault, process_fault, self._components(),
        )  # fmt: skip

    def _components(self) -> tuple[ComponentBeat, ...]:
        """Return the beats of the core's parts, now and then: their limits are seconds."""
        if self.reader is None or self._ticks % COMPONENTS_EVERY_TICKS != 1:
            return ()
        return self.reader.components()

    def glance(self) -> Sampled:
        """Return what tells whether a core that only waits is well: its beats, and what the kernel calls it."""
        seen = self.reader.look() if self.reader else None
        if self.handle is not None:
            self.sample = self.handle.sample(vitals.Wanted())
        at_ns, others = clock.together()
        beats, witness = (None, None) if seen is None else seen
        return Sampled(at_ns, self.number, beats, self._threads, self.sample, None, witness, others)

    def _in_flight(self, beats: Beats | None, now_ns: int) -> tuple[CommandNote, ...] | None:
        """Return the commands in flight if they are worth their reading: some wait, and not for the first time.

        Others may be completed all the while a single one hangs, so now and then they are read anyhow, and at
        every tick as long as one of them is being decided for long.
        """
        if beats is None or self.reader is None or not beats.waiting:
            self._one_is_slow = False
            return None
        due = self._one_is_slow or self._ticks % IN_FLIGHT_EVERY_TICKS == 0
        if not due and now_ns - beats.completed_ns <= LOOK_CLOSER_NS:
            return None
        notes = self.reader.in_flight()
        self._one_is_slow = any(_is_slow(note, now_ns) for note in notes or ())
        return notes

    def _wanted(
        self, beats: Beats | None, in_flight: tuple[CommandNote, ...] | None, now_ns: int
    ) -> vitals.Wanted:
        fds = self._ticks % FDS_EVERY_TICKS == 1
        if self.reader is None:
            return vitals.Wanted(fds=fds)
        if beats is None:  # without them the kernel is all there is to ask
            return vitals.Wanted(self._threads.loop, self._threads.writer, self._threads.beat, fds=fds)
        if not (self._threads.writer and self._threads.beat):  # those that run last are told last
            self._threads = self.reader.threads()
        if in_flight is None and now_ns - min(beats.loop_ns, beats.thread_ns) <= STALE_NS:
            return vitals.Wanted(fds=fds)
        deciding = [
            note.thread for note in in_flight or () if note.stage is SlotStage.DECIDING and note.thread
        ]
        who = self._threads
        busy = now_ns - max(beats.loop_ns, beats.thread_ns) > BOTH_STALE_NS
        return vitals.Wanted(who.loop, who.writer, who.beat, tuple(dict.fromkeys(deciding)), fds, busy)

    def page(self) -> Page | None:
        """Return the whole recorder page, or None if it is no evidence."""
        page = self.reader.read() if self.reader else None
        return page if isinstance(page, Page) else None

    def named(self) -> dict[str, object]:
        """Return who this is, under what it is, for the file of the guard's steps."""
        assert self.handle is not None, "only a process is named"
        who = {"pid": self.handle.pid, "start": self.handle.identity.start, "nonce": self.nonce}
        return {"spare": who} if self.spare else {"core": who}

    def orphans_exit(self) -> Exit | None:
        """Return how a core that is no child of ours ended, if the launcher has written it down yet."""
        assert self.handle is not None, "only a process ends"
        told = files.read_json(self.folders.exits / str(self.handle.pid))
        match told:
            case {"status": int(status), "at_ns": int(at_ns)} if at_ns >= self.adopted_ns:
                return Exit(code=status) if status >= 0 else Exit(signal=-status)
            case _:
                return None

    def oom_kills(self) -> int | None:
        """Return how often the kernel has killed for want of memory since this life began; None: nobody can tell."""
        return None if self.oom is None else self.oom.risen()

    def said(self, how: Exit) -> str:
        """Return what a core that left by itself, and not well, has said last; empty if that is not known."""
        return self.log_end.last_said() if self.log_end is not None and how.code else ""

    def confine(self) -> str:
        """Give the core a memory group of its own; return why that can't be done, empty when it is."""
        assert self.handle is not None, "only a process can be confined"
        if self.confined is not None:
            return ""
        made = memory.confine(self.handle.pid)
        if isinstance(made, str):
            return made
        self.confined = made
        self.oom = memory.oom_counter(self.handle.pid)
        return ""

    def dissolve(self) -> None:
        """Remove the memory group that the core had to itself, if nobody is in it any more."""
        if self.confined is not None and memory.dissolve(self.confined):
            self.confined = None

    def let_go(self) -> None:
        """Give back the descriptors of a life that is over."""
        if self.reader is not None:
            self.reader.close()
        if self.handle is not None:
            self.handle.close()
        if self.log_end is not None:
            self.log_end.close()

    def discard(self) -> None:
        """Give everything back and remove the life's files."""
        self.let_go()
        self.dissolve()
        for path in _files(self.folders, self.nonce):
            path.unlink(missing_ok=True)


def _files(folders: Folders, nonce: str) -> tuple[Path, ...]:
    page = folders.recorder(nonce)
    return (
        page,
        page.with_name(f"{page.name}.stacks"),
        page.with_name(f"{page.name}{BRAND}"),
        folders.core_socket(nonce),
        folders.core_control(nonce),
    )


def new_nonce() -> str:
    """Return a name for a life that nobody has had."""
    return secrets.token_hex(8)


def conceive(folders: Folders, number: int, nonce: str = "") -> Life:
    """Return a new life with its recorder page made. Raises OSError when there is no room for it."""
    nonce = nonce or new_nonce()
    path = folders.recorder(nonce)
    make_page(path, nonce, clock.boot_id())
    return Life(number, nonce, folders, PageReader(path, nonce))


class CoreLimits(msgspec.Struct, frozen=True):
    """What a core is told of the policy: how long a command may be decided, how much memory is its own, its checkpoints.

    `recovers_state`: whether a start goes by a checkpoint.
    """

    command_ms: int
    memory_bytes: int
    checkpoint_s: int = 60
    checkpoints_kept: int = 10
    checkpoint_age_h: int = 24
    recovers_state: bool = True

    def told(self) -> dict[str, str]:
        """Return them as a core reads them."""
        return {
            "HARDCORE_LIMIT_MS": str(self.command_ms),
            "HARDCORE_MEMORY_BYTES": str(self.memory_bytes),
            "HARDCORE_CHECKPOINT_S": str(self.checkpoint_s),
            "HARDCORE_CHECKPOINTS_KEPT": str(self.checkpoints_kept),
            "HARDCORE_CHECKPOINT_AGE_H": str(self.checkpoint_age_h),
            "HARDCORE_STATE_RECOVERY": "1" if self.recovers_state else "0",
        }


class Terms(msgspec.Struct, frozen=True):
    """What a core is started for: on which epoch and which commits, to read only (`safe`: why), or as a spare.

    A spare is told the epoch and the commits when it is promoted, and not before.
    """

    expected_epoch: int | None = None
    witnesses: tuple[Witness, ...] = ()
    safe: str | None = None
    spare: bool = False


def as_words(witnesses: Iterable[Witness]) -> list[str]:
    """Return commits as a core reads them."""
    return [f"{each.seq}:{each.epoch}:{each.hash}" for each in witnesses]


def start(
    life: Life,
    terms: Terms,
    watchdog_usec: int,
    limits: CoreLimits | None = None,
    listen_fd: int | None = None,
) -> Handle:
    """Start the core of this life. Raises OSError when no process can be made.

    `listen_fd`: the gateway's listener, which the core keeps for the sentinel that its agent may have to start.
    """
    folders = life.folders
    environment = {
        **clean_environment(),
        "HARDCORE_DATA": str(folders.data),
        "HARDCORE_SOCKET": str(folders.core_socket(life.nonce)),
        "HARDCORE_RECORDER": str(folders.recorder(life.nonce)),
        "HARDCORE_CONTROL": str(folders.core_control(life.nonce)),
        "HARDCORE_QUARANTINE": str(folders.quarantine),
        "NOTIFY_SOCKET": str(folders.notify),
        "WATCHDOG_USEC": str(watchdog_usec),
    }
    environment |= _told(terms)
    if limits is not None:
        environment |= limits.told()
    fds = () if listen_fd is None else (listen_fd,)
    if listen_fd is not None:
        environment |= {"HARDCORE_AGENTS": str(folders.agents), "HARDCORE_LISTEN_FD": str(listen_fd)}
    argv = [sys.executable, "-I", "-m", "core", "serve", "--data", str(folders.data)]
    life.log = logs.place(folders.logs / "core.log", folders.run)
    life.log_end = LogEnd(life.log)
    life.handle = processes.spawn(argv, environment, life.log, folders.data, fds=fds)
    life.oom = memory.oom_counter(life.handle.pid)
    return life.handle


def _told(terms: Terms) -> dict[str, str]:
    if terms.spare:
        return {"HARDCORE_SPARE": "1"}
    told = {"HARDCORE_EPOCH": "" if terms.expected_epoch is None else str(terms.expected_epoch)}
    if terms.witnesses:
        told["HARDCORE_WITNESS"] = ",".join(as_words(terms.witnesses))
    if terms.safe is not None:
        told["HARDCORE_SAFE"] = terms.safe
    return told


def _why_unseen(handle: Handle) -> str:
    """Return why nothing is known of a process that nobody has told us is gone (one that ended is still there)."""
    try:
        vitals.stat_fields(handle.pid)
    except OSError as error:
        return f"/proc can't be read: {error.strerror}."
    except ValueError:
        return "/proc makes no sense."
    return "/proc could not be read a moment ago."


def sweep(folders: Folders, living: set[str], keep: int = DEAD_LIVES_KEPT) -> None:
    """Remove the files of dead lives that nobody needs any more, but for the `keep` youngest.

    A life that never had an epoch (a spare, mostly) is older than all others: its page is nobody's witness.
    """
    pages = [page for page in folders.run.glob("recorder-*") if not page.suffix]
    pages.sort(key=lambda page: (_had_epoch(page), _written_ns(page)), reverse=True)
    nonces = [page.name.removeprefix("recorder-") for page in pages]
    for nonce in [n for n in nonces if n not in living][keep:]:
        for path in _files(folders, nonce):
            path.unlink(missing_ok=True)


def _written_ns(path: Path) -> int:
    """Return when a file was written last; 0 if it has gone meanwhile: a dead life is buried on another thread."""
    try:
        return path.stat().st_mtime_ns
    except FileNotFoundError:
        return 0


def _had_epoch(path: Path) -> bool:
    """Return whether the core of this page ever began to write."""
    reader = PageReader(path)
    beats = reader.beats()
    reader.close()
    return beats is not None and beats.epoch > 0
