"""The sentinel process: the one loop that waits for a fact or the deadline, asks the manager, moves the hands.

Nothing is decided here. A tick, a readable pidfd, a datagram, an operator's line, a timer that rings: each
becomes a fact with the time at which it was true; what the manager orders goes to the executor; what the
moment means is published to whoever listens. Started by the launcher as
`python -m hardcore.runtime --data DIR --listen-fd N --url URL`.
"""

import argparse
import asyncio
import json
import os
import random
import resource
import signal
import sys
import traceback
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, NoReturn

from hardcore import rehearsal, standing
from hardcore.agents_file import write_agents
from hardcore.arrival import Setup, set_up
from hardcore.calendar import Calendar
from hardcore.chronicle import Chronicle
from hardcore.control.server import ControlServer
from hardcore.curves import Curves
from hardcore.door import Door
from hardcore.executor import Executor
from hardcore.gatekeeper import Gatekeeper
from hardcore.host import clock, deaths, files, lives, logs
from hardcore.host.ids import new_id
from hardcore.host.lives import Life
from hardcore.listening import Listener
from hardcore.model import actions as orders
from hardcore.model import observations as seen
from hardcore.model.phases import LIVING, SERVING
from hardcore.policy_desk import PolicyDesk
from hardcore.recovery.budget import NS_PER_S
from hardcore.recovery.failover import FailoverManager
from hardcore.recovery.flight import CODEC, Tape, digest
from hardcore.recovery.foresight import Foresight
from hardcore.recovery.policy import Policy, in_full
from hardcore.recovery.reading import Reading
from hardcore.snapshot.facts import stops
from hardcore.standing_line import StandingLine

FEED_EVERY_S = 1.0
#: A spare that waits has nothing to do but to beat; what was seen of it holds for some seconds.
SPARE_EVERY_TICKS = 3
SWITCH_INTERVAL_S = 0.0005
EXIT_UNREACHABLE = 4
#: What an operator says to have everything go on that waits for a person.
GOES_ON = frozenset({seen.Verb.RESUME, seen.Verb.RESTART, seen.Verb.RESTART_HARD})


