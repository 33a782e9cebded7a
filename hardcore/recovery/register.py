"""The list of suspects: who was at work in which death, and what has become of each.

It is what a successor of this guard has to know, and it is bounded: what is over is forgotten after a day, and the
oldest first where there are too many. A death that is explained by a conviction is taken off whoever else was at work
in it, so no innocent gathers deaths in bad company. An event of the log stands in it like a request.
"""

from collections.abc import Iterable, Iterator

import msgspec
from msgspec import structs

from hardcore.model.recorder import CommandNote
from hardcore.model.trials import REPRODUCED, CourtMemory, Ordeal, Suspect, SuspectNote, TrialNote
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.budget import NS_PER_S

SUSPECTS_MAX = 4096
#: What became of a suspect is remembered so long: its next death is then its second.
REMEMBERED_NS = 86_400 * NS_PER_S
#: Incidents that a letter names.
BEFORE_MAX = 16


class Death(msgspec.Struct, frozen=True):
    """A death as the court knows it. Several pages may tell of one; they are one death all the same."""

    at_ns: int
    incident: str
    blame: Diagnosis


def event_key(seq: int) -> str:
    """Return under which key an event of the log stands in the list."""
    return f"event {seq}"


class Register(msgspec.Struct):
    """See the module. `by_key`: suspects by name, in the order in which they came. Times are monotonic."""

    by_key: dict[str, Suspect] = msgspec.field(default_factory=dict)
    settled_seq: int = 0
    changed: bool = False
    open_count: int = 0  # at most times nobody is suspect, and a tick has better things to do than to look
    untold: tuple[str, ...] = ()  # incidents that have yet to be told what came of their trials

    def __iter__(self) -> Iterator[Suspect]:
        """All of them, as they stand now."""
        return iter(tuple(self.by_key.values()))

    def inherit(self, memory: CourtMemory, names: Iterable[str], now_ns: int) -> None:
        """Go on with an earlier guard's list; `names`: whom it may not have had the time to write down.

        Stamps of another boot lie in the future at worst: then the last of them counts as fresh, and what lay between
        them stays, because one moment is one death. Nobody knows what those names did; they are tried before they are
        run, and no death counts against them.
        """
        self.by_key, self.open_count = {}, 0
        kept = memory.suspects[-SUSPECTS_MAX:]
        ahead_ns = max((at_ns - now_ns for one in kept for at_ns in _stamps(one)), default=0)
        for one in kept:
            self.put(structs.replace(_earlier(one, max(0, ahead_ns)), waits=True))
        self.settled_seq, self.changed = memory.settled_seq, True
        for name in names:
            old = self.by_key.get(name, Suspect(name, "", deaths=0, ordeal=Ordeal.UNTRIED))
            if not (old.open or old.letter):  # it may have been cleared, and have been run again since
                again = structs.replace(old, ordeal=None, filed=False, waits=True, company=False)
                self.put(structs.replace(again, at_ns=now_ns, tries=0, hung=False))
        self._bound(now_ns)

    def accuse(self, death: Death, touched: Iterable[CommandNote], company: Iterable[CommandNote]) -> None:
        """Take in who was at work in a death from inside, and who stood behind them."""
        for note in touched:
            old = self.by_key.get(note.key_hash)
            if old is None or old.company or old.at_ns != death.at_ns:
                self.put(_accused(note, death, old))
        for note in company:
            old = self.by_key.get(note.key_hash)
            if old is None or not (old.open or old.letter):
                deaths = old.deaths if old is not None else 0
                again = _accused(note, death, old)
                self.put(structs.replace(again, deaths=deaths, company=True))
        self._bound(death.at_ns)

    def put(self, one: Suspect) -> None:
        """Let this be what is known of it from now on."""
        key = one.name if one.seq is None else event_key(one.seq)
        old = self.by_key.get(key)
        if old != one:
            self.open_count += one.open - (old is not None and old.open)
            self.by_key[key] = one
            self.changed = True

    def close(self, one: Suspect, ordeal: Ordeal, why: str, now_ns: int) -> Suspect:
        """Note what becomes of it, in the end; return what is remembered of it."""
        closed = structs.replace(one, ordeal=ordeal, why=why, closed_ns=now_ns)
        self.put(closed)
        self.part(one)
        return closed

    def part(self, one: Suspect) -> None:
        """Its incident waits for it no longer."""
        if one.incident and one.incident not in self.untold:
            self.untold = (*self.untold, one.incident)

    def settle(self, names: Iterable[str]) -> None:
        """Forget these: the ledger has them, or nobody suspects them any more."""
        for name in names:
            one = self.by_key.get(name)
            if one is not None and not one.letter:
                self._forget(name)

    def release(self, rule: str) -> None:
        """A person took the rule of this letter away: what it named begins anew."""
        for key, one in tuple(self.by_key.items()):
            if one.letter == rule:
                self._forget(key)

    def explain(self, culprit: Suspect) -> None:
        """It is convicted: take its death off everybody else who was at work in it."""
        if not self.explains(culprit.at_ns):
            for one in self:
                if one.at_ns == culprit.at_ns and one.deaths and one.name != culprit.name and not one.letter:
                    self.put(structs.replace(one, deaths=one.deaths - 1))

    def explains(self, at_ns: int) -> bool:
        """Whether somebody was convicted of the death of that moment."""
        return any(one.at_ns == at_ns and one.ordeal in REPRODUCED for one in self)

    def told(self) -> tuple[str, ...]:
        """Return the incidents that can be told what came of all their trials, once each."""
        if not self.untold:
            return ()
        waiting = {one.incident for one in self if one.open and one.waits}
        told = tuple(name for name in self.untold if name not in waiting)
        self.untold = tuple(name for name in self.untold if name in waiting)
        return told

    def notes(self, incident: str) -> tuple[TrialNote, ...]:
        """Return what came of the trials of an incident so far."""
        return tuple(
            TrialNote(
                one.name,
                one.command_id,
                one.ordeal,
                one.letter,
                one.took_ms,
                one.why,
                fingerprint=one.fingerprint,
                kind=one.kind,
                account_ids=one.account_ids,
                transaction_id=one.transaction_id,
            )
            for one in self
            if one.incident == incident and one.ordeal is not None
        )

    def suspected(self) -> tuple[SuspectNote, ...]:
        """Return who must not be run before its trial, and which accounts wait for that."""
        return tuple(SuspectNote(one.name, one.account_ids if one.waits else ()) for one in self if one.open)

    def _forget(self, key: str) -> None:
        self.open_count -= self.by_key.pop(key).open
        self.changed = True

    def _bound(self, now_ns: int) -> None:
        """Forget what is over for long enough; where there are still too many, the oldest of those that matter least."""
        for key, one in tuple(self.by_key.items()):
            if not one.open and now_ns - one.closed_ns > REMEMBERED_NS:
                self._forget(key)
        too_many = len(self.by_key) - SUSPECTS_MAX
        if too_many > 0:
            for key in sorted(self.by_key, key=lambda key: _matters(self.by_key[key]))[:too_many]:
                self._forget(key)


