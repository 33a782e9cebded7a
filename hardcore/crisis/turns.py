"""What stands in the line of one client's connection, and what the connection waits for meanwhile."""

from dataclasses import dataclass
from enum import Enum, auto

from hardcore.crisis.problems import Problem


class Mode(Enum):
    """What the connection waits for; its deadline belongs to it."""

    IDLE = auto()  # the next request
    HEAD = auto()  # the rest of a head
    BODY = auto()  # the rest of a body
    DESK = auto()  # an answer; the deadline is the desk's
    STALLED = auto()  # the client, which does not take its answer
    LEAVING = auto()  # our last bytes to go out, and (after an early answer) the client to have said all


@dataclass(frozen=True, slots=True)
class Refused:
    """A request refused by its head, answered in its turn; the connection ends with it."""

    problem: Problem
    accept_language: str = ""
    no_body: bool = False
