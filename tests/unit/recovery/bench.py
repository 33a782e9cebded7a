"""A court to be tried out: a core serves, and a clock is moved by hand."""

from collections.abc import Iterator
from itertools import count

from hardcore.model import trials
from hardcore.model.recorder import CommandNote, SlotStage
from hardcore.model.trials import Acquit, Ordeal, SetAside
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.court import (
    COPY_NS,
    Court,
    Rules,
)
from hardcore.recovery.register import Death

S = 1_000_000_000
RULES = Rules(15_000, 1 << 29, 20_000, trial_limit=64, max_convictions=2, source_stop_ns=600 * S)
SEGV = 11
KILL = 9


def _note(name: str, stage: SlotStage = SlotStage.DECIDING) -> CommandNote:
    return CommandNote(stage, f"c-{name}", name, "transaction.post", "t1", ("assets:cash",), 1)


class Bench:
    """A court with a core that serves, and a clock that is moved by hand."""

    def __init__(self, rules: Rules = RULES) -> None:
        self.court = Court(rules, served_ns=100 * S)
        self.now_ns = 100 * S
        self.ids: Iterator[int] = count(1)

    def new_id(self) -> str:
        return f"l{next(self.ids)}"

    def accuse(
        self, *names: str, company: tuple[str, ...] = (), blame: Diagnosis = Diagnosis.CRASHED
    ) -> None:
        """A core died with these at work."""
        self.now_ns += S
        death = Death(self.now_ns, f"i{self.now_ns // S}", blame)
        queued = [_note(name, SlotStage.QUEUED) for name in company]
        self.court.register.accuse(death, [_note(name) for name in names], queued)
        self.court.served_ns = self.now_ns

    def file(self, *names: str, source: str = "browser:1") -> list[trials.TrialAction]:
        given: list[trials.TrialAction] = []
        for name in names:
            given += self.court.filed(name, source, f"d-{name}", self.now_ns)
        return given + self.sit()

    def sit(self, wait_ns: int = 0) -> list[trials.TrialAction]:
        self.now_ns += wait_ns
        return self.court.convene(self.now_ns, self.new_id)

    def tried(
        self,
        name: str,
        ordeal: Ordeal,
        signal: int | None = None,
        code: int | None = None,
        seq: int | None = None,
    ) -> list[trials.TrialAction]:
        fact = trials.Tried(self.now_ns, name, ordeal, 7, fingerprint="f", signal=signal, code=code, seq=seq)
        return self.court.tried(fact, self.new_id) + self.sit()

    def over(self, fault: str = "") -> list[trials.TrialAction]:
        return self.court.over(fault, self.now_ns, self.new_id) + self.sit()

    def on_trial(self, *names: str) -> "Bench":
        self.accuse(*names)
        self.file(*names)
        return self


ONE_TRIAL = Rules(15_000, 1, 20_000, trial_limit=1, max_convictions=9, source_stop_ns=S)


def fail(bench: Bench, how: str) -> list[trials.TrialAction]:
    """Have a court go wrong that is no suspect's fault."""
    assert bench.court.docket is not None, "it sits"
    names = bench.court.docket.names
    match how:
        case "untried":
            given = [one for name in names for one in bench.tried(name, Ordeal.UNTRIED)]
        case "killed":
            given = [one for name in names for one in bench.tried(name, Ordeal.DIED, signal=KILL)]
        case "silent":
            given = bench.sit(COPY_NS + 36 * S)
            how = "it was ended"
        case _:
            given = []
    return given + bench.over(how)


def letter_of(given: list[trials.TrialAction]) -> trials.Letter:
    return next(one.letter for one in given if isinstance(one, SetAside))


def acquitted(given: list[trials.TrialAction]) -> list[str]:
    return [one.name for one in given if isinstance(one, Acquit) and one.run]
