"""The hands: one order, one coroutine; what comes of it is told as facts.

Whatever goes wrong in here becomes a fact or a line in the log, never an exception in the loop that decides.
Blocking work (files, starting processes, walking /proc) is done on threads of our own; more than one, so that
a collector that hangs in the kernel can't keep the next core from being started.
"""

import asyncio
import functools
import signal
from collections.abc import Callable, Coroutine, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from msgspec import structs

from hardcore.bounds import Bounds
from hardcore.clearing import Clearing
from hardcore.court_room import CourtRoom
from hardcore.endings import Endings
from hardcore.handover import Handover
from hardcore.host import clock, deaths, lives, logs, memory, processes
from hardcore.host.folders import Folders
from hardcore.host.lives import Life, Terms
from hardcore.host.steps import Steps
from hardcore.investigating import Investigators
from hardcore.model import actions as orders
from hardcore.model import observations as seen
from hardcore.outbox import Outbox
from hardcore.reporting import have_report
from hardcore.rule_book import Doors
from hardcore.senses import Senses
from hardcore.snapshot.facts import facts
from hardcore.snapshot.filing import Filing
from hardcore.snapshot.image import ImageLimits
from hardcore.snapshot.stacks import find_tools
from hardcore.taking import Taking

THREADS_MAX = 4
#: Keys of suspects in one line of the feed, which a gateway reads up to 64 KiB.
SUSPECTS_A_LINE = 512
#: What is under way when all is stopped gets this long: a last report, and evidence that a slow disk takes.
FINISH_S = 30.0
#: Whoever still lives when all is stopped gets this long to be gone, once killed.
HALT_S = 1.0
LOG_S = 1.0
#: A core says WATCHDOG=1 at least twice in this time; its silence is judged by the recorder, not by this.
WATCHDOG_USEC = 2_000_000


