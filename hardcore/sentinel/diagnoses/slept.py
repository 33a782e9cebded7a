"""SLEPT: the machine was suspended. Everybody has fresh deadlines, and it is told once."""

from hardcore.model.verdicts import Diagnosis, Verdict
from hardcore.sentinel.look import Look, yellow
from hardcore.sentinel.patience import Patience


def judge(look: Look, _: Patience) -> Verdict | None:
    """Return SLEPT, yellow, at the first look after it; or None."""
    if not look.clocks.slept_ns:
        return None
    return yellow(Diagnosis.SLEPT, f"the machine slept for {look.clocks.slept_ns / 1e9:.1f} s")