class Runtime:
    """Waits, feeds, hands over."""

    def __init__(self, setup: Setup) -> None:
        self.setup = setup
        self.policy = setup.in_force.policy
        self.folders = folders = setup.folders
        self.listen_fd, self.url, self.generation = setup.listen_fd, setup.url, setup.generation
        self.adopted = setup.leftovers.adoptable is not None
        window_ns = self.policy.restart_window_sec * NS_PER_S
        self.tape = Tape(new_id, random.random)
        self.manager = FailoverManager(
            self.policy,
            standing.wanted(folders),
            self.tape.new_id,
            self.tape.jitter,
            deaths.read_deaths(folders, window_ns),
        )
        self.executor = Executor(
            folders,
            setup.generation,
            self.feed,
            self.publish,
            self._still_ours,
            standing.bounds(self.policy),
        )
        self.executor.listen_fd = setup.listen_fd
        self.senses = self.executor.senses
        self.court, self.investigators = self.executor.court, self.executor.investigators
        self.outbox, self.note, self.begin = self.executor.outbox, self.executor.note, self.executor.begin
        self.in_hand, self.confine = self.executor.in_hand, self.executor.confine
        self.gatekeeper = Gatekeeper(folders, self.policy, setup.listen_fd, self.executor)
        self.policy_desk = PolicyDesk(self, self._go_by, setup.in_force.fault)
        self.curves = Curves()
        self.chronicle = Chronicle(folders, self.executor, self.court.spool)
        self.door = Door(self, self.policy_desk)
        self.standing = StandingLine(self, self.door, self.manager.open_incident, self.publish)
        self.calendar = Calendar(folders, self.policy, self.executor)
        self.control = ControlServer(
            folders.control, self.door.answer, self.door.listen, self._greet, self.gatekeeper.dialled
        )
        self.listener = Listener(folders, self.executor, self.feed)
        self._timer: asyncio.TimerHandle | None = None
        self._kept_open: tuple[str, int, int] | None = None
        self._published: Mapping[str, object] = {}
        self._published_audit: seen.LedgerAudited | None = None

    # ---- the loop ----

    async def run(self) -> int:
        """Watch until everything is stopped as asked. Returns the exit code."""
        loop = asyncio.get_running_loop()
        loop.set_exception_handler(self._on_fault)
        loop.add_signal_handler(signal.SIGTERM, self._on_term)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})  # the launcher kept it back until now
        loop.add_reader(self.listener.fileno(), self.listener.hear)
        await self.control.start()
        self._begin()
        lost = self.setup.before.unwatched_ns is not None
        self.executor.begin(self.gatekeeper.begin(self.setup.leftovers.gateways, lost=lost))
        self.executor.begin(self.senses.examine())
        self.executor.begin(self.executor.outbox.resume(self.url))
        self.senses.begin_survey(self.policy.survey_interval_ms / 1000)
        probing = self.senses.probe_on(self._serving, lambda: self.policy.probe_interval_ms / 1000)
        ongoing = (self._watch(), self._feed_on(), probing, self.policy_desk.look_on())
        tasks = [loop.create_task(work) for work in ongoing]
        for task in tasks:
            task.add_done_callback(_ended_unasked)
        await self.executor.halted.wait()
        await self.gatekeeper.stop()
        await self.calendar.stop()
        await self.standing.finish()
        for task in tasks:
            task.cancel()
        self.control.close()
        loop.remove_reader(self.listener.fileno())
        self.listener.close()
        await self.executor.finish()
        with suppress(OSError):  # everything is stopped; what can't be tidied up is left
            self.setup.folders.switch.unlink(missing_ok=True)
            for word in (self.folders.sentinel_page, self.folders.agents, self.folders.gateway_page):
                word.unlink(missing_ok=True)  # nobody was lost, and nobody is to come
            lives.sweep(self.setup.folders, set(), keep=1)  # the last page is the next start's witness
        return 0

    def _begin(self) -> None:
        setup = self.setup
        self.executor.policy_sha256 = digest(CODEC.encode(setup.in_force.policy))
        found = setup.leftovers
        self.executor.inherit(found.cores, found.adoptable)
        self.executor.filing.left_open = str(setup.noted["id"]) if stops(setup.noted) else ""
        if setup.before.unwatched_ns is not None:
            self.executor.filing.gateway_is_awaited()
        self.executor.begin(self.executor.filing.close_abandoned(setup.abandoned, setup.noted))
        for handle in found.courts:
            self.executor.begin(self.executor.clearing.see_off(handle))
        self.investigators.inherit(found.investigators)
        court = self.court.take_up(setup.aside, setup.court, setup.court_since, setup.unruled)
        if setup.rules_fault:
            self.executor.note("alert", text=setup.rules_fault)
            act = {"who": "sentinel", "verb": "rules", "what": "damaged", "reason": setup.rules_fault}
            self.court.spool("act", act)
        self.feed(
            seen.SentinelBegan(
                clock.now_ns(),
                leftovers=bool(found.cores),
                page=found.last_page,
                adoptable=found.adoptable_page,
                suspects=tuple(map(str, setup.noted.get("suspects", ()))),
                serves_since_ns=found.serves_since_ns,
                court=court,
                unwatched_ns=setup.before.unwatched_ns,
                found_frozen=setup.before.found_frozen,
                drilled=setup.before.drilled,
                shut=deaths.read_shut(self.folders),
            )
        )

    def feed(self, fact: seen.Observation) -> None:
        """Give the manager a fact and do what it orders."""
        if isinstance(fact, seen.OperatorAsked) and fact.verb in GOES_ON:
            self.gatekeeper.resume()
        if isinstance(fact, seen.RequestsSettled) and fact.incident != self.manager.reading().incident:
            self.executor.begin(self.executor.filing.add_late(fact))  # its story has been told
        try:
            self.tape.hear(fact, self.manager)
            self.manager.receive(fact)
            if isinstance(fact, seen.CoreReady | seen.LedgerAudited):
                self.door.proved(fact)
            if isinstance(fact, seen.ComponentRestarted):
                self.door.part_restarted(fact)
            self._obey()
            self.standing.hear(fact)
            if isinstance(fact, seen.EvidenceTaken) and (incident := self.manager.reading().incident):
                self._keep_recording(incident)  # if this guard dies before the end, so much is known
        except Exception as error:  # noqa: BLE001  # half a step was made: whoever told us could not mend that
            _die(f"the fact {type(fact).__name__} could not be taken in", error)

    def _obey(self) -> None:
        # The moment first: the gateway must hold before the hands begin.
        self._publish_reading()
        self.chronicle.take(self.manager.reading().history)
        news = self._news()
        if (
            news is not None
        ):  # before the deeds, which write it down: a guard that dies in them has told of it
            self.executor.keep_open(news)
        given = self.manager.take_actions()
        self.tape.ordered(given)
        # Then who takes over: people wait for that, and for nothing else that may be ordered with it.
        for action in sorted(given, key=lambda each: not isinstance(each, orders.Promote)):
            self.executor.carry_out(action)
            if isinstance(action, orders.CloseIncident):
                self.door.last_incident = action.incident.id
                self.standing.close(action.incident)
                self._keep_recording(action.incident.id)
        self._set_timer()
        for change in self.manager.take_transitions():
            self.standing.change(change)
            self.executor.note(
                "phase",
                before=change.before,
                after=change.after,
                trigger=change.trigger,
                reason=change.reason,
                at_ns=change.at_ns,
            )

    def _news(self) -> orders.Incident | None:
        """Return the open incident if there is more to tell of it than was written down: it may last for hours."""
        told = self.manager.open_incident()
        known = (told.id, len(told.evidence), len(told.deaths)) if told is not None else None
        news, self._kept_open = known != self._kept_open, known
        return told if news else None

    def _keep_recording(self, incident: str) -> None:
        recording = self.tape.cut()
        self.executor.begin(self.executor.filing.add_recording(incident, recording.write))

    def _set_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        deadline_ns = self.manager.next_deadline_ns()
        if deadline_ns is not None:
            loop = asyncio.get_running_loop()
            self._timer = loop.call_at(deadline_ns / NS_PER_S, self._ring)

    def _on_fault(self, _loop: asyncio.AbstractEventLoop, context: Mapping[str, Any]) -> None:
        """A callback of the loop raised: what it was to see or to do is lost, so we end and are started anew.

        A connection that fails is only told: nobody at the door may end the guard.
        """
        error, message = context.get("exception"), str(context.get("message", "a fault in the loop"))
        if "handle" in context:
            _die(message, error)
        self.executor.note("fault", where=message, error=f"{type(error).__name__}: {error}")

    def _ring(self) -> None:
        now_ns = clock.now_ns()
        self.tape.hear(now_ns, self.manager)
        self.manager.handle_deadline(now_ns)
        self._obey()

    async def _watch(self) -> None:
        """Look at the core once in an interval, and at the spare now and then; a late look is not made up for."""
        loop = asyncio.get_running_loop()
        due, ticks = loop.time(), 0
        while True:
            interval_s = self.policy.health_check_interval_ms / 1000
            due = max(due + interval_s, loop.time())
            await asyncio.sleep(due - loop.time())
            self.setup.page.beat()
            life = self.life()
            self.senses.watch(life)
            if life is not None and self.manager.reading().phase in LIVING:
                self.feed(life.look())
            ticks += 1
            spare = self.executor.lives.get(self.manager.reading().spare)
            if spare is not None and ticks % SPARE_EVERY_TICKS == 0:
                self.feed(spare.glance())

    def reading(self) -> Reading:
        """Return what the present moment means."""
        return self.manager.reading()

    def _go_by(self, policy: Policy) -> None:
        """Go by another policy from now on. What was told to a core or a gateway at its start holds until the next."""
        self.policy = policy
        self.executor.bounds = standing.bounds(policy)
        self.executor.policy_sha256 = digest(CODEC.encode(policy))
        self.gatekeeper.policy = self.calendar.policy = policy
        self.senses.pace(policy.survey_interval_ms / 1000)
        with suppress(OSError):  # the agents go by what they were told before
            write_agents(self.folders, self.setup.guard, policy)
        self.feed(seen.PolicyRead(clock.now_ns(), json.dumps(in_full(policy))))

    def curve(self) -> list[dict[str, Any]]:
        """Return what is known of each resource over time."""
        known = self.manager.state()["foresight"]
        assert isinstance(known, Foresight), "it is part of what a manager remembers"
        return self.curves.told(known, clock.now_ns())

    def gateway_told(self) -> Mapping[str, object]:
        """Return what a status says of the gateway."""
        return self.gatekeeper.told()

    def drill_gateway(self) -> str | None:
        """Kill the gateway, as a drill; return why that can't be done now."""
        return self.gatekeeper.drill()

    async def hold_lock(self, seconds: int) -> str | None:
        """Have another process hold the ledger's lock, for a drill."""
        return await rehearsal.hold_lock(self.executor, self.folders, seconds)

    def life(self) -> Life | None:
        """Return the present life of the core, if its process has been made."""
        return self.executor.lives.get(self.manager.reading().life)

    def numbered(self, number: int) -> Life | None:
        """Return a life by its number, if its process has been made."""
        return self.executor.lives.get(number)

    def _serving(self) -> Life | None:
        """Return the life that serves, if one does."""
        return self.life() if self.manager.reading().phase in SERVING else None

    # ---- facts from outside ----

    def _on_term(self) -> None:
        self.feed(seen.OperatorAsked(clock.now_ns(), seen.Verb.STOP, "the guard was told to stop"))

    # ---- the feed ----

    def publish(self, line: Mapping[str, object]) -> None:
        """Send a line to the gateway, under this guard's generation."""
        self.control.publish({**line, "generation": self.setup.generation})

    def _phase_line(self, reading: Reading) -> dict[str, object]:
        """Return the feed's line about the present moment."""
        return {
            "type": "phase",
            "generation": self.setup.generation,
            "phase": reading.phase,
            "state": reading.state,
            "face": reading.face,
            "stage": reading.stage,
            "since_ns": reading.since_ns if reading.fault_ns is None else reading.fault_ns,
            "incident": reading.incident,
            "planned": reading.planned,
            "safe": reading.safe,
        }

    def _publish_reading(self) -> None:
        reading = self.manager.reading()
        line = self._phase_line(reading)
        if line != self._published:
            self._published = line
            self.publish(line)
        if reading.audit is not self._published_audit:
            self._published_audit = reading.audit
            for told in _audit_lines(reading):
                self.publish(told)

    def _still_ours(self) -> None:
        """End at once if the lock that others find is not the one we hold: the run folder was removed.

        Nobody can reach us any more, and another could take the lock anew beside us. The next sentinel finds
        our processes by their environment and starts afresh.
        """
        if not files.still_locked(self.setup.lock_fd, self.folders.run / "sentinel.lock"):
            sys.stderr.write("The run folder was removed; making it anew.\n")
            os._exit(EXIT_UNREACHABLE)

    async def _feed_on(self) -> None:
        while True:
            await asyncio.sleep(FEED_EVERY_S)
            self._still_ours()
            self.publish(self._phase_line(self.manager.reading()))
            self.door.measure()
            self.standing.look()
            self.calendar.look(self.manager.reading(), quiet=self.door.is_quiet)

    def _greet(self) -> list[Mapping[str, object]]:
        reading = self.manager.reading()
        lines: list[Mapping[str, object]] = [self._phase_line(reading)]
        greeting = self.court.greeting()
        lines += [{**line, "generation": self.setup.generation} for line in greeting]
        if reading.epoch is not None:
            told = (*self.executor.serving, *_audit_lines(reading), *self.executor.outbox.lines)
            lines += [{**line, "generation": self.setup.generation} for line in told]
        return lines


