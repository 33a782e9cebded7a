"""What the sentinel answers at its door: the operator's questions and orders, the gateway's reports.

An order is carried out by the same manager that a crash goes through; nothing is done here behind its back.
What the operator wants is on disk before the first signal is sent. The room knows its house only through
`House`, so that nothing here can reach the loop.
"""

import asyncio
import os
import re
import resource
import time
from collections.abc import Mapping
from typing import assert_never

import psutil

from hardcore import standing, status
from hardcore.breaking import Breaking, ask_core
from hardcore.control.protocol import Ask, Request
from hardcore.host import build, clock, leftovers, muting, processes
from hardcore.host.docket import is_name
from hardcore.host.processes import Identity
from hardcore.house import Answer, House, refuse
from hardcore.model import observations as seen
from hardcore.model.phases import SERVING, Phase, Wanted
from hardcore.model.recorder import Witness
from hardcore.policy_desk import PolicyDesk
from hardcore.recovery.budget import NS_PER_S
from hardcore.rule_desk import RuleDesk

#: A core that does not say at once which code it runs is taken for one of other code.
BUILD_ASKED_S = 0.5
REQUESTS_MAX = 2048
#: What code lies on the disk is looked at again for a status after so long: it takes some milliseconds.
ON_DISK_HOLDS_NS = 5 * NS_PER_S
LOOKED_FOR_S = 0.2
#: A part of the core is ended and begun anew within this, or nobody knows yet.
PART_S = 8.0
#: Who is connected and has asked nothing for so long would not notice a drill.
QUIET_NS = 60 * NS_PER_S
#: What an operator does, as opposed to what one asks.
ACTS = frozenset(
    {
        Ask.DRILL,
        Ask.DOWN,
        Ask.RESTART,
        Ask.RESUME,
        Ask.RULE_ADD,
        Ask.RULE_REMOVE,
        Ask.SAFE_MODE,
        Ask.POLICY_RELOAD,
    }
)
_HASH = re.compile(r"[0-9a-f]{64}")


