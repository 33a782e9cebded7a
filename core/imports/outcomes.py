"""What became of a row of an import: the ledger's answer to its command, in the importer's words. Pure but for the log.

A row is booked, known already, refused for a reason that its owner can read, or not settled, which means asked again.
"""

import logging
from typing import Final, assert_never

import msgspec

from core.imports.reading.candidates import Candidate, SkippedRow
from core.imports.records import PROBLEMS_MAX, Problem, Progress, shown
from core.journal.answers import (
    Answer,
    DecisionFailed,
    Done,
    Each,
    KeyTaken,
    KeyUnknown,
    Leaving,
    Limited,
    OutcomeUnknown,
    ReadOnly,
    Refused,
    SetAside,
    StoreBusy,
    status_of,
)
from core.ledger.reasons import Rejection, Slug
from core.slots import UNANSWERED

BUSY: Final = 503
REFUSED: Final = 422
SET_ASIDE: Final = "set-aside"
ACCOUNT_SET_ASIDE: Final = "account-set-aside"
LIMITED: Final = "limited"
FAILED_INSIDE: Final = "internal"

logger = logging.getLogger("core.imports")


class Booked:
    """The row is in the ledger."""


class Duplicate:
    """The ledger knows the row already."""


class Stopped:
    """The core leaves, or serves reads only: what became of the row is found out by asking again, later."""


Outcome = Booked | Duplicate | Problem | Stopped


def meaning_of(answer: Answer, candidate: Candidate) -> tuple[int, Outcome | None]:
    """Return the status an answer has, and what it means for a row; None: ask again."""
    match answer:
        case Done(status=status):
            return status, Booked()
        case Refused(rejection):
            return status_of(rejection.slug), refused(candidate, rejection)
        case KeyTaken() | DecisionFailed():
            logger.error("Line %d of an import can't be decided: %s", candidate.line, answer)
            return UNANSWERED, Problem(candidate.line, FAILED_INSIDE, shown(candidate.cells))
        case SetAside(letter, account):
            values = {"letter": letter} if account is None else {"letter": letter, "account": account}
            reason = SET_ASIDE if account is None else ACCOUNT_SET_ASIDE
            return REFUSED, Problem(candidate.line, reason, shown(candidate.cells), values)
        case Limited(rule, None):
            return REFUSED, Problem(candidate.line, LIMITED, shown(candidate.cells), {"rule": rule})
        case StoreBusy() | Limited():
            return BUSY, None
        case OutcomeUnknown() | Leaving() | ReadOnly():
            return BUSY, Stopped()
        case KeyUnknown() | Each():
            raise AssertionError("only a look-up, or commands sent together, are told this")
        case _:
            assert_never(answer)


def refused(candidate: Candidate, rejection: Rejection) -> Duplicate | Problem:
    """Return what a refusal of the ledger means for a row."""
    if rejection.slug is Slug.ALREADY_IMPORTED:
        return Duplicate()
    return Problem(candidate.line, rejection.slug.value, shown(candidate.cells), dict(rejection.values))


def settle(progress: Progress, outcome: Booked | Duplicate | Problem | SkippedRow) -> Progress:
    """Return the progress with one more row settled."""
    change = msgspec.structs.replace
    more = change(progress, done=progress.done + 1)
    match outcome:
        case Booked():
            return change(more, booked=more.booked + 1)
        case Duplicate():
            return change(more, duplicates=more.duplicates + 1)
        case SkippedRow():
            return change(more, skipped=more.skipped + 1)
        case Problem():
            kept = (*more.problems, outcome)[:PROBLEMS_MAX]
            return change(more, refused=more.refused + 1, problems=kept)
        case _:
            assert_never(outcome)
