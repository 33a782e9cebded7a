"""The court: who is on trial, and what comes of it, as one pure value.

A death convicts nobody. It makes suspects; each is tried once in a throw-away core, and only doing it again there
makes it a poison. Everything unclear (a trial that could not be held, one that somebody ended from outside, a first slowness)
is tried once more; then it is run, because what we can't do is no suspect's fault, and only what was at work in two deaths
that nothing explains is left to a person, never called poison. Not chosen: strikes,
counted by command (they convicted 79 innocents in 150 deaths), and trials in the core that serves (a poison would cost
it two deaths).

The court receives facts and gives orders. It knows nothing of phases, budgets and incidents but their ids
(`hearing.py` joins them); one court sits at a time, on a copy, so no death of a core ends it. Whoever waits for a
trial waits as long as a gateway holds a request and no longer; the trial goes on without them.
"""

from collections.abc import Callable, Iterable

import msgspec
from msgspec import structs

from hardcore.model.trials import (
    REPRODUCED,
    Acquit,
    AddTrials,
    Conviction,
    CourtMemory,
    EndTrials,
    KeepCourt,
    Ordeal,
    SetAside,
    StopSource,
    Suspect,
    TrialAction,
    Tried,
    Try,
    TryLog,
)
from hardcore.recovery.budget import NS_PER_MS, NS_PER_S
from hardcore.recovery.letters import is_its_own, letter
from hardcore.recovery.register import BEFORE_MAX, REMEMBERED_NS, Death, Register, event_key

#: Cases of one death come within milliseconds of each other: they are waited for, so that they share one court.
GATHER_NS = 100 * NS_PER_MS
#: As long as a gateway holds a request. Then company goes, and nobody's account waits for a case that does not come.
PATIENCE_NS = 10 * NS_PER_S
#: The copy of a large ledger on a slow disk: whoever holds the court gives it up after this (`sitting.COPY_S`). To read
#: the copy's log takes no longer, and not a word is said meanwhile; whoever waited for more would keep a service down.
COPY_NS = 180 * NS_PER_S
#: A court that was told to end is taken for gone after this, whatever its process does.
ENDING_NS = 5 * NS_PER_S
#: A trial that says nothing is held once more.
TRIES_MAX = 2
#: From so many deaths on that nothing explains, a suspect that does no harm on trial is left to a person.
HELD_DEATHS = 2
#: Cases in one docket (docs/wires.md section 12).
DOCKET_MAX = 256
CONVICTIONS_MAX = 1024
CONVICTIONS_WINDOW_NS = 60 * NS_PER_S
#: The kind of a drill's command: what it does counts on nobody's budget.
DRILL_KIND = "drill"
#: So a source begins that is an address, of requests without a browser's cookie.
ADDRESS = "peer:"

Orders = list[TrialAction]


class Rules(msgspec.Struct, frozen=True):
    """The numbers of the policy that the court goes by. `begin_ms`: time to start a core for a case.

    `trial_limit`: how many who were at work in one death are tried, and how many of their company.
    """

    limit_ms: int
    memory_bytes: int
    begin_ms: int
    trial_limit: int
    max_convictions: int
    source_stop_ns: int


class Docket(msgspec.Struct, frozen=True):
    """What is on trial. `names`: who has yet to be tried. `log`: it is the events."""

    names: tuple[str, ...]
    due_ns: int
    log: bool = False
    ending: bool = False