class Executor:
    """Carries out orders.

    `tell` takes the facts, `publish` the lines for the gateway; `still_ours` ends the process if another guard
    may act by now, and is asked on a hand's thread before every deed. Without `bounds` a core is told no limits
    and no memory is written out.
    """

    def __init__(
        self,
        folders: Folders,
        generation: int,
        tell: Callable[[seen.Observation], None],
        publish: Callable[[Mapping[str, object]], None],
        still_ours: Callable[[], None],
        bounds: Bounds | None = None,
    ) -> None:
        self.lives: dict[int, Life] = {}
        self.adoptable: Life | None = None
        self.halted = asyncio.Event()
        self.steps = Steps(folders, generation, still_ours, self._unwritten)
        self._keeping = asyncio.Lock()
        self.clearing = Clearing(tell, self.in_hand)
        self.pool = ThreadPoolExecutor(THREADS_MAX, thread_name_prefix="hand")
        self._folders = folders
        self._tell = tell
        self._publish = publish
        self._still_ours = still_ours
        own = logs.LogFile(folders.logs / "sentinel.log", folders.run)
        self._log = logs.LogThread(own, folders.logs_of_others())
        self.bounds = bounds
        self.listen_fd: int | None = None  # kept by each core for the guard that its agent may have to start
        self.tools = find_tools()
        self.senses = Senses(folders, generation, self.tools, tell, self.note)
        self._handover = Handover(folders, generation, self.steps, tell)
        self._endings = Endings(self, folders, tell, self._handover.calm)
        self._making: set[str] = set()
        self._adopted_in = ""
        self._tasks: set[asyncio.Task[None]] = set()
        self.investigators = Investigators(folders, self)
        self.outbox = Outbox(folders, self, publish)
        self.filing = Filing(folders.incidents, self, self._report, shelter=folders.shelter, ran=self._ran)
        self.policy_sha256 = ""  # of the policy in force, as its recording says it
        self.serving: tuple[dict[str, object], ...] = ()
        self._taking = Taking(self, folders, tell, self._handover.calm, self._image_limits)
        doors = Doors(tell, publish, self._controls, self._handover.calm, self.filing.add_trials)
        self.court = CourtRoom(folders, generation, self, doors)

    def carry_out(self, action: orders.Action) -> None:
        """Begin to carry out one order."""
        match action:
            case orders.Spawn():
                safe = None if action.safe is None else str(action.safe)
                self.begin(self._spawn(action.life, Terms(action.expected_epoch, action.witnesses, safe)))
            case orders.SpawnSpare():
                self.begin(self._spawn(action.life, Terms(spare=True)))
            case orders.Promote():
                self._promote(action)
            case orders.Drain():
                self.begin(self._drain(action))
            case orders.Adopt():
                self._adopt(action)
            case orders.Terminate():
                self.begin(self._terminate(action))
            case orders.Kill():
                self.begin(self._kill(action))
            case orders.KillLeftovers():
                self.begin(self._kill_leftovers())
            case orders.TakeEvidence():
                done = self._taking.begun(action.incident)
                self.begin(self._taking.take(action, self.lives.get(action.life), done))
            case orders.SampleStacks() | orders.LookAtStore() | orders.SetSafe() | orders.RestartComponent():
                life = self.lives.get(action.life)
                if life is not None and life.handle is not None:
                    self.begin(self.senses.sense(action, life))
            case orders.Release():
                self._release(action)
            case orders.CloseIncident():
                self.begin(self._close(action))
            case orders.AddAudit():
                self.begin(self.filing.add_audit(action))
            case orders.Alert():
                self.note("alert", diagnosis=action.diagnosis, text=action.text)
                self.begin(self.outbox.put(action))
            case orders.KeepBudget():
                self.begin(self._keep(action))
            case orders.Halt():
                self.begin(self._halt())
            case _:
                self.court.carry_out(action)

    def note(self, kind: str, **particulars: object) -> None:
        """Have a line written to the guard's log; nothing waits for it. May be called on any thread."""
        self._log.add({"at": clock.wall(clock.now_ns()), "kind": kind, **particulars})

    async def in_hand(self, work: Callable[..., Any], *args: Any) -> Any:
        """Run blocking work on a hand's thread."""
        return await asyncio.get_running_loop().run_in_executor(self.pool, work, *args)

    async def finish(self) -> None:
        """Wait for what is under way, but not for ever; a hand that hangs in the kernel ends with the process."""
        loop = asyncio.get_running_loop()
        give_up_at = loop.time() + FINISH_S
        await asyncio.gather(self.court.stop(), self.investigators.stop(), self.outbox.stop())
        while self._tasks and loop.time() < give_up_at:
            await asyncio.wait(self._tasks, timeout=give_up_at - loop.time())
        for task in self._tasks:
            self.note("unfinished", work=task.get_name())
            task.cancel()
        self.senses.close()
        self.pool.shutdown(wait=False, cancel_futures=True)
        self._log.close(LOG_S)  # this loop has nothing else left to do

    def mark(self, step: str, **particulars: object) -> None:
        """Ask whether the next deed is still ours, and write down where we are.

        A guard whose lock is gone has lost the right to act, and ends here. The writing is a hint.
        """
        self.steps.mark(step, **particulars)

    def hint(self, step: str | None, **particulars: object) -> None:
        """Write down where we are, for whoever looks; without a step, the one before stays."""
        self.steps.hint(step, **particulars)

    def _unwritten(self, step: str | None, error: BaseException) -> None:
        self.note("hint", step=step, failed=_said(error))

    # ---- orders ----

    def begin(self, work: Coroutine[Any, Any, object]) -> None:
        """Start a piece of work that nobody waits for; its faults are told in the log."""
        name = getattr(work, "__qualname__", "?")
        task = asyncio.get_running_loop().create_task(self._guarded(work), name=name)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _guarded(self, work: Coroutine[Any, Any, object]) -> None:
        try:
            await work
        except Exception as error:  # noqa: BLE001  # a fault of a hand must not end the watch; it is told
            self.note("fault", where=getattr(work, "__qualname__", "?"), error=_said(error))

    async def _spawn(self, number: int, terms: Terms) -> None:
        self._handover.over()
        nonce = lives.new_nonce()
        try:
            # Here: the loop changes them meanwhile, and another hand may be making one beside this.
            self._making.add(nonce)
            living = {life.nonce for life in self.lives.values()} | self._making
            life = await self.in_hand(self._make, number, nonce, terms, living)
        except Exception as error:  # noqa: BLE001  # a core that could not be made, for whatever reason, is a fact
            self._making.discard(nonce)
            self._tell(seen.SpawnFailed(clock.now_ns(), number, _said(error)))
            return
        assert life.handle is not None, "it was made with its process"
        self._endings.keep_watch(life)
        self._making.discard(nonce)
        self._tell(seen.CoreSpawned(clock.now_ns(), number, life.handle.pid))

    def _make(self, number: int, nonce: str, terms: Terms, living: set[str]) -> Life:
        if terms.spare:
            self._still_ours()  # a spare is no step of a switch
        else:
            self.mark("spawn", life=number, expected_epoch=terms.expected_epoch)
        lives.sweep(self._folders, living)
        life = lives.conceive(self._folders, number, nonce)
        life.spare = terms.spare
        try:
            lives.start(life, terms, WATCHDOG_USEC, self.bounds.core if self.bounds else None, self.listen_fd)
        except BaseException:
            life.discard()  # no process has come of it
            raise
        self.hint(None if terms.spare else "spawned", **life.named())
        return life

    def _ran(self, incident: orders.Incident) -> dict[str, object]:
        """Return what ran in an incident, as its facts say it; None: it is not known."""
        life = self.lives.get(incident.life)
        return {
            "build": (life.build or None) if life else None,
            "schema": life.schema if life else None,
            "policy_sha256": self.policy_sha256 or None,
        }

    # ---- a switch ----

    def _promote(self, order: orders.Promote) -> None:
        """Tell the spare to take over, at once: on this path each turn of the loop is one that somebody waits."""
        life = self._living(order.life)
        if life is None:
            refused = seen.PromoteRefused(clock.now_ns(), order.life, "it is gone")
            asyncio.get_running_loop().call_soon(self._tell, refused)  # not within the step that ordered it
            return
        self.begin(self._handover.promote(life, order))

    async def _drain(self, order: orders.Drain) -> None:
        life = self._living(order.life)
        if life is not None:
            await self._handover.drain(life, order)

    def _adopt(self, order: orders.Adopt) -> None:
        """Take over the core that an earlier guard left: it is no child of ours, but its end is seen all the same."""
        life = self.adoptable
        assert life is not None, "it was found before the watch began"
        assert life.handle is not None, "as above"
        self.adoptable, self._adopted_in = None, self.filing.left_open
        life.number, life.adopted_ns = order.life, clock.now_ns()
        life.oom = memory.oom_counter(life.handle.pid)
        self._endings.keep_watch(life)
        self.mark("adopted", life=life.number, **life.named())

    def reject(self, life: Life, why: str) -> None:
        """Take back a spare that can't be one: it is told as one that could not be made, and ended."""
        self._tell(seen.SpawnFailed(clock.now_ns(), life.number, why))
        self.begin(self._kill(orders.Kill(life.number)))

    async def _halt(self) -> None:
        """End whoever still lives (a spare, who was left behind), and only then let the guard end."""
        left = [life for life in self.lives.values() if not life.ended and life.handle is not None]
        self.steps.condemn(*(life.nonce for life in left))
        for life in left:
            assert life.handle is not None, "as chosen above"
            await self.in_hand(life.handle.kill_tree)
        give_up_at = asyncio.get_running_loop().time() + HALT_S
        for life in left:
            assert life.handle is not None, "as above"
            await processes.gone(life.handle, give_up_at - asyncio.get_running_loop().time())
        self.halted.set()

    def _controls(self) -> list[Path]:
        """Return the control sockets of the cores that live; one that is only beginning has none, and reads later."""
        living = (life for life in self.lives.values() if life.handle is not None and not life.ended)
        paths = (self._folders.core_control(life.nonce) for life in living)
        return [path for path in paths if path.exists()]

    def _living(self, number: int) -> Life | None:
        life = self.lives.get(number)
        return life if life is not None and life.handle is not None and not life.ended else None

    def speaker(self, pid: int) -> Life | None:
        """Return the life of the core that has this number; of two, the one that lives."""
        found = [life for life in self.lives.values() if life.handle is not None and life.handle.pid == pid]
        return min(found, key=lambda life: life.ended, default=None)

    # A life whose process is still being made gets no order here: the manager repeats it when it is told of
    # the process (SPAWNED), so that an order to nobody is not lost.

    def _image_limits(self) -> ImageLimits | None:
        return self.bounds.image if self.bounds else None

    async def confine(self, life: Life) -> str | None:
        """Give a core a memory group of its own, for the drill; return why that can't be done, None when it is."""
        if life.handle is None:
            return "its process is gone"
        self._still_ours()
        return await self.in_hand(life.confine) or None

    async def _terminate(self, order: orders.Terminate) -> None:
        life = self.lives.get(order.life)
        if life is None or life.handle is None:
            return
        self.steps.condemn(life.nonce)
        await self.in_hand(self.mark, "terminate")
        life.handle.signal(signal.SIGTERM)
        life.handle.signal(signal.SIGCONT)  # a stopped core could not obey

    async def _kill(self, order: orders.Kill) -> None:
        life = self.lives.get(order.life)
        if life is None or life.handle is None:
            return
        self.steps.condemn(life.nonce)
        await self.in_hand(self.mark, "kill")
        await self.in_hand(life.handle.kill_tree)

    async def _kill_leftovers(self) -> None:
        await self.in_hand(self.mark, "adopt")
        await self.clearing.kill()

    def inherit(self, leftovers: tuple[Life, ...], adoptable: Life | None) -> None:
        """Take what an earlier guard left: what is to be ended, and a core that may be gone on with."""
        self.clearing.leftovers = leftovers
        self.adoptable = adoptable
        self.steps.condemn(*(life.nonce for life in leftovers))

    def _release(self, order: orders.Release) -> None:
        self._handover.over()
        if self.court.is_written:
            self._let_in(order)
        else:
            self.begin(self._release_later(order))

    async def _release_later(self, order: orders.Release) -> None:
        """Release a core once the names of its suspects can be read: an importer would run one of them again."""
        await self.court.written()
        if self._living(order.life) is not None:
            self._let_in(order)

    def _let_in(self, order: orders.Release) -> None:
        life = self.lives[order.life]
        self.serving = (
            *_suspect_lines(order.suspects),
            {
                "type": "serving",
                "socket": str(self._folders.core_socket(life.nonce)),
                "epoch": order.epoch,
            },
            {"type": "release", "epoch": order.epoch, "incident": self._waited_in(order.incident)},
        )
        for line in self.serving:
            self._publish(line)
        self.begin(self.court.rules.tell_released(self._folders.core_control(life.nonce)))
        at_ns = clock.now_ns()
        told = {"released_at": clock.wall(at_ns), "incident_released": order.incident}
        self.begin(self.in_hand(functools.partial(self.mark, "released", **told)))
        self.begin(self.filing.served_again(at_ns))
        self.begin(self._endings.name_code(life))

    def _waited_in(self, incident: str | None) -> str | None:
        """Return the incident in which people wait now: it may be one that an earlier guard did not live to end."""
        left, self._adopted_in = self._adopted_in, ""
        return left or incident

    async def _close(self, order: orders.CloseIncident) -> None:
        incident = order.incident
        evidence = self._taking.close(incident.id)
        await self.filing.close(incident, *self._whose(incident), evidence)
        self.steps.forget(incident.id)

    async def _report(self, folder: Path) -> None:
        """Have the report of an incident made, and then whoever shows it woken."""
        await have_report(self, self._folders, folder)
        self.begin(self.investigators.wake())

    def _whose(self, incident: orders.Incident) -> tuple[int | None, str]:
        life = self.lives.get(incident.life)
        pid = life.handle.pid if life and life.handle else None
        return pid, life.nonce if life else ""

    def keep_open(self, incident: orders.Incident) -> None:
        """Have written down what is known of an incident that goes on. Of its evidence, what is ordered now comes first.

        The next deed writes it as well, in brief: a guard that dies in the middle of it has told of it all the same.
        """
        brief = structs.replace(
            incident, in_flight=(), requests=(), suspects=incident.suspects[:SUSPECTS_A_LINE]
        )
        self.steps.tell(facts(brief, *self._whose(incident), clock.wall, self._ran(incident)))
        self.begin(self._open(incident))

    async def _open(self, incident: orders.Incident) -> None:
        await self._handover.calm()
        evidence = self._taking.of(incident.id)
        await self.filing.open(incident, *self._whose(incident), evidence)

    async def _keep(self, order: orders.KeepBudget) -> None:
        await self._handover.calm()
        async with self._keeping:  # in their order: an older count must not be written over a newer one
            await self.in_hand(deaths.write_deaths, self._folders, order.deaths_ns, order.shut)


def _said(error: BaseException) -> str:
    """Return what an exception says, as one line."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return f"{type(error).__name__}: {error}"


def _suspect_lines(keys: tuple[str, ...]) -> list[dict[str, object]]:
    """Return the suspects in lines that a gateway reads; they add up, and the first says that there are none."""
    parts = [keys[at : at + SUSPECTS_A_LINE] for at in range(0, len(keys), SUSPECTS_A_LINE)] or [()]
    return [{"type": "suspects", "keys": list(part)} for part in parts]
