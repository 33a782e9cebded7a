"""The court's hands: trials are held, letters set aside, everybody told, and all of it is still so after a death.

What the manager decides of suspects is carried out here, and each deed keeps one order: the file first, then the cores,
then the gateway, then the investigators. A guard that dies in between is followed by one that goes on from the files
(`take_up`). A suspect's name can be read before a core is released, so an importer does not run a row again that is
about to be tried. The executor itself was not chosen for this: nothing here is on the way back to serving, and a trial
may hang for minutes.
"""

import asyncio
import datetime as dt
from collections.abc import Coroutine, Mapping, Sequence
from typing import Any, Final, assert_never

from msgspec import structs

from hardcore import quarantine_file, sitting
from hardcore.court_words import (
    message,
    said_again,
    settled_by,
    suspect_lines,
    verdict_of_acquittal,
    verdict_of_letter,
)
from hardcore.host import clock, docket, suspects
from hardcore.host.docket import Case, Heard, Said, Unknown
from hardcore.host.folders import Folders
from hardcore.model import trials
from hardcore.model.trials import CourtMemory, Letter, Ordeal, SuspectNote, Tried
from hardcore.quarantine_file import Aside
from hardcore.rule_book import Doors, Hands, RuleBook
from hardcore.sitting import Terms
from postmortem.dead_letters import spool
from postmortem.dead_letters.spool import SpoolFailed

#: A release waits for the names of its suspects to be on the disk, but not for a disk that hangs.
RELEASE_WAITS_S: Final = 0.5
#: Verdicts that are said again to a gateway that joins: the last ones.
VERDICTS_MAX: Final = 512
#: What was said in trials, until its letter is written.
HEARD_MAX: Final = 512
#: Cases that nobody remembers are removed when they are older than this.
CASE_KEPT_S: Final = 86_400


