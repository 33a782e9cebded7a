"""A figure: what was measured, in how many rounds, beside which baseline, against which target.

A median says what is usual, the extremes say how much to believe it; a ratio to something measured in the same
minutes survives a busy machine, a bare millisecond does not. So every figure carries its rounds, and whatever
can be compared is compared in the same run. A missed target is printed as missed; nothing here fails for it.
"""

import statistics
from collections.abc import Sequence
from dataclasses import dataclass

NAME_WIDTH = 44


@dataclass(frozen=True, slots=True)
class Baseline:
    """What a figure is compared with, measured in the same run and unit."""

    name: str
    rounds: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Target:
    """The most that a figure may be; `of_ratio`: its ratio to the baseline instead; `least`: it is the least."""

    most: float
    of_ratio: bool = False
    least: bool = False


@dataclass(frozen=True, slots=True)
class Figure:
    """One thing measured. `rounds` are in `unit`."""

    name: str
    unit: str
    rounds: tuple[float, ...]
    baseline: Baseline | None = None
    target: Target | None = None

    @property
    def median(self) -> float:
        """The usual value."""
        return statistics.median(self.rounds)

    @property
    def ratio(self) -> float | None:
        """Median to median of the baseline."""
        return None if self.baseline is None else self.median / statistics.median(self.baseline.rounds)

    @property
    def met(self) -> bool | None:
        """Whether the target is met; None if there is none."""
        if self.target is None:
            return None
        judged = self.ratio if self.target.of_ratio else self.median
        assert judged is not None, "a target of a ratio needs a baseline"
        return judged >= self.target.most if self.target.least else judged <= self.target.most

    def line(self) -> str:
        """Return the figure as one line for a person."""
        return f"{self.name:<{NAME_WIDTH}}{spread(self.rounds):>30} {self.unit:<6}{self._beside()}{self._judged()}"

    def _beside(self) -> str:
        if self.baseline is None:
            return ""
        return f"  {self.ratio:.2f} x {self.baseline.name} ({spread(self.baseline.rounds)})"

    def _judged(self) -> str:
        if self.target is None:
            return ""
        unit = "x" if self.target.of_ratio else self.unit
        return f"  target {short(self.target.most)} {unit}: {'met' if self.met else 'MISSED'}"

    def as_json(self) -> dict[str, object]:
        """Return the figure for a program."""
        return {
            "name": self.name,
            "unit": self.unit,
            "median": self.median,
            "rounds": list(self.rounds),
            "baseline": self.baseline and {"name": self.baseline.name, "rounds": list(self.baseline.rounds)},
            "ratio": self.ratio,
            "target": self.target and {"most": self.target.most, "of_ratio": self.target.of_ratio},
            "met": self.met,
        }


def spread(rounds: Sequence[float]) -> str:
    """Return median and extremes; of a single round, just that."""
    middle = short(statistics.median(rounds))
    return middle if len(rounds) == 1 else f"{middle} [{short(min(rounds))} - {short(max(rounds))}]"


def short(value: float) -> str:
    """Return a number with as many digits as anybody would read."""
    if value == int(value):
        return f"{int(value):,}"
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.1f}" if abs(value) >= 10 else f"{value:.2f}"