class Door:
    """Answers requests and takes in what the gateway reports."""

    def __init__(self, house: House, policy: PolicyDesk) -> None:
        self.last_incident = status.last_incident(house.folders)
        self._policy = policy
        self._safe_reason = standing.safe_reason(house.folders)
        self.doors_asked_ns: int | None = None  # when somebody last read the gateway's doors for monitors
        self._house = house
        self._proved: seen.CoreReady | None = None
        self._verified_ns: int | None = None
        self._launcher = _identity(os.getppid())
        self._stats: dict[str, int] = {}
        self._busy_ns = clock.now_ns()
        self._breaking = Breaking(house, lambda: self._stats.get("connections", 0))
        self._rules = RuleDesk(house)
        self._looking: asyncio.Future[str] | None = None
        self._part: asyncio.Future[seen.ComponentRestarted] | None = None
        self._on_disk = ""
        self._on_disk_ns = -ON_DISK_HOLDS_NS
        self._own_cpu = _CpuMeter()
        self._core_cpu = _CpuMeter()

    async def answer(self, request: Request) -> Answer:
        """Return the answer to one request, and descriptors to send along. What was done is told to the investigators."""
        answer = await self._answer(request)
        if request.ask in ACTS and answer[0].get("ok") is True and not request.audited:
            what = request.fault or request.id or request.component or str(answer[0].get("id", ""))
            if request.ask is Ask.SAFE_MODE:
                what = "on" if request.on else "off"
            told = {"who": "cli", "verb": str(request.ask), "what": what, "reason": request.reason}
            self._house.court.spool("act", told)
        return answer

    async def _answer(self, request: Request) -> Answer:
        match request.ask:
            case Ask.STATUS:
                return await self._status(), []
            case Ask.ATTACH:
                self._launcher = _identity(request.pid)  # who asks becomes it
                return {"ok": True, "url": self._house.url}, [self._house.listen_fd]
            case Ask.DRILL:
                return await self._breaking.drill(request)
            case Ask.POLICY:
                return self._policy.shown()
            case Ask.POLICY_RELOAD:
                return await self._policy.reload()
            case Ask.SAFE_MODE:
                return await self._safe_mode(request)
            case Ask.HISTORY:
                return {"ok": True, "changes": self._house.chronicle.told()}, []
            case Ask.CURVE:
                return {"ok": True, "resources": self._house.curve()}, []
            case Ask.ALERTS_TEST:
                return await self._house.outbox.test(request.channel), []
            case Ask.ALERTS_MUTE:
                return await self._mute(request.seconds)
            case Ask.DOWN:
                return await self._down(request)
            case Ask.RESTART:
                return await (self._restart_part if request.component else self._restart)(request)
            case Ask.RESUME:
                return await self._resume(request)
            case Ask.QUARANTINE:
                return self._rules.shown()
            case Ask.RULE_ADD:
                return await self._rules.add(request)
            case Ask.RULE_REMOVE:
                return await self._rules.remove(request)
            case Ask.INVESTIGATE:
                return await self._rules.investigate()
            case Ask.SUBSCRIBE:
                raise AssertionError("a subscription is no question")
            case _:
                assert_never(request.ask)

    def _order(self, verb: seen.Verb, request: Request, *, on_disk: str = "", serves: str = "") -> Answer:
        before = self._house.reading()
        asked = seen.OperatorAsked(
            clock.now_ns(),
            verb,
            request.reason,
            accept_ledger=request.accept_ledger,
            image=request.image,
            build=on_disk,
            serves=serves,
            component=request.component,
        )
        self._house.feed(asked)
        after = self._house.reading()
        told = {
            "ok": True,
            "incident": after.incident or before.incident,
            "phase": str(after.phase),
            "mode": self._house.policy.mode,
        }
        waits = after.switch_waits and verb is seen.Verb.RESTART
        updates = waits and after.switch_updates
        return {**told, "waits": waits, "updates": updates, "changed": after.phase is not before.phase}, []

    async def _down(self, request: Request) -> Answer:
        try:
            await self._house.in_hand(standing.store_wanted, self._house.folders, Wanted.DOWN)
        except OSError as error:
            # Stopped without that on disk, the next start of the machine would bring it up again.
            return refuse(
                "not-stored",
                f"That it should stay off can't be written ({error.strerror}). Make room in the data folder "
                "and try again, or end `hardcore up` with Ctrl-C or SIGTERM.",
            )
        return self._order(seen.Verb.STOP, request)

    async def _safe_mode(self, request: Request) -> Answer:
        """Serve reads only, or everything again. What is wanted is on disk before anybody is told."""
        reading = self._house.reading()
        if reading.wanted is Wanted.DOWN:
            return refuse("stopping", "It is being stopped; `hardcore up` starts it as it was wanted before.")
        wanted = Wanted.SAFE if request.on else Wanted.UP
        if reading.wanted is wanted and not request.on and reading.safe is not None:
            return refuse(
                "safe-by-policy",
                f"Nobody asked for reading only: {reading.safe} is why. It ends by itself, or by `hardcore resume`.",
                safe=str(reading.safe),
            )
        reason = request.reason or self._safe_reason  # who says it again without a reason takes none back
        try:
            await self._house.in_hand(standing.store_wanted, self._house.folders, wanted, reason)
        except OSError as error:
            return refuse(
                "wish-not-stored", f"What is wanted can't be written ({error.strerror}).", why=error.strerror
            )
        self._safe_reason = reason if request.on else ""
        answer, fds = self._order(seen.Verb.SAFE_ON if request.on else seen.Verb.SAFE_OFF, request)
        return {**answer, "changed": reading.wanted is not wanted}, fds

    async def _mute(self, seconds: int) -> Answer:
        try:
            until = await self._house.in_hand(muting.silence, self._house.folders, seconds)
        except OSError as error:
            return refuse("not-stored", f"That alerts are muted can't be written ({error.strerror}).")
        return {"ok": True, "muted_until": until}, []

    async def _resume(self, request: Request) -> Answer:
        reading = self._house.reading()
        if request.accept_ledger:
            if not reading.in_question:
                return refuse(
                    "not-in-question",
                    "No ledger is in question: what was last seen of it stays what it has to match.",
                )
            await self._house.in_hand(leftovers.overrule_pages, self._house.folders)
        return self._order(seen.Verb.RESUME, request)

    async def _restart(self, request: Request) -> Answer:
        reading = self._house.reading()
        if request.image and self._house.policy.memory_image == "never":
            return refuse(
                "no-image",
                "The policy in force keeps no memory (`memory_image` is never). Set it to on_request; a changed "
                "policy is taken within seconds.",
            )
        if reading.phase is Phase.UNKILLABLE:
            return refuse("unkillable", "The old core does not die; a second one beside it could lose money.")
        if request.hard:
            return self._order(seen.Verb.RESTART_HARD, request)
        serves, on_disk = await asyncio.gather(self._code_that_serves(), self._code_on_disk())
        return self._order(seen.Verb.RESTART, request, on_disk=on_disk, serves=serves)

    async def _restart_part(self, request: Request) -> Answer:
        """Have one part of the serving core started anew; the others go on. What came of it is waited for."""
        reading = self._house.reading()
        if reading.phase not in SERVING:
            return refuse("no-component", "No core serves now: there is no part to start anew.")
        known = [each.name for each in reading.components]
        if known and request.component not in known:
            names = ", ".join(known)
            words = f"{request.component!r} is no part of this core; it has: {names}."
            return refuse("component-unknown", words, component=request.component, names=names)
        self._part = part = asyncio.get_running_loop().create_future()
        answer, fds = self._order(seen.Verb.RESTART_COMPONENT, request)
        try:
            came = await asyncio.wait_for(part, PART_S)
        except TimeoutError:
            return {**answer, "done": False}, fds
        if not came.done:
            words = f"{came.name} was not started anew: {came.reason}."
            return refuse("component-not-restarted", words, component=came.name, why=came.reason)
        return {**answer, "done": True}, fds

    def part_restarted(self, fact: seen.ComponentRestarted) -> None:
        """Take in what came of an order to start a part anew; whoever asked for it hears of it."""
        if self._part is not None and not self._part.done():
            self._part.set_result(fact)

    async def _code_that_serves(self) -> str:
        """Return the name of the code that the serving core runs, as it says itself; empty if it does not say."""
        life = self._house.life()
        if life is None or self._house.reading().phase not in SERVING:
            return ""
        path = self._house.folders.core_control(life.nonce)
        try:
            told = await asyncio.wait_for(ask_core(path, {"verb": "status"}), BUILD_ASKED_S)
        except (OSError, ValueError, TimeoutError):
            return ""
        return str(told.get("build", ""))

    async def _code_on_disk(self) -> str:
        """Return the name of the core's code that lies on the disk now."""
        self._on_disk = str(await self._house.in_hand(build.build_id))
        self._on_disk_ns = clock.now_ns()
        return self._on_disk

    async def _look_at_code(self) -> None:
        """Know which code lies on the disk, if that can be had in a moment: a disk that hangs holds up no status."""
        if clock.now_ns() - self._on_disk_ns <= ON_DISK_HOLDS_NS:
            return
        if self._looking is None or self._looking.done():
            self._looking = asyncio.ensure_future(self._code_on_disk())
        await asyncio.wait({self._looking}, timeout=LOOKED_FOR_S)

    # ---- what the gateway reports ----

    def listen(self, line: Mapping[str, object]) -> None:
        """Take in one line from the gateway; what makes no sense is dropped."""
        at_ns = line.get("at_ns", 0)
        match line.get("type"), at_ns:
            case "holding", int():
                self._house.feed(seen.GatewayHolding(at_ns))
            case "served", int():
                if isinstance(epoch := line.get("epoch"), int):
                    self._house.feed(seen.FirstServed(at_ns, epoch))
            case "witness", _:
                self._witnessed(line)
            case "outcomes", _:
                self._settled(line)
            case (("case" | "settled"), _):
                self._of_suspects(line)
            case "investigate", _:
                self._house.begin(self._house.investigators.wake())
            case "asked-doors", _:
                self.doors_asked_ns = clock.now_ns()
            case "overdue", _:
                self._overdue(line)
            case "stats", _:
                self._counted({k: v for k, v in line.items() if isinstance(v, int)})
            case _:
                return

    def _counted(self, stats: dict[str, int]) -> None:
        at_ns = clock.now_ns()
        if stats.get("forwarded") != self._stats.get("forwarded") or stats.get("held"):
            self._busy_ns = at_ns
        self._stats = stats
        counts = (max(0, stats.get(name, 0)) for name in ("connections", "held", "forwarded"))
        self._house.feed(seen.GatewayCounted(at_ns, *counts))

    @property
    def is_quiet(self) -> bool:
        """Whether nobody is connected, or nobody has asked anything for a while."""
        return not self._stats.get("connections", 0) or clock.now_ns() - self._busy_ns >= QUIET_NS

    def _overdue(self, line: Mapping[str, object]) -> None:
        """A core had not answered in time: that is told, and counted on the gateway's page.

        It is no testimony: one request that takes long is the core's own business, and a core that finishes nothing
        shows it on its page long before.
        """
        match line:
            case {"path": str(path), "epoch": int(epoch), "age_ms": int(age_ms)}:
                self._house.note("overdue", path=path[:256], epoch=epoch, age_ms=age_ms)
            case _:
                return

    def _witnessed(self, line: Mapping[str, object]) -> None:
        match line:
            case {"epoch": int(epoch), "seq": int(seq), "hash": str(digest)} if _HASH.fullmatch(digest):
                at_ns = clock.now_ns()
                witness = Witness(seq, epoch, digest, at_ns)
                self._house.feed(seen.GatewayWitnessed(at_ns, witness))
            case _:
                return

    def _settled(self, line: Mapping[str, object]) -> None:
        incident, requests = line.get("incident"), line.get("requests")
        if not isinstance(incident, str) or not isinstance(requests, list):
            return
        outcomes = tuple(
            seen.RequestOutcome(
                method=str(item.get("method", ""))[:16],
                path=str(item.get("path", ""))[:256],
                key_hash=str(item.get("key_hash") or "")[:64],
                outcome=str(item.get("outcome", ""))[:16],
                status=_whole(item.get("status")),
                held_ms=_whole(item.get("held_ms")),
            )
            for item in requests[:REQUESTS_MAX]
            if isinstance(item, dict)
        )
        self._house.feed(seen.RequestsSettled(clock.now_ns(), incident, outcomes))

    def _of_suspects(self, line: Mapping[str, object]) -> None:
        match line:
            case {"type": "case", "name": str(name)} if is_name(name):
                self._house.begin(self._house.court.case_filed(name))
            case {"type": "settled", "names": list(names)}:
                known = tuple(name for name in names[:REQUESTS_MAX] if is_name(name))
                self._house.begin(self._house.court.settled(known))
            case _:
                return

    # ---- status ----

    def proved(self, fact: seen.CoreReady | seen.LedgerAudited) -> None:
        """Take in that a core has proven the ledger's end, or looked at all of it."""
        if isinstance(fact, seen.CoreReady):
            self._proved = fact
        elif fact.ok:
            self._verified_ns = fact.at_ns

    def measure(self) -> None:
        """Take the processor's share of the last second."""
        usage = resource.getrusage(resource.RUSAGE_SELF)
        self._own_cpu.take(usage.ru_utime + usage.ru_stime)
        life = self._house.life()
        if life is not None and life.sample is not None:
            self._core_cpu.take(life.sample.cpu_ns / 1e9)

    async def _status(self) -> dict[str, object]:
        await self._look_at_code()
        house, reading = self._house, self._house.reading()
        told = status.running(reading, house.policy, self._safe_reason)
        told["policy_fault"] = self._policy.fault
        told["history"] = house.chronicle.told()[-status.HISTORY_SHOWN_MAX :]
        told["url"] = house.url
        told["launcher"] = {"pid": _living(self._launcher)}
        told["sentinel"] |= {
            "pid": psutil.Process().pid,
            "cpu_percent": self._own_cpu.percent,
            "rss_bytes": psutil.Process().memory_info().rss,
            "adopted": house.adopted,
        }
        told["gateway"] = {
            **house.gateway_told(),
            "websockets": self._stats.get("websockets", 0),
            "held_requests": self._stats.get("held", 0),
            "connections": self._stats.get("connections", 0),
        }
        proved = self._proved
        told["core"] = status.core(
            house.life(),
            reading,
            proved_seq=proved.proof.seq if proved and proved.life == reading.life else None,
            cpu_percent=self._core_cpu.percent,
            behind=house.numbered(reading.behind) if reading.behind is not None else None,
        )
        told["spare"] = status.spare(house.numbered(reading.spare), reading, self._on_disk)
        told["last_incident"] = self.last_incident
        told["dead_letters"] = house.court.rules.aside.letters
        told["ledger_verified_at"] = clock.wall(self._verified_ns) if self._verified_ns else None
        return told


class _CpuMeter:
    """Share of one processor between two takings."""

    def __init__(self) -> None:
        self.percent: float | None = None
        self._last: tuple[float, float] | None = None

    def take(self, cpu_s: float) -> None:
        now = time.monotonic()
        if self._last is not None and now > self._last[0] and cpu_s >= self._last[1]:
            self.percent = round(100 * (cpu_s - self._last[1]) / (now - self._last[0]), 1)
        self._last = (now, cpu_s)


def _identity(pid: int) -> Identity | None:
    start = processes.start_of(pid)
    return None if start is None else Identity(pid, start)


def _living(who: Identity | None) -> int | None:
    """Return a process's number if it still is the one that was meant."""
    handle = processes.find(who) if who is not None else None
    if handle is None:
        return None
    handle.close()
    return handle.pid


def _whole(value: object) -> int:
    return value if isinstance(value, int) else 0
