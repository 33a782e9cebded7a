"""Looks at one gateway from outside: its page and what the kernel says of it, tick by tick, and what it leaves behind.

The eyes of the gatekeeper: nothing is decided here and nobody is touched. A gateway whose page can't be read is looked at
all the same; then only the kernel's word counts, and what that alone can show (`sentinel/gateway_verdict`).
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from hardcore.host import clock, memory, vitals
from hardcore.host.gateway_page import FILE_BYTES, GatewayPageReader, decode
from hardcore.host.processes import Handle
from hardcore.model.gateway import GatewayPage, GatewayPulse
from hardcore.model.looks import ProcessSample
from hardcore.model.observations import Exit
from hardcore.model.verdicts import Verdict
from hardcore.sentinel.gateway_verdict import GatewayBench
from hardcore.sentinel.patience import Patience
from hardcore.snapshot.form import as_bytes

#: Threads cost some reads each: only beats that are this late are worth them.
STALE_NS = 250_000_000
_MS = 1_000_000


@dataclass(frozen=True, slots=True)
class Remains:
    """What a gateway has left. `oom_kills`: how often the kernel killed for memory in its life; None: nobody can tell."""

    pid: int
    start: int
    raw: bytes
    page: GatewayPage | None
    sample: ProcessSample | None
    oom_kills: int | None

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
            "exit": asdict(how) if how is not None else None,
            "oom_kills": self.oom_kills,
            "refused_paths": list(refused),
            "last_sample": asdict(self.sample) if self.sample is not None else None,
            **self._of_the_page(at_ns),
        }
        raw = {"gateway.bin": self.raw} if len(self.raw) == FILE_BYTES else {}
        return {"gateway.json": as_bytes(told), **raw}

    def _of_the_page(self, at_ns: int) -> dict[str, object]:
        if self.page is None:
            return {"beats": None, "requests": []}
        requests = [
            {**asdict(one), "stage": one.stage.name, "age_ms": max(0, at_ns - one.since_ns) // _MS}
            for one in self.page.requests
        ]
        return {"beats": asdict(self.page.pulse), "requests": requests}


class GatewayWatch:
    """Looks at the gateway behind `handle`, whose page is at `path`. `due_ns`: from then on it has to beat."""

    def __init__(self, handle: Handle, path: Path, patience: Patience, due_ns: int) -> None:
        self.handle = handle
        self.pulse: GatewayPulse | None = None
        self._reader = GatewayPageReader(path)
        self._bench = GatewayBench(patience, due_ns)
        self._oom = memory.oom_counter(handle.pid)
        self._sample: ProcessSample | None = None

    def look(self) -> Verdict:
        """Return what is to be said of it now."""
        self.pulse = self._read()
        self._sample = self.handle.sample(self._wanted(clock.now_ns()))
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
        return Remains(who.pid, who.start, raw, page, self._sample, oom_kills)

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
