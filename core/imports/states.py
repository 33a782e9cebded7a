"""The life of an import as a table: where it may be, and what may happen to it there.

Pure. An import that is committed stays so: its rows carry keys made of its id, so another mapping under the
same id would be another wish under used keys. `FAILED` is an end like `DONE`, with everything booked so far in
the book; the same file may be given again, and what is there is known by its fingerprints.
"""

from enum import StrEnum
from types import MappingProxyType
from typing import Final


class State(StrEnum):
    """Where an import is."""

    PREVIEW = "preview"
    COMMITTING = "committing"
    DONE = "done"
    FAILED = "failed"


class Waiting(StrEnum):
    """Why one that is being booked does not go on at this moment."""

    TRIAL = "trial"  # its next row was being booked when a core died
    SOURCE_STOPPED = "source-stopped"  # too many of its rows have ended a core, and it rests for some time


class Trigger(StrEnum):
    """What may happen to it."""

    READ_AGAIN = "read-again"  # another mapping, encoding, format or account is looked at
    COMMIT = "commit"  # the wish to book its rows
    COMMIT_OTHERWISE = "commit-otherwise"  # that wish, with another mapping or account than the one kept
    LAST_ROW = "last-row"
    BROKE = "broke"


#: What is not in it is refused.
TABLE: Final = MappingProxyType(
    {
        (State.PREVIEW, Trigger.READ_AGAIN): State.PREVIEW,
        (State.PREVIEW, Trigger.COMMIT): State.COMMITTING,
        (State.PREVIEW, Trigger.COMMIT_OTHERWISE): State.COMMITTING,
        (State.COMMITTING, Trigger.COMMIT): State.COMMITTING,
        (State.COMMITTING, Trigger.LAST_ROW): State.DONE,
        (State.COMMITTING, Trigger.BROKE): State.FAILED,
        (State.DONE, Trigger.COMMIT): State.DONE,
        (State.FAILED, Trigger.COMMIT): State.FAILED,
    }
)


def after(state: State, trigger: Trigger) -> State | None:
    """Return the state after a trigger, None where it may not happen."""
    return TABLE.get((state, trigger))
