"""The open incident: a story that is still being told.

One incident has one report, however many deaths it takes. A first moment is kept where the question is
"when did it begin" (fault, detected, alerted), the last where it is "when was it over" (spawned to serving):
with three tries the outage ends with the third.
"""

import msgspec

from hardcore.model.actions import DeathNote, Incident
from hardcore.model.observations import Exit, LedgerAudited, Proof, RequestOutcome
from hardcore.model.recorder import CommandNote, LastWords, Page, Witness
from hardcore.model.trials import TrialNote
from hardcore.model.verdicts import Diagnosis, Grade, Testimony
from hardcore.recovery import trial
from hardcore.recovery.suspicion import Growth
from hardcore.sentinel.deaths import Death

DEATHS_MAX = 64
EVIDENCE_MAX = 64
IN_FLIGHT_MAX = 1024
REQUESTS_MAX = 4096
SUSPECTS_MAX = 4096
BLAMED_MAX = 64
_FIRST = frozenset({"fault", "detected", "alerted", "frozen", "dumped", "killed"})
#: Steps of an outage: while everybody is served they mean nothing.
_OF_AN_OUTAGE = frozenset(
    {"alerted", "frozen", "killed", "spawned", "promoted", "fenced", "ready", "verified", "serving"}
)


class Trouble(msgspec.Struct):
    """What is about to be told as an incident. `asked`: a person wants done what comes of it. `drill`: it is one's."""

    death: Death
    fault_ns: int
    exit: Exit | None = None
    page: Page | None = None
    blamed: tuple[str, ...] = ()
    asked: bool = False
    drill: str | None = None


