"""Looks at one gateway from outside: its page and what the kernel says of it, tick by tick, and what it leaves behind.

The eyes of the gatekeeper: nothing is decided here and nobody is touched. A gateway whose page can't be read is looked at
all the same; then only the kernel's word counts, and what that alone can show (`sentinel/gateway_verdict`).
"""

import asyncio
from collections.abc import Mapping
from pathlib import Path

import msgspec
from msgspec import structs

from hardcore.host import clock, files, memory, processes, vitals
from hardcore.host.gateway_page import FILE_BYTES, GatewayPageReader, decode
from hardcore.host.processes import Handle, Identity
from hardcore.model.gateway import GatewayPage, GatewayPulse
from hardcore.model.looks import ProcessSample
from hardcore.model.observations import Exit
from hardcore.model.verdicts import Verdict
from hardcore.recovery.budget import NS_PER_S
from hardcore.sentinel.gateway_verdict import GatewayBench
from hardcore.sentinel.patience import Patience
from hardcore.snapshot.form import as_bytes

#: Threads cost some reads each: only beats that are this late are worth them.
STALE_NS = 250_000_000
#: The launcher writes down how an orphan ended about as soon as we see that it did.
STATUS_S, STATUS_LOOKS = 0.05, 10
_MS = 1_000_000


class Remains(msgspec.Struct, frozen=True):
    """What a gateway has left. `oom_kills`: how often the kernel killed for memory in its life; None: nobody can tell."""

    pid: int
    start: int
    raw: bytes
    page: GatewayPage | None
    sample: ProcessSample | None
    oom_kills: int | None
    grown_bytes: int = 0  # more memory than when we saw it first

    @property
    def parsing(self) -> frozenset[str]:
        """The paths that it was reading."""
        return self.page.parsing() if self.page is not None else frozenset()

    def files(
        self, at_ns: int, ended: str, how: Exit | None, refused: tuple[str, ...] = ()
    ) -> Mapping[str, bytes]:
        """Return it as files of evidence. `ended`: "died", or the diagnosis of one that stood still."""
        told = {
            "taken_at_ns": at_ns,
            "pid": self.pid,
            "start": self.start,
            "ended": ended,
            "exit": structs.asdict(how) if how is not None else None,
            "oom_kills": self.oom_kills,
            "refused_paths": list(refused),
            "last_sample": msgspec.to_builtins(self.sample) if self.sample is not None else None,
            **self._of_the_page(at_ns),
        }
        raw = {"gateway.bin": self.raw} if len(self.raw) == FILE_BYTES else {}
        return {"gateway.json": as_bytes(told), **raw}

    def _of_the_page(self, at_ns: int) -> dict[str, object]:
        if self.page is None:
            return {"beats": None, "requests": []}
        requests = [
            {**structs.asdict(one), "stage": one.stage.name, "age_ms": max(0, at_ns - one.since_ns) // _MS}
            for one in self.page.requests
        ]
        return {"beats": structs.asdict(self.page.pulse), "requests": requests}


def remains_before(path: Path) -> Remains | None:
    """Return what a gateway has left of which only its page is known; None: no page tells of one, or it lives."""
    reader = GatewayPageReader(path)
    raw = reader.raw()
    reader.close()
    page = decode(raw)
    if page is None or not page.pulse.pid:
        return None
    living = processes.find(Identity(page.pulse.pid, page.pulse.start))
    if living is not None:
        living.close()
        return None
    return Remains(page.pulse.pid, page.pulse.start, raw, page, None, None)


async def end_of_orphan(exits: Path, pid: int, since_ns: int) -> Exit:
    """Return how a gateway ended that is no child of ours, as its launcher has written it; empty if nobody says."""
    for _ in range(STATUS_LOOKS):
        match files.read_json(exits / str(pid)):
            case {"status": int(status), "at_ns": int(when)} if when >= since_ns - NS_PER_S:
                return Exit(code=status) if status >= 0 else Exit(signal=-status)
            case _:
                await asyncio.sleep(STATUS_S)
    return Exit()


class GatewayWatch:
    """Looks at the gateway behind `handle`, whose page is at `path`. `due_ns`: from then on it has to beat."""

    def __init__(self, handle: Handle, path: Path, patience: Patience, due_ns: int) -> None:
        self.handle = handle
        self.pulse: GatewayPulse | None = None
        self._reader = GatewayPageReader(path)
        self._bench = GatewayBench(patience, due_ns)
        self._oom = memory.oom_counter(handle.pid)
        self._sample: ProcessSample | None = None
        self._first: ProcessSample | None = None

    def look(self) -> Verdict:
        """Return what is to be said of it now."""
        self.pulse = self._read()
        self._sample = self.handle.sample(self._wanted(clock.now_ns()))
        self._first = self._first or self._sample
        at_ns, others = clock.together()
        return self._bench.judge(at_ns, self.pulse, self._sample, others)

    def has_beaten_since(self, at_ns: int) -> bool:
        """Return whether its loop has turned since then."""
        pulse = self._read()
        return pulse is not None and pulse.loop_ns > at_ns

    def remains(self) -> Remains:
        """Return what it leaves, or would leave if it ended now."""
        raw = self._reader.raw()
        who = self.handle.identity
        page = decode(raw)
        if page is not None and (page.pulse.pid, page.pulse.start) != (who.pid, who.start):
            page, raw = None, b""  # it ended before it had a page of its own
        oom_kills = self._oom.risen() if self._oom is not None else None
        grown_bytes = self._sample.rss_bytes - self._first.rss_bytes if self._sample and self._first else 0
        return Remains(who.pid, who.start, raw, page, self._sample, oom_kills, grown_bytes)

    def close(self) -> None:
        """Give the page back."""
        self._reader.close()

    def _read(self) -> GatewayPulse | None:
        who = self.handle.identity
        return self._reader.pulse(who.pid, who.start)

    def _wanted(self, now_ns: int) -> vitals.Wanted:
        pulse = self.pulse
        if pulse is None or now_ns - min(pulse.loop_ns, pulse.thread_ns) <= STALE_NS:
            return vitals.Wanted()
        busy = now_ns - max(pulse.loop_ns, pulse.thread_ns) > STALE_NS
        return vitals.Wanted(loop=pulse.loop_thread, beat=pulse.beat_thread, busy=busy)
