"""What a tab is told while its page cannot come: which of the recovery pages is the true one. Pure.

Two facts make the page: how things stand (the posture, and whether it is planned) and what became of the
request itself. The plight is read from the posture and never from the problem, because one problem
(`outcome-unknown`) is told in the middle of an outage, after it, and when everything is being stopped.
"""

from enum import StrEnum
from typing import assert_never

import msgspec

from hardcore.crisis.problems import Outcome, Problem
from hardcore.model.phases import Face


class Plight(StrEnum):
    """How things stand."""

    RECOVERING = "recovering"
    PLANNED = "planned"
    STOPPED_TRYING = "stopped_trying"
    OFF = "off"


class Asked(StrEnum):
    """What became of the request the tab waits for."""

    GET = "get"  # it only reads: asking again is all there is to it
    NOT_DONE = "not_done"
    UNKNOWN = "unknown"
    KEEPABLE = "keepable"  # a form that is not done, and that the gateway would keep
    DOUBTFUL = "doubtful"  # a form of which that is not known, and that the gateway would look up and keep


#: Of these the page carries the wish.
KEPT = frozenset({Asked.KEEPABLE, Asked.DOUBTFUL})


class Cover(msgspec.Struct, frozen=True):
    """Names one recovery page."""

    plight: Plight
    asked: Asked


#: Problems that are an outage's. TOO_BUSY is one of them only while nobody serves.
_OF_AN_OUTAGE = frozenset(
    {
        Problem.RECOVERING,
        Problem.NOT_SERVING,
        Problem.SHUTTING_DOWN,
        Problem.OUTCOME_UNKNOWN,
        Problem.NOT_DONE,
    }
)


def plight(posture: Face, *, planned: bool) -> Plight:
    """How things stand. FORWARD too is an outage here: a core died under the request, and the next one serves."""
    match posture:
        case Face.REFUSE:
            return Plight.STOPPED_TRYING
        case Face.CLOSED:
            return Plight.OFF
        case Face.HOLD | Face.FORWARD:
            return Plight.PLANNED if planned else Plight.RECOVERING
        case _:
            assert_never(posture)


def cover(
    problem: Problem, outcome: Outcome, posture: Face, *, safe: bool, planned: bool, keepable: bool = False
) -> Cover | None:
    """The recovery page for a request that ends in `problem`; None if it is no outage's problem. `keepable`: the
    request is a form that the gateway would keep; it is offered only while a core is coming.
    """
    busy_outage = problem is Problem.TOO_BUSY and posture is not Face.FORWARD
    if problem not in _OF_AN_OUTAGE and not busy_outage:
        return None
    how = plight(posture, planned=planned)
    if safe:
        return Cover(how, Asked.GET)
    offered = keepable and how in {Plight.RECOVERING, Plight.PLANNED}
    if outcome is Outcome.UNKNOWN:
        return Cover(how, Asked.DOUBTFUL if offered else Asked.UNKNOWN)
    return Cover(how, Asked.KEEPABLE if offered else Asked.NOT_DONE)