def _matters(one: Suspect) -> int:
    """Return how much would be lost if it were forgotten: of a letter, that its request is refused at once."""
    if one.open:
        return 1 if not (one.filed or one.waits) else 3
    return 2 if one.letter else 0


def _stamps(one: Suspect) -> tuple[int, ...]:
    return (one.at_ns, one.filed_ns, one.closed_ns)


def _earlier(one: Suspect, by_ns: int) -> Suspect:
    at_ns, filed_ns, closed_ns = (stamp - by_ns for stamp in _stamps(one))
    return structs.replace(one, at_ns=at_ns, filed_ns=filed_ns, closed_ns=closed_ns)


def _accused(note: CommandNote, death: Death, old: Suspect | None) -> Suspect:
    """Return a suspect of this death. One that is accused on trial goes on being tried."""
    if old is None:
        old = Suspect(note.key_hash, "", deaths=0)
    before = tuple(dict.fromkeys((*old.before, old.incident)))
    return Suspect(
        note.key_hash,
        death.incident,
        deaths=old.deaths + 1,
        command_id=note.command_id,
        kind=note.kind,
        account_ids=note.account_ids,
        transaction_id=note.transaction_id,
        source=old.source,
        digest=old.digest,
        filed=old.filed and old.open,
        filed_ns=old.filed_ns,
        at_ns=death.at_ns,
        blame=death.blame,
        cleared=old.cleared or old.ordeal is Ordeal.SURVIVED,
        before=tuple(name for name in before if name not in {"", death.incident})[-BEFORE_MAX:],
    )
