"""The court: who is suspect of a death, who is on trial, and what comes of it, as one pure value.

A death convicts nobody. It makes suspects; each is tried once in a throw-away core, and only doing it again there
makes it a poison. Everything unclear (a trial that could not be held, one that somebody ended from outside, slowness
where the death was none) is tried once more and then left to a person, never called poison. A death that is explained
by a conviction is taken off whoever else was at work in it; so no innocent gathers deaths in bad company. Not chosen:
strikes, counted by command (they convicted 79 innocents in 150 deaths), and trials in the core that serves (a
poison would cost it two deaths).

The court receives facts and gives orders. It knows nothing of phases, budgets and incidents but their ids
(`hearing.py` joins them); one court sits at a time, on a copy, so no death of a core ends it.
"""

import dataclasses
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from hardcore.model.observations import Exit
from hardcore.model.recorder import CommandNote
from hardcore.model.trials import (
    REPRODUCED,
    Acquit,
    AddTrials,
    Conviction,
    CourtMemory,
    EndTrials,
    KeepCourt,
    Letter,
    Ordeal,
    Reason,
    SetAside,
    StopSource,
    Suspect,
    SuspectNote,
    TrialAction,
    TrialNote,
    Tried,
    Try,
    TryLog,
)
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.budget import NS_PER_MS, NS_PER_S
from hardcore.sentinel.deaths import own_fault

SUSPECTS_MAX = 4096
#: What became of a suspect is remembered so long: its next death is then its second.
REMEMBERED_NS = 86_400 * NS_PER_S
#: Cases of one death come within milliseconds of each other: they are waited for, so that they share one court.
GATHER_NS = 100 * NS_PER_MS
#: As long as a gateway holds a request. Then company goes, and nobody's account waits for a case that does not come.
PATIENCE_NS = 10 * NS_PER_S
#: A court that was told to end is taken for gone after this, whatever its process does.
ENDING_NS = 5 * NS_PER_S
#: A trial that says nothing is held once more.
TRIES_MAX = 2
#: From so many deaths on that nothing explains, a suspect that does no harm on trial is left to a person.
HELD_DEATHS = 2
#: Cases in one docket (docs/wires.md section 12).
DOCKET_MAX = 256
#: Incidents that a letter names.
BEFORE_MAX = 16
CONVICTIONS_MAX = 1024
CONVICTIONS_WINDOW_NS = 60 * NS_PER_S

#: Deaths of a core that hung: slowness on trial is the same thing done again.
_HANGS = frozenset(
    {
        Diagnosis.LOOP_BLOCKED,
        Diagnosis.SPINNING,
        Diagnosis.GIL_HELD,
        Diagnosis.DEADLOCK,
        Diagnosis.TRANSACTION_TIMEOUT,
    }
)
#: The kind of a drill's command: what it does counts on nobody's budget.
DRILL_KIND = "drill"


@dataclass(frozen=True, slots=True)
class Rules:
    """The numbers of the policy that the court goes by. `begin_ms`: time to make the copy and the first core."""

    limit_ms: int
    memory_bytes: int
    begin_ms: int
    trial_limit: int
    max_convictions: int
    source_stop_ns: int


@dataclass(frozen=True, slots=True)
class Death:
    """A death as the court knows it. Several pages may tell of one; they are one death all the same."""

    at_ns: int
    incident: str
    blame: Diagnosis


@dataclass(frozen=True, slots=True)
class Docket:
    """What is on trial. `doubted`: survivors for whom it matters whether another is convicted. `log`: the events."""

    names: tuple[str, ...]
    due_ns: int
    log: bool = False
    ending: bool = False
    doubted: tuple[str, ...] = ()


