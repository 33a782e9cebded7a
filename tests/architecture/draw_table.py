"""Draws `docs/transitions.md` from the table, so that the manual can't fall behind it.

`python -m tests.architecture.draw_table` writes it anew; a test holds the file against this text.
"""

from pathlib import Path

from hardcore.model.phases import Phase, Wanted, face, stage
from hardcore.recovery.plan import limit_ns
from hardcore.recovery.policy import Policy
from hardcore.recovery.transitions import ON_ENTRY, TABLE, Step, Trigger

PAGE = Path(__file__).parents[2] / "docs" / "transitions.md"

_HEAD = """# The table of transitions

Where the guarded process is, and every way from one phase to the next. Everything that changes the phase stands
in `hardcore/recovery/transitions.py`, whose prose says why it is as it is; this page is drawn from it
(`python -m tests.architecture.draw_table`). A trigger that a phase does not list changes nothing there.

```mermaid
stateDiagram-v2
    [*] --> STOPPED
"""

_PHASES = """```

## Phases

A phase lasts at most so long, with the shipped policy; what the gateway does with a request and which stage of
the recovery people are shown are readings of it.

| Phase | At most | Requests | Stage | Asked on entering it, in this order |
|---|---|---|---|---|
"""

_ROWS = """
## Rows

| In | On | To | Done on the way |
|---|---|---|---|
"""

#: How long a phase may last, where the shipped policy's number is not the whole answer.
_LENGTHS = {
    Phase.BACKOFF: "its pause: doubling with each core that proved nothing, else `restart_delay_ms`",
    Phase.PROBATION: "`probation_ms`, and then until the core is well or lost",
    Phase.FATAL: "`slow_retry_sec`, if the budget was spent; else until the operator speaks",
}


def draw() -> str:
    """Return the text of the page."""
    arrows: dict[tuple[Phase, Phase], list[Trigger]] = {}
    for before, listed in TABLE.items():
        for trigger, (after, _) in listed.items():
            arrows.setdefault((before, after), []).append(trigger)
    drawn = [f"    {a} --> {b}: {', '.join(triggers)}" for (a, b), triggers in arrows.items()]
    phases = [_phase(phase) for phase in Phase]
    rows = [_row(before, t, *row) for before, listed in TABLE.items() for t, row in listed.items()]
    return (
        _HEAD + "\n".join(drawn) + "\n" + _PHASES + "\n".join(phases) + "\n" + _ROWS + "\n".join(rows) + "\n"
    )


def _phase(phase: Phase) -> str:
    limit = limit_ns(Policy(), phase, 0, None)
    length = _LENGTHS.get(phase) or (f"{limit // 1_000_000} ms" if limit else "")
    asked = ", ".join(ON_ENTRY.get(phase, ()))
    return f"| {phase} | {length} | {face(phase, Wanted.UP)} | {stage(phase) or ''} | {asked} |"


def _row(before: Phase, trigger: Trigger, after: Phase, steps: tuple[Step, ...]) -> str:
    return f"| {before} | {trigger} | {after} | {', '.join(steps)} |"


if __name__ == "__main__":
    PAGE.write_text(draw(), encoding="utf-8")