def _audit_lines(reading: Reading) -> list[dict[str, object]]:
    """Return the feed's line about the proof of the whole ledger, if the serving core has made it."""
    audit = reading.audit
    if audit is None:
        return []
    return [{"type": "verified", "epoch": reading.epoch, "ok": audit.ok, "seq": audit.seq}]


def _ended_unasked(task: asyncio.Task[None]) -> None:
    if not task.cancelled():
        _die("the watch, the feed or the probing ended", task.exception())


def _die(what: str, error: object) -> NoReturn:
    """Say why and end at once; the launcher starts a guard that sees again."""
    if isinstance(error, BaseException):
        what += ": " + "".join(traceback.format_exception(error)).rstrip()
    logs.end_with(what)


def main() -> int:
    """Run the sentinel."""
    parser = argparse.ArgumentParser(prog="hardcore.runtime", description="The sentinel; started by `up`.")
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--listen-fd", type=int, required=True)
    parser.add_argument("--url", required=True)
    asked = parser.parse_args()
    # The terminal's signals go to everybody in the foreground; the launcher passes on what is meant for us.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    # The hands' threads give way to the loop at once: at the usual 5 ms a switch waited for the log's thread.
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    # Inherited by all we start: a core file would hold the ledger's memory, and the policy says never.
    resource.setrlimit(resource.RLIMIT_CORE, (0, resource.getrlimit(resource.RLIMIT_CORE)[1]))
    setup = set_up(asked.data, asked.listen_fd, asked.url)
    if isinstance(setup, int):
        return setup
    return asyncio.run(_run(setup))


async def _run(setup: Setup) -> int:
    try:
        return await Runtime(setup).run()
    except Exception as error:  # noqa: BLE001  # what ends by an exception must not wait for a hanging hand
        _die("the watch could not go on", error)


if __name__ == "__main__":
    code = main()
    sys.stderr.flush()
    os._exit(code)  # a hand that hangs in the kernel would be waited for at the interpreter's end