@dataclass(slots=True)
class Court:
    """See the module. `suspects` by name, in the order in which they are to be tried. Times are monotonic."""

    rules: Rules
    suspects: dict[str, Suspect] = field(default_factory=dict)
    settled_seq: int = 0
    parked: tuple[int, ...] = ()
    convictions: tuple[Conviction, ...] = ()
    docket: Docket | None = None
    log: Death | None = None  # the death for which the log was or is to be tried last
    log_after: int | None = None  # it has yet to be tried, from here on
    served_ns: int | None = None  # since when a core serves; None: none does
    doubt: Death | None = None  # if no trial explains this one, the log is tried for it
    acquitted_ns: int | None = None  # when somebody was last told to run
    untold: tuple[str, ...] = ()  # incidents that have yet to be told what came of their trials
    changed: bool = False

    # ---- what it is told ----

    def inherit(self, memory: CourtMemory, names: Iterable[str], now_ns: int) -> None:
        """Go on where an earlier guard's court was; `names`: whom it may not have had the time to write down.

        Stamps of another boot lie in the future at worst: they count as fresh. Nobody knows what those names did; they
        are tried before they are run, and no death counts against them.
        """
        self.suspects = {
            one.name: dataclasses.replace(one, at_ns=min(one.at_ns, now_ns), waits=True)
            for one in memory.suspects[-SUSPECTS_MAX:]
        }
        self.settled_seq, self.parked = memory.settled_seq, memory.parked
        self.convictions = memory.convictions[-CONVICTIONS_MAX:]
        for name in names:
            if name not in self.suspects:
                self._put(Suspect(name, "", deaths=0, at_ns=now_ns))
        self._bound(now_ns)
        self.changed = True

    def accuse(self, death: Death, touched: Iterable[CommandNote], company: Iterable[CommandNote]) -> None:
        """Take in who was at work in a death from inside, and who stood behind them."""
        for note in touched:
            old = self.suspects.get(note.key_hash)
            if old is None or old.company or old.at_ns != death.at_ns:
                self._put(_accused(note, death, old))
        for note in list(company)[: self.rules.trial_limit]:
            old = self.suspects.get(note.key_hash)
            if old is None or not (old.open or old.letter):
                deaths = old.deaths if old is not None else 0
                again = _accused(note, death, old)
                self._put(dataclasses.replace(again, deaths=deaths, company=True))
        self._bound(death.at_ns)

    def clear(self, now_ns: int) -> list[TrialAction]:
        """A core died though no suspect was at work in it: it was none of them. Whoever is open is run."""
        given: list[TrialAction] = []
        for one in list(self.suspects.values()):
            if one.letter:
                continue
            self._put(dataclasses.replace(one, deaths=0))
            if one.open:
                given += self._release(one.name, Ordeal.UNTRIED, "a core died without it", now_ns)
        return given

    def suspect_log(self, death: Death, after_seq: int) -> list[TrialAction]:
        """Have the events after `after_seq` tried for this death, before anybody else."""
        self.log, self.log_after = death, after_seq
        return self._end(death.at_ns) if self.docket is not None and not self.docket.log else []

    def filed(self, name: str, source: str, digest: str, now_ns: int) -> list[TrialAction]:
        """The request of `name` is on the disk, and whoever sent it waits."""
        one = self.suspects.get(name)
        if one is None or (not one.open and not one.letter):
            return [Acquit(name, run=True)]  # nobody suspects it, or does not any more
        if not one.open:
            return [SetAside(_letter(one))]
        filed_ns = one.filed_ns if one.filed else now_ns
        self._put(
            dataclasses.replace(one, filed=True, source=source, digest=digest, filed_ns=filed_ns, waits=True)
        )
        return []

    def settled(self, names: Iterable[str]) -> None:
        """These are in the ledger: they were never a suspect's."""
        for name in names:
            one = self.suspects.get(name)
            if one is not None and not one.letter:
                self._forget(name)

    def tried(self, fact: Tried, new_id: Callable[[], str]) -> list[TrialAction]:
        """One case was tried; `new_id` gives numbers of letters."""
        if self.docket is not None and not self.docket.ending:
            self.docket = dataclasses.replace(self.docket, due_ns=self._due_ns(fact.at_ns))
        if self.docket is not None and self.docket.log:
            return self._tried_log(fact, new_id)
        one = self.suspects.get(fact.name)
        if one is None or not one.open:
            return []
        one = dataclasses.replace(
            one,
            took_ms=fact.took_ms,
            why=fact.why,
            fingerprint=fact.fingerprint or one.fingerprint,
            kind=fact.kind or one.kind,
            account_ids=fact.account_ids or one.account_ids,
            transaction_id=fact.transaction_id or one.transaction_id,
        )
        self._put(one)
        return self._ruled(one, fact, new_id) + self._dismiss_company(fact.at_ns)

    def over(self, fault: str, now_ns: int, new_id: Callable[[], str]) -> list[TrialAction]:
        """The court's process is gone; `fault`: why it could not do its work."""
        docket, self.docket = self.docket, None
        if docket is None:
            return []
        given: list[TrialAction] = []
        for name in docket.names:
            one = self.suspects.get(name)
            if one is None or not one.open:
                continue
            if name in docket.doubted:
                given += self._survived(one, now_ns, new_id, last=True)
            elif not docket.ending:
                given += self._unclear(one, fault or "its trial was not held", now_ns, new_id)
        return given + self._dismiss_company(now_ns)

    def released(self, rule: str) -> None:
        """A person took the rule of this letter away: what it named begins anew."""
        for key, one in list(self.suspects.items()):
            if one.letter == rule:
                del self.suspects[key]
                self.parked = tuple(seq for seq in self.parked if seq != one.seq)
                self.changed = True

    # ---- what it orders by itself ----

    def convene(self, now_ns: int, new_id: Callable[[], str]) -> list[TrialAction]:
        """Do what the time has come for, and begin the next court if there is one to be held."""
        given = self._lose_patience(now_ns)
        if self.docket is not None and now_ns >= self.docket.due_ns:
            if self.docket.ending:
                given += self.over("it did not end", now_ns, new_id)
            else:
                given += self._time_is_over(now_ns, new_id)
        if self.doubt is not None and not self._is_on_trial(self.doubt):
            unexplained, self.doubt = self.doubt, None
            if not self.explains(unexplained.at_ns) and not self._knows_log_of(unexplained):
                given += self.suspect_log(unexplained, self.settled_seq)
        if self.docket is None and self.log_after is not None:
            after, self.log_after = self.log_after, None
            self.docket = Docket((), self._due_ns(now_ns), log=True)
            given.append(TryLog(after, self.rules.limit_ms, self.rules.memory_bytes))
        elif self.docket is None and self.served_ns is not None and now_ns >= self._gathered_ns(now_ns):
            given += self._try(now_ns, new_id)
        return given

    def next_ns(self) -> int | None:
        """Return when `convene` wants to be called, or None while nothing waits for its time."""
        due = [] if self.docket is None else [self.docket.due_ns]
        if self.docket is None and self.served_ns is not None and any(map(_ready, self.suspects.values())):
            due.append(self._gathered_ns(0))
        due += [at_ns for one in self.suspects.values() if (at_ns := self._impatient_ns(one)) is not None]
        return min(due, default=None)

    def kept(self) -> list[TrialAction]:
        """Return what has to be written down and told since the last time."""
        given: list[TrialAction] = []
        if self.changed:
            self.changed = False
            notes = tuple(
                SuspectNote(one.name, one.account_ids if one.waits else ())
                for one in self.suspects.values()
                if one.open
            )
            given.append(KeepCourt(notes, self.memory))
        waiting = {one.incident for one in self.suspects.values() if one.open and one.waits}
        given += (AddTrials(name, self.notes(name)) for name in self.untold if name not in waiting)
        self.untold = tuple(name for name in self.untold if name in waiting)
        return given

    # ---- what may be asked ----

    @property
    def memory(self) -> CourtMemory:
        """What a successor has to know."""
        return CourtMemory(tuple(self.suspects.values()), self.settled_seq, self.parked, self.convictions)

    @property
    def tries_log(self) -> bool:
        """Whether the log is on trial, or about to be."""
        return self.log_after is not None or (self.docket is not None and self.docket.log)

    def open_names(self) -> tuple[str, ...]:
        """Return who must not be run before its trial."""
        return tuple(one.name for one in self.suspects.values() if one.open)

    def notes(self, incident: str) -> tuple[TrialNote, ...]:
        """Return what came of the trials of an incident so far."""
        return tuple(
            TrialNote(one.name, one.command_id, one.ordeal, one.letter, one.took_ms, one.why)
            for one in self.suspects.values()
            if one.incident == incident and one.ordeal is not None
        )

    def explains(self, at_ns: int) -> bool:
        """Whether somebody was convicted of the death of that moment."""
        return any(one.at_ns == at_ns and one.ordeal in REPRODUCED for one in self.suspects.values())

    # ---- judgements ----

    def _ruled(self, one: Suspect, fact: Tried, new_id: Callable[[], str]) -> list[TrialAction]:
        if fact.ordeal is Ordeal.COMMITTED:
            # Run: a core that has its key answers what it answered then.
            return self._release(one.name, Ordeal.COMMITTED, fact.why, fact.at_ns)
        if fact.ordeal is Ordeal.SURVIVED:
            return self._survived(one, fact.at_ns, new_id, last=self.docket is None)
        if not _is_its_own(fact):
            return self._unclear(one, fact.why or "its trial was ended from outside", fact.at_ns, new_id)
        if fact.ordeal is Ordeal.HUNG and one.blame not in _HANGS and not one.hung:
            self._put(dataclasses.replace(one, hung=True))  # slow is not guilty: once more
            return []
        return self._convict(one, fact.ordeal, fact.at_ns, new_id)

    def _survived(
        self, one: Suspect, now_ns: int, new_id: Callable[[], str], *, last: bool
    ) -> list[TrialAction]:
        if one.company or one.deaths < HELD_DEATHS:
            return self._release(one.name, Ordeal.SURVIVED, one.why, now_ns)
        if last:
            return self._hold(one, Ordeal.SURVIVED, one.why, now_ns, new_id)
        assert self.docket is not None, "a court sits while it is not the last word"
        self.docket = dataclasses.replace(self.docket, doubted=(*self.docket.doubted, one.name))
        return []

    def _unclear(self, one: Suspect, why: str, now_ns: int, new_id: Callable[[], str]) -> list[TrialAction]:
        if one.company:
            return self._release(one.name, Ordeal.UNTRIED, why, now_ns)
        if one.hung:  # it is tried again all the same
            why = "its trial took too long"
        one = dataclasses.replace(one, tries=one.tries + 1, why=why)
        self._put(one)
        return [] if one.tries < TRIES_MAX else self._hold(one, Ordeal.UNTRIED, why, now_ns, new_id)

    def _convict(
        self, one: Suspect, ordeal: Ordeal, now_ns: int, new_id: Callable[[], str]
    ) -> list[TrialAction]:
        if not self.explains(one.at_ns):
            for other in list(self.suspects.values()):
                if other.at_ns == one.at_ns and other.deaths and other.name != one.name and not other.letter:
                    self._put(dataclasses.replace(other, deaths=other.deaths - 1))
        closed = self._close(dataclasses.replace(one, letter=new_id()), ordeal, one.why, now_ns)
        return [SetAside(_letter(closed)), *self._count(closed, now_ns)]

    def _hold(
        self, one: Suspect, ordeal: Ordeal, why: str, now_ns: int, new_id: Callable[[], str]
    ) -> list[TrialAction]:
        closed = self._close(dataclasses.replace(one, letter=new_id()), ordeal, why, now_ns)
        return [SetAside(_letter(closed))]

    def _release(self, name: str, ordeal: Ordeal, why: str, now_ns: int) -> list[TrialAction]:
        self._close(self.suspects[name], ordeal, why, now_ns)
        self.acquitted_ns = now_ns
        return [Acquit(name, run=True)]

    def _close(self, one: Suspect, ordeal: Ordeal, why: str, now_ns: int) -> Suspect:
        closed = dataclasses.replace(one, ordeal=ordeal, why=why, closed_ns=now_ns)
        self._put(closed)
        if one.incident and one.incident not in self.untold:
            self.untold = (*self.untold, one.incident)
        return closed

    def _count(self, one: Suspect, now_ns: int) -> list[TrialAction]:
        """Count a conviction; stop its source if there were too many."""
        if not one.source or one.kind == DRILL_KIND:
            return []
        since_ns = now_ns - CONVICTIONS_WINDOW_NS
        fresh = (*(c for c in self.convictions if c.at_ns > since_ns), Conviction(one.source, now_ns))
        if sum(c.source == one.source for c in fresh) <= self.rules.max_convictions:
            self.convictions = fresh[-CONVICTIONS_MAX:]
            return []
        self.convictions = tuple(c for c in fresh if c.source != one.source)
        return [StopSource(one.source, self.rules.source_stop_ns)]

    def _tried_log(self, fact: Tried, new_id: Callable[[], str]) -> list[TrialAction]:
        if fact.seq is None or fact.ordeal not in REPRODUCED or not _is_its_own(fact):
            return []
        key, death = f"event {fact.seq}", self.log
        known = self.suspects.get(key)
        if known is not None or death is None:
            return []
        found = Suspect(
            fact.name,
            death.incident,
            command_id="",
            kind=fact.kind,
            account_ids=fact.account_ids,
            transaction_id=fact.transaction_id,
            at_ns=death.at_ns,
            blame=death.blame,
            fingerprint=fact.fingerprint,
            took_ms=fact.took_ms,
            why=fact.why,
            seq=fact.seq,
        )
        self.parked = (*self.parked, fact.seq)
        self.log = None  # the next death may be another event's
        return self._convict(found, fact.ordeal, fact.at_ns, new_id)

    # ---- sittings ----

    def _try(self, now_ns: int, new_id: Callable[[], str]) -> list[TrialAction]:
        ready = [one for one in self.suspects.values() if _ready(one)]
        ready.sort(key=lambda one: one.company)
        room: dict[tuple[str, bool], int] = {}
        names: list[Suspect] = []
        left: list[Suspect] = []
        for one in ready:
            place = (one.incident, one.company)
            room.setdefault(place, self.rules.trial_limit - self._tried_in(place))
            room[place] -= 1
            (names if one.tries or one.hung or room[place] >= 0 else left).append(one)
        if names:
            self.docket = Docket(tuple(one.name for one in names[:DOCKET_MAX]), self._due_ns(now_ns))
            return [Try(self.docket.names, self.rules.limit_ms, self.rules.memory_bytes)]
        given: list[TrialAction] = []
        for one in left:
            why = "more were suspected than are tried in one incident"
            if one.company or self.explains(one.at_ns):
                given += self._release(one.name, Ordeal.UNTRIED, why, now_ns)
            else:
                given += self._hold(one, Ordeal.UNTRIED, why, now_ns, new_id)
        return given

    def _tried_in(self, place: tuple[str, bool]) -> int:
        return sum(
            (one.incident, one.company) == place and (not one.open or one.tries > 0)
            for one in self.suspects.values()
        )

    def _time_is_over(self, now_ns: int, new_id: Callable[[], str]) -> list[TrialAction]:
        """The court has been silent for longer than a case may take: what it had not tried counts as not tried."""
        assert self.docket is not None, "only a court that sits is late"
        names = [name for name in self.docket.names if name not in self.docket.doubted]
        given = self._end(now_ns)
        for name in names:
            one = self.suspects.get(name)
            if one is not None and one.open:
                given += self._unclear(one, "the court did not answer", now_ns, new_id)
        return given

    def _end(self, now_ns: int) -> list[TrialAction]:
        if self.docket is None or self.docket.ending:
            return []
        self.docket = dataclasses.replace(self.docket, ending=True, due_ns=now_ns + ENDING_NS)
        return [EndTrials()]

    def _dismiss_company(self, now_ns: int) -> list[TrialAction]:
        """Let company go whose suspects turned out to be harmless, and end a court that has nobody else left."""
        accused = {one.at_ns for one in self.suspects.values() if one.open and not one.company}
        given: list[TrialAction] = []
        for one in list(self.suspects.values()):
            if one.open and one.company and one.at_ns not in accused and not self.explains(one.at_ns):
                given += self._release(one.name, Ordeal.UNTRIED, "nobody was convicted of that death", now_ns)
        docket = self.docket
        if given and docket is not None and not docket.log and not any(map(self._is_open, docket.names)):
            given += self._end(now_ns)
        return given

    def _lose_patience(self, now_ns: int) -> list[TrialAction]:
        given: list[TrialAction] = []
        for one in list(self.suspects.values()):
            due_ns = self._impatient_ns(one)
            if due_ns is None or now_ns < due_ns:
                continue
            if one.company:
                given += self._release(one.name, Ordeal.UNTRIED, "there was no time to try it", now_ns)
            elif one.deaths == 0:
                self._forget(one.name)
                given.append(Acquit(one.name, run=False))
            else:
                self._put(dataclasses.replace(one, waits=False))
                if one.incident and one.incident not in self.untold:
                    self.untold = (*self.untold, one.incident)
        return given

    def _impatient_ns(self, one: Suspect) -> int | None:
        """Return when nobody waits for this suspect any longer; None: that is not a question of time."""
        if not one.open or self.served_ns is None or (one.filed and not one.company) or not one.waits:
            return None
        return max(one.at_ns, self.served_ns) + PATIENCE_NS

    def _gathered_ns(self, now_ns: int) -> int:
        """Return when those whose cases have come are tried, in any case. Whoever may still come is waited for."""
        waiting = [one for one in self.suspects.values() if one.open and one.waits]
        if all(one.filed for one in waiting):
            return now_ns
        return (
            min((one.filed_ns for one in self.suspects.values() if _ready(one)), default=now_ns) + GATHER_NS
        )

    def _due_ns(self, now_ns: int) -> int:
        return now_ns + (self.rules.begin_ms + self.rules.limit_ms) * NS_PER_MS

    # ---- the list ----

    def _is_on_trial(self, death: Death) -> bool:
        return any(one.open and one.waits and one.at_ns == death.at_ns for one in self.suspects.values())

    def _knows_log_of(self, death: Death) -> bool:
        return self.log is not None and self.log.incident == death.incident

    def _is_open(self, name: str) -> bool:
        one = self.suspects.get(name)
        return one is not None and one.open

    def _put(self, one: Suspect) -> None:
        key = one.name if one.seq is None else f"event {one.seq}"
        if self.suspects.get(key) != one:
            self.suspects[key] = one
            self.changed = True

    def _forget(self, name: str) -> None:
        del self.suspects[name]
        self.changed = True

    def _bound(self, now_ns: int) -> None:
        """Forget what is over for long enough; where there are still too many, the oldest that is over."""
        over = [key for key, one in self.suspects.items() if not one.open]
        old = [key for key in over if now_ns - self.suspects[key].closed_ns > REMEMBERED_NS]
        spare = len(self.suspects) - len(old) - SUSPECTS_MAX
        more = [key for key in (*over, *self.suspects) if key not in old][: max(0, spare)]
        for key in dict.fromkeys((*old, *more)):
            self._forget(key)