class Story(msgspec.Struct):
    """What is known so far. `life` is the core it is about.

    `down`: it is about an outage that is not over. `safe`: reads only were served in it.
    """

    id: str
    opened_ns: int
    diagnosis: Diagnosis
    grade: Grade
    life: int
    epoch: int
    planned: bool = False
    drill: str | None = None
    reason: str = ""
    evidence: list[Testimony] = msgspec.field(default_factory=list)
    exit: Exit | None = None
    last_words: LastWords | None = None
    in_flight: tuple[CommandNote, ...] = ()
    suspects: tuple[str, ...] = ()
    steps: dict[str, int] = msgspec.field(default_factory=dict)
    deaths: list[DeathNote] = msgspec.field(default_factory=list)
    requests: tuple[RequestOutcome, ...] = ()
    proof: Proof | None = None
    witness: Witness | None = None
    next_epoch: int | None = None
    audit: LedgerAudited | None = None
    blamed: tuple[str, ...] = ()
    down: bool = True
    safe: bool = False
    alerted: bool = False  # somebody was told
    withheld: bool = False  # what would have been done about it was left to a person

    def outage_ms(self) -> int | None:
        """Return for how long nobody was served; None: as far as is known, for no time."""
        over_ns = self.steps.get("serving")
        return (over_ns - self.steps["fault"]) // 1_000_000 if over_ns is not None else None

    def mark(self, name: str, at_ns: int) -> None:
        """Note a step of the timeline."""
        if (name in _FIRST and name in self.steps) or (name in _OF_AN_OUTAGE and not self.down):
            return
        self.steps[name] = at_ns

    def add_death(self, diagnosis: Diagnosis, how: Exit | None, at_ns: int) -> None:
        """Note one death, the first or a further one; what its predecessor had proven is over."""
        self.proof, self.next_epoch, self.audit = None, None, None
        if len(self.deaths) < DEATHS_MAX:
            self.deaths.append(DeathNote(at_ns, diagnosis, how))

    def falls(self, fault_ns: int, now_ns: int) -> None:
        """Note that nobody is served any more. Where somebody was until now, the outage begins with this."""
        if not self.down:
            self.steps = {"fault": fault_ns, "detected": now_ns}
        self.down = True

    def blame(self, facts: tuple[Testimony, ...], commands: tuple[str, ...]) -> None:
        """Note what a judgement rests on, and the commands that it names."""
        self.add_evidence(facts)
        self.blamed = tuple(dict.fromkeys((*self.blamed, *commands)))[:BLAMED_MAX]

    def add_evidence(self, facts: tuple[Testimony, ...]) -> None:
        """Add facts that are not there yet."""
        for fact in facts:
            if fact not in self.evidence and len(self.evidence) < EVIDENCE_MAX:
                self.evidence.append(fact)

    def add_page(self, page: Page | None, blame: Diagnosis | None, growth: Growth | None = None) -> None:
        """Take over what a recorder page says, keeping what an earlier one said of commands in flight.

        `blame` is the diagnosis of the life whose page it is, which decides whether its commands are suspects; None:
        nobody knows how it ended, so nobody is; `growth` is how that life's memory went.
        """
        if page is None:
            return
        self.last_words = self.last_words or page.last_words
        self.witness = page.witness or self.witness
        new = trial.touched(blame, page.in_flight, growth) if blame is not None else ()
        added = tuple(note.key_hash for note in new if note.key_hash not in self.suspects)
        self.suspects = (self.suspects + added)[:SUSPECTS_MAX]
        seen = {note.command_id for note in self.in_flight}
        new_notes = tuple(note for note in page.in_flight if note.command_id not in seen)
        self.in_flight = (self.in_flight + new_notes)[:IN_FLIGHT_MAX]

    def add_requests(self, settled: tuple[RequestOutcome, ...]) -> None:
        """Note what became of requests that met the outage; the first ones where there are too many."""
        self.requests = (self.requests + settled)[:REQUESTS_MAX]

    def told(
        self,
        outcome: str,
        now_ns: int,
        waits_for: Diagnosis | None = None,
        trials: tuple[TrialNote, ...] = (),
    ) -> Incident:
        """Return the whole story as facts. `waits_for`: why another try makes no sense, if none does."""
        self.mark("closed", now_ns)
        return self._as_facts(outcome, waits_for, now_ns, trials)

    def so_far(self, trials: tuple[TrialNote, ...] = ()) -> Incident:
        """Return what is known of it while it goes on."""
        return self._as_facts("open", None, 0, trials)

    def _as_facts(
        self, outcome: str, waits_for: Diagnosis | None, closed_ns: int, trials: tuple[TrialNote, ...]
    ) -> Incident:
        return Incident(
            id=self.id,
            opened_ns=self.opened_ns,
            diagnosis=self.diagnosis,
            grade=self.grade,
            evidence=tuple(self.evidence),
            planned=self.planned,
            drill=self.drill,
            reason=self.reason,
            life=self.life,
            epoch=self.epoch,
            exit=self.exit,
            last_words=self.last_words,
            in_flight=self.in_flight,
            suspects=self.suspects,
            timeline=tuple(sorted(self.steps.items(), key=lambda item: item[1])),
            deaths=tuple(self.deaths),
            requests=self.requests,
            proof=self.proof,
            witness=self.witness,
            next_epoch=self.next_epoch,
            audit=self.audit,
            outcome=outcome,
            waits_for=waits_for,
            closed_ns=closed_ns,
            blamed=self.blamed,
            trials=trials,
        )


def begin(
    known: str,
    old: Story | None,
    trouble: Trouble,
    life: int,
    epoch: int,
    now_ns: int,
    *,
    planned: bool,
    down: bool = True,
) -> Story:
    """Begin the story of a trouble under the id `known`. `down`: nobody is served because of it.

    `old` is an incident that the operator had opened and that a death has overtaken: it becomes the death's. Or it is
    that of a switch that could not be done and is tried again: people were served in between.
    """
    story = Story(
        id=known,
        opened_ns=old.opened_ns if old else now_ns,
        diagnosis=trouble.death.diagnosis,
        grade=trouble.death.grade,
        life=life,
        epoch=epoch,
        planned=planned,
        reason=old.reason if old else (trouble.death.evidence[0].why if planned else ""),
        evidence=old.evidence if old else [],
        in_flight=old.in_flight if old else (),
        suspects=old.suspects if old else (),
        requests=old.requests if old else (),
        down=down,
    )
    story.mark("fault", old.steps["fault"] if old and old.down else trouble.fault_ns)
    story.mark("detected", now_ns)
    return story