class Court(msgspec.Struct):
    """See the module. Times are monotonic; `new_id` gives numbers of letters."""

    rules: Rules
    register: Register = msgspec.field(default_factory=Register)
    convictions: tuple[Conviction, ...] = ()
    docket: Docket | None = None
    log: Death | None = None  # the death for which the log was or is to be tried last
    log_after: int | None = None  # it has yet to be tried, from here on
    doubt: Death | None = None  # if no trial explains this one, the log is tried for it
    acquitted_ns: int | None = None  # when somebody was last told to run
    served_ns: int | None = None  # since when a core serves; None: none does

    # ---- what it is told ----

    def inherit(self, memory: CourtMemory, names: Iterable[str], now_ns: int) -> None:
        """Go on where an earlier guard's court was: what was on trial is tried again."""
        self.register.inherit(memory, names, now_ns)
        # Of another boot nobody knows how long ago it was.
        self.convictions = tuple(c for c in memory.convictions if c.at_ns <= now_ns)[-CONVICTIONS_MAX:]

    def clear(self, now_ns: int) -> Orders:
        """A core died though no suspect was at work in it: it was none of them. Whoever is open is run."""
        given: Orders = []
        for one in self.register:
            if not one.letter:
                calm = structs.replace(one, deaths=0)
                self.register.put(calm)
                if one.open:
                    given += self._acquit(calm, Ordeal.UNTRIED, "a core died without it", now_ns)
        return given

    def suspect_log(self, death: Death, after_seq: int, now_ns: int) -> Orders:
        """Have the events after `after_seq` tried for this death, before anybody else and at once."""
        self.log, self.log_after = death, after_seq
        return self._end(now_ns) if self.docket is not None and not self.docket.log else []

    def filed(self, name: str, source: str, digest: str, now_ns: int) -> Orders:
        """The request of `name` is on the disk, and whoever sent it waits."""
        one = self.register.by_key.get(name)
        if one is None or not (one.open or one.letter):
            return [Acquit(name, run=True)]  # nobody suspects it, or does not any more
        if not one.open:
            return [SetAside(letter(one), again=True)]
        filed_ns = one.filed_ns if one.filed else now_ns
        self.register.put(
            structs.replace(one, filed=True, source=source, digest=digest, filed_ns=filed_ns, waits=True)
        )
        return []

    def at_work(self, now_ns: int) -> None:
        """The court has said how far it is: from now on it has the time of one case more."""
        if self.docket is not None and not self.docket.ending:
            due_ns = self._due_ns(now_ns, silent=self.docket.log)
            self.docket = structs.replace(self.docket, due_ns=due_ns)

    def tried(self, fact: Tried, new_id: Callable[[], str]) -> Orders:
        """One case was tried."""
        if self.docket is not None:
            names = tuple(name for name in self.docket.names if name != fact.name)
            self.docket = structs.replace(self.docket, names=names)
            self.at_work(fact.at_ns)
        if self.docket is not None and self.docket.log:
            return self._tried_log(fact, new_id)
        one = self.register.by_key.get(fact.name)
        if one is None or not one.open:
            return []
        one = structs.replace(
            one,
            took_ms=fact.took_ms,
            why=fact.why,
            fingerprint=fact.fingerprint or one.fingerprint,
            kind=fact.kind or one.kind,
            account_ids=fact.account_ids or one.account_ids,
            transaction_id=one.transaction_id or fact.transaction_id,
        )
        self.register.put(one)
        return self._rule(one, fact, new_id)

    def over(self, fault: str, now_ns: int, new_id: Callable[[], str]) -> Orders:
        """The court's process is gone; `fault`: why it could not do its work."""
        docket, self.docket = self.docket, None
        if docket is None:
            return []
        if docket.log and (fault or docket.ending):
            self.log = None  # it was not tried: the next such death may have it tried
        given: Orders = []
        for one in [] if docket.ending else self._open(docket.names):
            given += self._unclear(one, fault or "its trial was not held", now_ns, new_id)
        return given

    # ---- what it orders by itself ----

    def convene(self, now_ns: int, new_id: Callable[[], str]) -> Orders:
        """Do what the time has come for, and begin the next court if there is one to be held."""
        if self._is_idle:
            return []
        given = self._lose_patience(now_ns)
        if self.docket is not None and now_ns >= self.docket.due_ns:
            if self.docket.ending:
                given += self.over("it did not end", now_ns, new_id)
            else:
                given += self._time_is_over(now_ns, new_id)
        given += self._judge_survivors(now_ns, new_id)
        given += self._dismiss_company(now_ns)
        self._doubt_log()
        if self.docket is None and self.log_after is not None:
            after, self.log_after = self.log_after, None
            self.docket = Docket((), self._due_ns(now_ns, silent=True), log=True)
            given.append(TryLog(after, self.rules.limit_ms, self.rules.memory_bytes))
        elif self.docket is None and self.served_ns is not None and now_ns >= self._gathered_ns(now_ns):
            judged = self._try(now_ns, new_id)
            given += judged
            if judged and self.docket is None:  # nobody is left to be tried: that may decide about who was
                given += self.convene(now_ns, new_id)
        return given

    def next_ns(self) -> int | None:
        """Return when `convene` wants to be called, or None while nothing waits for its time."""
        if self._is_idle:
            return None
        due = [] if self.docket is None else [self.docket.due_ns]
        if self.docket is None and self.served_ns is not None and any(map(_ready, self.register)):
            due.append(self._gathered_ns(self.served_ns))
        due += [at_ns for one in self.register if (at_ns := self._impatient_ns(one)) is not None]
        return min(due, default=None)

    def kept(self) -> Orders:
        """Return what has to be written down and told since the last time."""
        given: Orders = []
        told = self.register.told()
        if self.register.changed:
            self.register.changed = False
            known = tuple(self.register)
            memory = CourtMemory(known, self.register.settled_seq, self.convictions)
            given.append(KeepCourt(self.register.suspected(), memory))
        given += (AddTrials(incident, self.register.notes(incident)) for incident in told)
        return given

    @property
    def tries_log(self) -> bool:
        """Whether the log is on trial, or about to be."""
        return self.log_after is not None or (self.docket is not None and self.docket.log)

    @property
    def _is_idle(self) -> bool:
        waits = self.register.open_count or self.docket is not None
        return not waits and self.log_after is None and self.doubt is None

    # ---- judgements ----

    def _rule(self, one: Suspect, fact: Tried, new_id: Callable[[], str]) -> Orders:
        if fact.ordeal is Ordeal.COMMITTED:
            # Run: a core that has its key answers what it answered then.
            return self._acquit(one, Ordeal.COMMITTED, fact.why, fact.at_ns)
        if fact.ordeal is Ordeal.SURVIVED:
            return self._survived(one, fact.at_ns)
        if not is_its_own(fact):
            return self._unclear(one, fact.why or "its trial was ended from outside", fact.at_ns, new_id)
        if fact.ordeal is Ordeal.HUNG and not one.hung:
            slow = structs.replace(one, hung=True)  # not guilty of that: once more, in another core
            return self._unclear(slow, "its trial took too long", fact.at_ns, new_id)
        return self._convict(one, fact.ordeal, fact.at_ns, new_id)

    def _survived(self, one: Suspect, now_ns: int) -> Orders:
        """Run it, unless it was at work in too many deaths: then it waits for who else may explain the last one."""
        if one.company or one.deaths < HELD_DEATHS:
            return self._acquit(one, Ordeal.SURVIVED, one.why, now_ns)
        self.register.put(structs.replace(one, survived=True))
        return []

    def _judge_survivors(self, now_ns: int, new_id: Callable[[], str]) -> Orders:
        given: Orders = []
        for one in self.register:
            if not (one.open and one.survived):
                continue
            if one.deaths < HELD_DEATHS:
                given += self._acquit(one, Ordeal.SURVIVED, one.why, now_ns)
            elif not any(_may_explain(other, one) for other in self.register):
                given += self._hold(one, Ordeal.SURVIVED, one.why, now_ns, new_id)
        return given

    def _unclear(self, one: Suspect, why: str, now_ns: int, new_id: Callable[[], str]) -> Orders:
        if one.company:
            return self._acquit(one, Ordeal.UNTRIED, why, now_ns)
        one = structs.replace(one, tries=one.tries + 1, why=why)
        self.register.put(one)
        return [] if one.tries < TRIES_MAX else self._untried(one, why, now_ns, new_id)

    def _untried(self, one: Suspect, why: str, now_ns: int, new_id: Callable[[], str]) -> Orders:
        """Nobody will try it any more. That is not its fault: it is run, but after a second death that nothing explains."""
        if one.company or one.deaths < HELD_DEATHS or self.register.explains(one.at_ns):
            return self._acquit(one, Ordeal.UNTRIED, why, now_ns)
        return self._hold(one, Ordeal.UNTRIED, why, now_ns, new_id)

    def _convict(self, one: Suspect, ordeal: Ordeal, now_ns: int, new_id: Callable[[], str]) -> Orders:
        self.register.explain(one)
        closed = self.register.close(
            structs.replace(one, letter=one.letter or new_id()), ordeal, one.why, now_ns
        )
        return [SetAside(letter(closed)), *self._count(closed, now_ns)]

    def _hold(self, one: Suspect, ordeal: Ordeal, why: str, now_ns: int, new_id: Callable[[], str]) -> Orders:
        held = self.register.close(structs.replace(one, letter=new_id()), ordeal, why, now_ns)
        return [SetAside(letter(held))]

    def _acquit(self, one: Suspect, ordeal: Ordeal, why: str, now_ns: int) -> Orders:
        self.register.close(one, ordeal, why, now_ns)
        self.acquitted_ns = now_ns
        return [Acquit(one.name, run=True)]

    def _count(self, one: Suspect, now_ns: int) -> Orders:
        """Count a conviction; stop its source if there were too many.

        An address is nobody: many may share it, and no gateway stops one. So it is not said to be stopped either.
        """
        nobody = not one.source or one.source.startswith(ADDRESS)
        if nobody or one.kind == DRILL_KIND:
            return []
        since_ns = now_ns - CONVICTIONS_WINDOW_NS
        fresh = (*(c for c in self.convictions if c.at_ns > since_ns), Conviction(one.source, now_ns))
        if sum(c.source == one.source for c in fresh) <= self.rules.max_convictions:
            self.convictions = fresh[-CONVICTIONS_MAX:]
            return []
        self.convictions = tuple(c for c in fresh if c.source != one.source)
        return [StopSource(one.source, self.rules.source_stop_ns)]

    def _tried_log(self, fact: Tried, new_id: Callable[[], str]) -> Orders:
        death = self.log
        if fact.ordeal is Ordeal.UNTRIED or (fact.ordeal is Ordeal.DIED and not is_its_own(fact)):
            self.log = None  # it was not tried, as in `over`
        if death is None or fact.seq is None or not is_its_own(fact):
            return []
        # What was set aside is found again if its rule is not in force: never written, or lost. It has one letter.
        known = self.register.by_key.get(event_key(fact.seq))
        found = Suspect(
            fact.name,
            death.incident,
            deaths=known.deaths + 1 if known else 1,
            letter=known.letter if known else "",
            before=(*known.before, known.incident)[-BEFORE_MAX:] if known else (),
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
        self.log = None  # the next death may be another event's
        return self._convict(found, fact.ordeal, fact.at_ns, new_id)

    # ---- sittings ----

    def _try(self, now_ns: int, new_id: Callable[[], str]) -> Orders:
        names: list[str] = []
        left: list[Suspect] = []
        taken: dict[tuple[int, bool], int] = {}
        for one in sorted(filter(_ready, self.register), key=lambda one: (one.company, one.cleared)):
            place = (one.at_ns, one.company)
            taken[place] = taken.get(place, self._tried_in(place)) + (one.tries == 0)
            if taken[place] <= self.rules.trial_limit:
                names.append(one.name)
            else:
                left.append(one)
        if names:
            self.docket = Docket(tuple(names[:DOCKET_MAX]), self._due_ns(now_ns, silent=True))
            return [Try(self.docket.names, self.rules.limit_ms, self.rules.memory_bytes)]
        given: Orders = []
        for one in left:
            given += self._untried(one, "more were suspected than are tried of one death", now_ns, new_id)
        return given

    def _tried_in(self, place: tuple[int, bool]) -> int:
        return sum(
            (one.at_ns, one.company) == place and (not one.open or one.survived or one.tries > 0)
            for one in self.register
        )

    def _doubt_log(self) -> None:
        """Have the log tried for a death that no trial has explained, once the court is free."""
        death = self.doubt
        if death is None or any(one.open and one.waits and one.at_ns == death.at_ns for one in self.register):
            return
        self.doubt = None
        known = self.log is not None and self.log.incident == death.incident
        if not (known or self.register.explains(death.at_ns)):
            self.log, self.log_after = death, self.register.settled_seq

    def _time_is_over(self, now_ns: int, new_id: Callable[[], str]) -> Orders:
        """The court has been silent for longer than a case may take: what it had not tried counts as not tried."""
        assert self.docket is not None, "only a court that sits is late"
        given = self._end(now_ns)
        for one in self._open(self.docket.names):
            given += self._unclear(one, "the court did not answer", now_ns, new_id)
        return given

    def _end(self, now_ns: int) -> Orders:
        if self.docket is None or self.docket.ending:
            return []
        self.docket = structs.replace(self.docket, ending=True, due_ns=now_ns + ENDING_NS)
        return [EndTrials()]

    def _dismiss_company(self, now_ns: int) -> Orders:
        """Let company go whose suspects turned out to be harmless, and end a court that has nobody else left."""
        waits_for = {one.at_ns for one in self.register if one.open and not one.company}
        waits_for |= {one.at_ns for one in self.register if one.ordeal in REPRODUCED}
        given: Orders = []
        for one in self.register:
            if one.open and one.company and one.at_ns not in waits_for:
                given += self._acquit(one, Ordeal.UNTRIED, "nobody was convicted of that death", now_ns)
        docket = self.docket
        if given and docket is not None and not docket.log and not self._open(docket.names):
            given += self._end(now_ns)
        return given

    def _lose_patience(self, now_ns: int) -> Orders:
        given: Orders = []
        for one in self.register:
            due_ns = self._impatient_ns(one)
            if due_ns is None or now_ns < due_ns:
                continue
            if one.company:
                given += self._acquit(one, Ordeal.UNTRIED, "there was no time to try it", now_ns)
            elif one.deaths == 0 or not one.waits:
                self.register.settle((one.name,))
                given.append(Acquit(one.name, run=False))
            else:
                self.register.put(structs.replace(one, waits=False))
                self.register.part(one)
        return given

    def _impatient_ns(self, one: Suspect) -> int | None:
        """Return when nobody waits for this suspect any longer, or when whoever has not come in a day is forgotten.

        None: that is not a question of time.
        """
        if not one.open or self.served_ns is None or (one.filed and not one.company):
            return None
        if not one.waits:
            return one.at_ns + REMEMBERED_NS
        return max(one.at_ns, self.served_ns) + PATIENCE_NS

    def _gathered_ns(self, now_ns: int) -> int:
        """Return when those whose cases have come are tried, in any case. Whoever may still come is waited for."""
        if all(one.filed for one in self.register if one.open and one.waits):
            return now_ns
        return min((one.filed_ns for one in self.register if _ready(one)), default=now_ns) + GATHER_NS

    def _due_ns(self, now_ns: int, *, silent: bool = False) -> int:
        """Return when a court has been silent for too long; `silent`: it copies the ledger, or reads all of it."""
        each_ns = (self.rules.begin_ms + self.rules.limit_ms) * NS_PER_MS
        return now_ns + each_ns + (COPY_NS if silent else 0)

    def _open(self, names: Iterable[str]) -> list[Suspect]:
        known = (self.register.by_key.get(name) for name in names)
        return [one for one in known if one is not None and one.open]


def _ready(one: Suspect) -> bool:
    return one.open and one.filed and not one.survived


def _may_explain(other: Suspect, one: Suspect) -> bool:
    """Whether `other` has yet to be tried for the death that is held against `one`."""
    comes = other.filed or (other.waits and not other.company)
    return other.open and comes and not other.survived and other.at_ns == one.at_ns