def _ready(one: Suspect) -> bool:
    return one.open and one.filed


def _accused(note: CommandNote, death: Death, old: Suspect | None) -> Suspect:
    before: tuple[str, ...] = ()
    if old is not None:
        before = tuple(dict.fromkeys((*old.before, old.incident)))[-BEFORE_MAX:]
        before = tuple(one for one in before if one not in {"", death.incident})
    on_trial = old is not None and old.open
    return Suspect(
        note.key_hash,
        death.incident,
        deaths=(old.deaths if old is not None else 0) + 1,
        command_id=note.command_id,
        kind=note.kind,
        account_ids=note.account_ids,
        transaction_id=note.transaction_id,
        source=old.source if old is not None else "",
        digest=old.digest if old is not None else "",
        filed=old.filed if on_trial and old is not None else False,
        filed_ns=old.filed_ns if old is not None else 0,
        at_ns=death.at_ns,
        blame=death.blame,
        before=before,
    )


def _is_its_own(fact: Tried) -> bool:
    """Whether what was seen was the case's doing: a core on trial may be killed, or find a disk full, like any other."""
    if fact.ordeal is not Ordeal.DIED:
        return fact.ordeal in REPRODUCED
    return fact.code == 0 or own_fault(Exit(fact.code, fact.signal)) is not None


def _reason(one: Suspect) -> Reason:
    match one.ordeal:
        case Ordeal.DIED:
            return Reason.CRASHED_CORE
        case Ordeal.HUNG:
            return Reason.DEADLOCK if one.blame is Diagnosis.DEADLOCK else Reason.HUNG_CORE
        case Ordeal.GREW:
            return Reason.MEMORY_LIMIT
        case _:
            return Reason.UNPROVEN


def _letter(one: Suspect) -> Letter:
    return Letter(
        one.letter,
        one.name,
        _reason(one),
        held=one.ordeal not in REPRODUCED,
        incidents=tuple(name for name in (*one.before, one.incident) if name),
        deaths=one.deaths,
        command_id=one.command_id,
        kind=one.kind,
        account_ids=one.account_ids,
        transaction_id=one.transaction_id,
        source=one.source,
        fingerprint=one.fingerprint,
        digest=one.digest,
        seq=one.seq,
    )