class CourtRoom:
    """Carries out what is ordered of suspects and trials; `rules` are those in force."""

    def __init__(self, folders: Folders, generation: int, hands: Hands, doors: Doors) -> None:
        self.rules = RuleBook(folders, generation, hands, doors)
        self._folders = folders
        self._hands = hands
        self._doors = doors
        self._memory = CourtMemory()
        self._since: dict[str, str] = {}
        self._open: tuple[SuspectNote, ...] = ()
        self._verdicts: dict[str, dict[str, object]] = {}
        self._heard: dict[str, Tried] = {}
        self._keeping = asyncio.Lock()
        self._unwritten = 0
        self._written = asyncio.Event()
        self._written.set()
        self._court: asyncio.Task[str] | None = None
        self._sending: set[str] = set()
        self._has_looked = False  # for cases that an earlier guard was told of

    def take_up(
        self, aside: Aside, memory: CourtMemory, since: Mapping[str, str], unruled: Sequence[Letter] = ()
    ) -> CourtMemory:
        """Go on where an earlier guard was; return what its court remembers, and what its rules say of that.

        `unruled`: letters that it remembered and that no rule stands for; they are set aside now.
        """
        self.rules.aside = aside
        self._memory = settled_by(memory, aside)
        self._since = dict(since)
        self._verdicts = said_again(self._memory, aside)
        for rule in aside.unsent:
            self._hands.begin(self._send(rule["id"]))
        for letter in unruled:
            self._hands.begin(self._set_aside(letter))
        wanted = {one.name for one in self._memory.suspects if one.ordeal is None}
        wanted |= {letter.name for letter in unruled}
        wanted |= {str(rule.get("name")) for rule in aside.unsent}
        sweeping = self._hands.in_hand(docket.sweep, self._folders.cases, wanted, CASE_KEPT_S)
        self._hands.begin(sweeping)
        return self._memory

    def carry_out(self, order: trials.TrialAction) -> None:
        """Begin to carry out one order."""
        match order:
            case trials.Try():
                self._hold_court(self._try(order))
            case trials.TryLog():
                self._hold_court(self._try_log(order))
            case trials.EndTrials():
                if self._court is not None:
                    self._court.cancel()
            case trials.SetAside():
                self._hands.begin(
                    self._say_again(order.letter) if order.again else self._set_aside(order.letter)
                )
            case trials.Acquit():
                self._acquit(order)
            case trials.StopSource():
                self._hands.begin(self._stop_source(order))
            case trials.KeepCourt():
                self._keep(order)
            case trials.AddTrials():
                self._hands.begin(self._doors.add_trials(order))
            case _:
                assert_never(order)

    async def stop(self) -> None:
        """End the court that sits: the guard ends."""
        if self._court is not None:
            self._court.cancel()
            await asyncio.wait({self._court}, timeout=sitting.LEAVE_S + 1.0)

    # ---- who joins ----

    def greeting(self) -> list[dict[str, object]]:
        """Return what a gateway that joins has to know of all this."""
        lines = suspect_lines(self._open)
        lines += [dict(line) for line in list(self._verdicts.values())[-VERDICTS_MAX:]]
        return [self.rules.line(), *lines]

    @property
    def is_written(self) -> bool:
        """Whether those who are suspect now are named on the disk."""
        return self._written.is_set()

    async def written(self) -> None:
        """Wait until those who are suspect now are named on the disk, or not much longer."""
        try:
            await asyncio.wait_for(self._written.wait(), RELEASE_WAITS_S)
        except TimeoutError:
            self._hands.note("court", unwritten="a core is released before its suspects are on the disk")

    async def case_filed(self, name: str) -> None:
        """Somebody says that this suspect's case lies on the disk."""
        found = await self._hands.in_hand(docket.read_case, self._folders.cases, name)
        if isinstance(found, Unknown):
            self._hands.note("case", name=name[:32], unusable=found.why)
            return
        self._doors.tell(trials.CaseFiled(clock.now_ns(), name, found.source, found.digest))

    async def settled(self, names: tuple[str, ...]) -> None:
        """These suspects are in the ledger: nothing of them is needed any more."""
        self._doors.tell(trials.SuspectsSettled(clock.now_ns(), names))
        for name in names:
            await self._hands.in_hand(self._forget_case, name)

    # ---- trials ----

    def _hold_court(self, work: Coroutine[Any, Any, str]) -> None:
        """Hold a court, and say in any case when it is gone: the manager waits for that word."""
        self._court = asyncio.get_running_loop().create_task(_to_its_end(work, self._court))
        self._court.add_done_callback(lambda court: self._over(court, work))

    def _over(self, court: "asyncio.Task[str]", work: Coroutine[Any, Any, str]) -> None:
        work.close()  # of one that was ended before it had begun
        fault = "it was ended" if court.cancelled() else court.result()
        if fault:
            self._hands.note("court", fault=fault)
        self._doors.tell(trials.TrialsOver(clock.now_ns(), fault))

    async def _try(self, order: trials.Try) -> str:
        cases = []
        for name in order.names:
            found = await self._hands.in_hand(docket.read_case, self._folders.cases, name)
            if isinstance(found, Case):
                cases.append(found)
            else:
                self._doors.tell(trials.Tried(clock.now_ns(), name, Ordeal.UNTRIED, why=found.why))
        terms = Terms(order.limit_ms, order.memory_bytes)
        for part in docket.cut(cases):
            fault = await self._hear_all(part, terms)
            if fault:
                return fault
        return ""

    async def _hear_all(self, cases: Sequence[Case], terms: Terms) -> str:
        """Have these tried; where the court will not take them together, each by itself, so that none spoils the others."""
        over = await self._sit([case.case for case in cases], terms)
        if not over.unusable or len(cases) == 1:
            return over.fault
        for case in cases:
            over = await self._sit([case.case], terms)
            if over.unusable:
                self._doors.tell(trials.Tried(clock.now_ns(), case.name, Ordeal.UNTRIED, why=over.fault))
            elif over.fault:
                return over.fault
        return ""

    async def _try_log(self, order: trials.TryLog) -> str:
        terms = Terms(order.limit_ms, order.memory_bytes, search=True)
        return (await self._sit([docket.of_log(order.after_seq)], terms)).fault

    async def _sit(self, cases: Sequence[Mapping[str, Any]], terms: Terms) -> sitting.Over:
        return await sitting.sit(self._hands, self._folders, cases, terms, self._hear)

    def _hear(self, heard: Heard | Said) -> None:
        if isinstance(heard, Said):
            self._doors.tell(trials.CourtAtWork(clock.now_ns()))
            return
        tried = heard.tried
        self._hands.note("trial", name=tried.name, ordeal=tried.ordeal, took_ms=tried.took_ms, why=tried.why)
        self._heard[tried.name] = tried
        while len(self._heard) > HEARD_MAX:
            del self._heard[next(iter(self._heard))]
        self._doors.tell(tried)

    # ---- letters ----

    async def _set_aside(self, letter: Letter) -> None:
        """Refuse it from now on; then tell whoever waits for it, and write its letter."""
        if self.rules.aside.rule(letter.id) is None:
            case = await self._hands.in_hand(docket.read_case, self._folders.cases, letter.name)
            tried = self._heard.get(letter.name if letter.seq is None else docket.LOG_NAME)
            told = message(letter, case, tried, clock.wall(clock.now_ns()))
            if not await self.rules.change(lambda aside: _with_letter(aside, letter, told)):
                return
            await self.rules.disarm(letter.name)
            self._hands.note("letter", id=letter.id, name=letter.name, reason=letter.reason)
        await self.rules.tell_cores()
        self._say_verdict(letter.name, verdict_of_letter(letter.name, letter.id, letter.reason))
        await self._send(letter.id)

    async def _say_again(self, letter: Letter) -> None:
        """Tell whoever waits for it what it was told before.

        Where there is no rule it is being written, and told then; or a person has just taken it away.
        """
        if self.rules.aside.rule(letter.id) is not None:
            await self.rules.tell_cores()
            self._say_verdict(letter.name, verdict_of_letter(letter.name, letter.id, letter.reason))

    async def _send(self, letter_id: str) -> None:
        """Write a letter for the investigators, again and again until the disk takes it; once is enough."""
        rule = self.rules.aside.rule(letter_id)
        if rule is None or quarantine_file.UNSENT not in rule or letter_id in self._sending:
            return
        self._sending.add(letter_id)
        try:
            told = rule[quarantine_file.UNSENT]
            if await self.rules.persist(lambda: self._hands.in_hand(self._spool_letter, told)):
                await self.rules.change(lambda aside: quarantine_file.sent(aside, letter_id))
                await self._hands.in_hand(self._forget_case, str(rule.get("name", "")))
        finally:
            self._sending.discard(letter_id)

    def _spool_letter(self, message: Mapping[str, Any]) -> str:
        """Write the message; return why that can't be done. Blocks on the disk."""
        found = docket.read_case(self._folders.cases, str(message.get("name", "")))
        case = found.case if isinstance(found, Case) else None
        written = spool.write(self._folders.spool, "letter", {**message, "case": case})
        return written.reason if isinstance(written, SpoolFailed) else ""

    def spool(self, kind: str, fields: Mapping[str, Any]) -> None:
        """Say something to the investigators; what their disk does not take is told in the log, and no more."""
        self._hands.begin(self._spool(kind, {"at": clock.wall(clock.now_ns()), **fields}))

    async def _spool(self, kind: str, fields: Mapping[str, Any]) -> None:
        written = await self._hands.in_hand(spool.write, self._folders.spool, kind, fields)
        if isinstance(written, SpoolFailed):
            self._hands.note("spool", unwritten=kind, failed=written.reason)

    # ---- what becomes of the others ----

    def _acquit(self, order: trials.Acquit) -> None:
        self._hands.begin(self._let_go(order))

    async def _let_go(self, order: trials.Acquit) -> None:
        await self.rules.disarm(order.name)  # a drill that showed nothing on trial must not kill who serves
        await self._hands.in_hand(self._forget_case, order.name)
        self._say_verdict(order.name, verdict_of_acquittal(order.name, run=order.run))

    def _say_verdict(self, name: str, line: dict[str, object]) -> None:
        self._verdicts.pop(name, None)  # the newest stand last
        self._verdicts[name] = line
        while len(self._verdicts) > VERDICTS_MAX:
            del self._verdicts[next(iter(self._verdicts))]
        self._doors.publish(line)

    async def _stop_source(self, order: trials.StopSource) -> None:
        now_ns = clock.now_ns()
        until = clock.wall(now_ns + order.for_ns)
        now = clock.wall(now_ns)
        if await self.rules.change(
            lambda aside: quarantine_file.with_source(aside, order.source, until, now)
        ):
            self._hands.note("source", stopped=order.source, until=until)
            await self.rules.tell_cores()

    def _keep(self, order: trials.KeepCourt) -> None:
        """Remember who is suspect; those who must know now are told at once, the disk without waiting for its fsync."""
        self._since = suspects.times(self._since, self._memory, order.memory, dt.datetime.now(dt.UTC))
        newly = [one for one in order.suspects if one not in self._open]
        self._memory, self._open = order.memory, order.suspects
        for one in order.suspects:
            self._verdicts.pop(one.name, None)
        for line in suspect_lines(newly):
            self._doors.publish(line)
        if not self._has_looked:
            self._has_looked = True
            self._hands.begin(self._find_cases([one.name for one in order.suspects]))
        self._unwritten += 1
        self._written.clear()
        self._hands.begin(self._write_court())

    async def _write_court(self) -> None:
        """Write who is suspect: visible to every process at once, and safe from a power cut when the disk has its peace.

        While a spare takes over, its fence waits for the same disk: an fsync beside it would make it wait longer.
        """
        changed = self._shown(self.rules.aside) != self.rules.aside.suspects
        if changed:
            await self.rules.show(lambda aside: quarantine_file.with_suspects(aside, self._shown(aside)))
        await self._put(durable=False)
        self._unwritten -= 1
        if not self._unwritten:
            self._written.set()
        if changed:
            await self.rules.tell_cores()
        await self._doors.calm()
        failed = await self.rules.keep() if changed else ""
        failed = await self._put(durable=True) or failed
        if failed:
            self._hands.note("court", failed=failed)

    def _shown(self, aside: Aside) -> tuple[SuspectNote, ...]:
        """Return whom the file names: who is suspect, and who was until its rule lies there.

        Whoever reads the file would see neither for a moment, and run again what has just been convicted.
        """
        open_now = {one.name for one in self._open}
        unwritten = {
            one.name for one in self._memory.suspects if one.letter and aside.rule(one.letter) is None
        }
        staying = (one for one in aside.suspects if one.name in unwritten - open_now)
        return (*self._open, *staying)[: quarantine_file.SUSPECTS_MAX]

    async def _put(self, *, durable: bool) -> str:
        """Write down what the court remembers now; return why that can't be done."""
        async with self._keeping:  # in their order: an older memory must not be written over a newer one
            failed: str = await self._hands.in_hand(self._write, self._memory, dict(self._since), durable)
            return failed

    def _write(self, memory: CourtMemory, since: Mapping[str, str], durable: bool) -> str:  # noqa: FBT001  # a hand takes no names
        try:
            suspects.write(self._folders, memory, since, durable=durable)
        except OSError as error:
            return error.strerror or type(error).__name__
        return ""

    # ---- cases ----

    async def _find_cases(self, names: Sequence[str]) -> None:
        """Take the cases of these for filed: the guard that was told of them may have died before it wrote that down."""
        filed = await self._hands.in_hand(docket.filed, self._folders.cases)
        for name in filter(filed.__contains__, names):
            await self.case_filed(name)

    def _forget_case(self, name: str) -> None:
        if docket.is_name(name):
            try:
                (self._folders.cases / f"{name}.json").unlink(missing_ok=True)
            except OSError as error:
                self._hands.note("case", name=name, left=error.strerror)


def _with_letter(aside: Aside, letter: Letter, told: Mapping[str, Any]) -> Aside:
    """Return the rules with this letter's, once: what was written meanwhile stays as it is, and so does its message."""
    if aside.rule(letter.id) is not None:
        return aside
    after = quarantine_file.set_aside(aside, letter, told)
    left = tuple(one for one in after.suspects if one.name != letter.name)
    return structs.replace(after, suspects=left)


async def _to_its_end(work: Coroutine[Any, Any, str], before: "asyncio.Task[str] | None") -> str:
    """Hold a court when the one before is gone; return its fault, if it had one."""
    if before is not None:
        await asyncio.wait({before})
    try:
        return await work
    except Exception as error:  # noqa: BLE001  # whatever it is: a court of which nobody hears would never be over
        return f"the trial could not be held ({type(error).__name__}: {error})"
