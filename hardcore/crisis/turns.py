"""What stands in the line of one client's connection, and what the connection waits for meanwhile."""

from enum import Enum, auto

import msgspec

from hardcore.crisis import pages
from hardcore.crisis.heads import AnswerHead, RequestHead, answer_bytes
from hardcore.crisis.problems import Outcome, Problem


class Mode(Enum):
    """What the connection waits for; its deadline belongs to it."""

    IDLE = auto()  # the next request
    HEAD = auto()  # the rest of a head
    BODY = auto()  # the rest of a body
    DESK = auto()  # an answer; the deadline is the desk's
    STALLED = auto()  # the client, which does not take its answer
    LEAVING = auto()  # our last bytes to go out, and (after an early answer) the client to have said all


class Refused(msgspec.Struct, frozen=True):
    """A request refused by its head, answered in its turn; the connection ends with it."""

    problem: Problem
    accept_language: str = ""
    no_body: bool = False


def refusal_bytes(refused: Refused, outcome: Outcome | None) -> bytes:
    """The answer to a refused request as it goes out."""
    answer = pages.problem(refused.problem, refused.accept_language, outcome)
    length = len(answer.body)
    said = answer_bytes(answer.head, length=length, chunked=False, close=True, http10=False)
    return said if refused.no_body else said + answer.body


def whole_bytes(asked: RequestHead, head: AnswerHead, body: bytes, *, close: bool) -> bytes:
    """A whole answer as it goes out to whoever asked so: HEAD is told of the body and gets none."""
    silent = asked.method == "HEAD"
    length = head.length if silent else None if head.bodiless else len(body)
    said = answer_bytes(head, length=length, chunked=False, close=close, http10=asked.http10)
    return said if silent or not body else said + body
