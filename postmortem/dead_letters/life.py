"""The life of a dead letter: one total table of where it is and what happens to it.

```
            came back                      ┌───────── declined, uncertain, came back ─────────┐
               │                           ▼                                                  │
 spool ──► QUARANTINED ◄── hold ──► HELD   QUARANTINED ── retry ──► RETRYING ── confirmed ──► RESOLVED
               │  ▲                  │     HELD ───────── retry ──►    │
            discard └─ undo (30 s) ──┴──► DISCARDED                    └ also after our own death: its key is looked up
```

Pure. A letter leaves the queue only for a core's word (`CONFIRMED`) or a person's (`DISCARD`, a mark that stays
visible). Whatever a retry's end is, it is written before the letter is anywhere else, and RETRYING is written before the
request is sent: a death between two steps leaves a letter that is looked up, never one that is nowhere. Deciding by
what the row holds besides its state was not chosen: two retries at once would both find it fit.
"""

from enum import StrEnum
from typing import Final

from postmortem.views import LetterState


class Trigger(StrEnum):
    """What happens to a letter."""

    RETRY = "retry"
    CONFIRMED = "confirmed"  # a core has it in the ledger, under its own key
    DECLINED = "declined"  # the ledger said no, or set it aside again
    UNCERTAIN = "uncertain"  # nobody could say; it is looked up and absent, and refused again from now on
    CAME_BACK = "came back"  # the guard set it aside again
    HOLD = "hold"
    DISCARD = "discard"
    UNDO = "undo"
    UNDO_HELD = "undo, held before"
    CORRECTED = "corrected"  # a core has what a person sent in its place
    RELEASED = "released"  # a row of a file: its rule is gone, and a person imports the file again


_Q, _H, _G, _R, _D = (
    LetterState.QUARANTINED,
    LetterState.HELD,
    LetterState.RETRYING,
    LetterState.RESOLVED,
    LetterState.DISCARDED,
)
_T = Trigger

#: Every state × every trigger: where it is then, or the code of why that can't be done.
LIFE: Final[dict[tuple[LetterState, Trigger], LetterState | str]] = {
    (_Q, _T.RETRY): _G,
    (_Q, _T.CONFIRMED): _R,  # found in the ledger by a dry run, or by a look-up after our death
    (_Q, _T.DECLINED): _Q,
    (_Q, _T.UNCERTAIN): _Q,
    (_Q, _T.CAME_BACK): _Q,
    (_Q, _T.HOLD): _H,
    (_Q, _T.DISCARD): _D,
    (_Q, _T.UNDO): "letter_not_discarded",
    (_Q, _T.UNDO_HELD): "letter_not_discarded",
    (_Q, _T.CORRECTED): _D,
    (_Q, _T.RELEASED): _D,
    (_H, _T.RETRY): _G,
    (_H, _T.CONFIRMED): _R,
    (_H, _T.DECLINED): _H,
    (_H, _T.UNCERTAIN): _H,
    (_H, _T.CAME_BACK): _Q,
    (_H, _T.HOLD): "letter_held",
    (_H, _T.DISCARD): _D,
    (_H, _T.UNDO): "letter_not_discarded",
    (_H, _T.UNDO_HELD): "letter_not_discarded",
    (_H, _T.CORRECTED): _D,
    (_H, _T.RELEASED): _D,
    (_G, _T.RETRY): "letter_busy",
    (_G, _T.CONFIRMED): _R,
    (_G, _T.DECLINED): _Q,
    (_G, _T.UNCERTAIN): _Q,
    (_G, _T.CAME_BACK): _Q,
    (_G, _T.HOLD): "letter_busy",
    (_G, _T.DISCARD): "letter_busy",
    (_G, _T.UNDO): "letter_busy",
    (_G, _T.UNDO_HELD): "letter_busy",
    (_G, _T.CORRECTED): _D,
    (_G, _T.RELEASED): _D,
    (_R, _T.RETRY): "letter_resolved",
    (_R, _T.CONFIRMED): _R,
    (_R, _T.DECLINED): _R,
    (_R, _T.UNCERTAIN): _R,
    (
        _R,
        _T.CAME_BACK,
    ): _Q,  # it is refused again, so a person has to see it; a retry finds what the ledger has
    (_R, _T.HOLD): "letter_resolved",
    (_R, _T.DISCARD): "letter_resolved",
    (_R, _T.UNDO): "letter_resolved",
    (_R, _T.UNDO_HELD): "letter_resolved",
    (_R, _T.CORRECTED): _R,
    (_R, _T.RELEASED): _R,
    (_D, _T.RETRY): "letter_discarded",
    (_D, _T.CONFIRMED): _R,
    (_D, _T.DECLINED): _D,
    (_D, _T.UNCERTAIN): _D,
    (_D, _T.CAME_BACK): _D,  # the mark stays: it goes on being refused
    (_D, _T.HOLD): "letter_discarded",
    (_D, _T.DISCARD): "letter_discarded",
    (_D, _T.UNDO): _Q,
    (_D, _T.UNDO_HELD): _H,
    (_D, _T.CORRECTED): _D,
    (_D, _T.RELEASED): _D,
}

#: How long a discard can be taken back.
UNDO_S: Final = 30
#: How old a dry run may be that a retry relies on.
DRY_RUN_S: Final = 600


def after(state: LetterState, trigger: Trigger) -> LetterState | str:
    """Where a letter is after something happened to it, or the code of why it can't happen."""
    return LIFE[state, trigger]
