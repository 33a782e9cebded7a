"""Between a handler and the service: a slot, a command or a question, and the answer as a response.

Every handler of the core goes through here, whatever it shows: so every piece of work stands on the recorder,
every refusal ends the request as a problem, and no handler decides for itself what an outcome means.
"""

import logging
from collections.abc import Awaitable, Callable, Container, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar, assert_never

import msgspec
from sqlalchemy import Connection
from starlette.requests import Request
from starlette.responses import Response

from core.guarded.naming import ids_shown
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
)
from core.journal.store import StoreError, StoreFault
from core.ledger.commands import Command, accounts_of, transaction_of
from core.ledger.reasons import Rejection
from core.service import ReadTooLong, Service
from core.slots import Draining, Held, NoSlot, holding_slot
from core.web.door import note_commit, take_slot
from core.web.intake import digest_of, idempotency_key, request_name
from core.web.problems import Outcome, Problem, ProblemError, limited, refusal, safe_mode, set_aside

T = TypeVar("T")

Handler = Callable[[Request], Awaitable[Response]]
Routes = dict[str, dict[str, Handler]]  # path -> method -> who answers

logger = logging.getLogger("core.web")


def service_of(request: Request) -> Service:
    """Return the service this application was made for."""
    service: Service = request.app.state.service
    return service


def left_out(request: Request) -> Container[int]:
    """Return the numbers of the events that are left out: no answer is made of what stands in them."""
    return service_of(request).rulings.quarantine.rules.parked


async def carry_out(request: Request, kind: str, command: Command, body: bytes) -> Response:
    """Have a command carried out under the key of its request; `kind` names it on the recorder."""
    key, name = named(request)
    service = service_of(request)
    command_id = service.new_id()
    transaction_id = transaction_of(command)
    account_ids = accounts_of(command)
    slot = begin(
        request,
        kind,
        body,
        key=key,
        name=name,
        command_id=command_id,
        transaction_id=transaction_id,
        account_ids=account_ids,
    )
    answer = await service.carry_out(
        command,
        key,
        digest_of(request, body),
        command_id,
        slot,
        kind=kind,
        name=name,
        body_bytes=len(body),
    )
    return respond_with(request, answer)


def named(request: Request) -> tuple[str | None, str]:
    """Return the key of a request, and where it has none the name that the gateway made for it."""
    key = idempotency_key(request)
    return key, "" if key is not None else request_name(request)


async def read(
    request: Request,
    kind: str,
    question: Callable[[Connection], T],
    *,
    transaction_id: str = "",
    account_ids: tuple[str, ...] = (),
) -> T:
    """Ask the book on a reader's thread and return what it says; `kind` names it on the recorder."""
    payload = request.url.query.encode("utf-8", "replace")
    slot = begin(request, kind, payload, transaction_id=transaction_id, account_ids=account_ids)
    found = await service_of(request).read(
        slot, question, transaction_id=transaction_id, account_id=ids_shown(account_ids)
    )
    if isinstance(found, ReadTooLong):
        raise ProblemError(Problem("read-too-long"))
    if isinstance(found, StoreError) and found.fault in {StoreFault.TAKEN, StoreFault.AWAY}:
        raise ProblemError(Problem("busy"))
    if isinstance(found, StoreError):
        logger.error("The ledger could not be read: %s", found.text)
        raise ProblemError(Problem("store-unreadable"))
    return found


def begin(request: Request, kind: str, payload: bytes, **named: Any) -> int:
    """Return the slot of this request, which may not run without one; it is given back with the answer."""
    slot = granted(service_of(request).begin(kind, payload, **named))
    take_slot(request.scope, slot)
    return slot


@contextmanager
def working(request: Request, kind: str, payload: bytes, **named: Any) -> Iterator[Held]:
    """Hold a slot for one of several pieces of work of this request; a problem that ends it gives it its status."""
    with holding_slot(service_of(request), kind, payload, **named) as found:
        held = granted(found)
        try:
            yield held
        except ProblemError as error:
            held.status = error.problem.told_status
            raise


def granted(found: T | NoSlot | Draining) -> T:
    """Return what was asked for, or end the request where nothing new can be begun."""
    if isinstance(found, NoSlot):
        raise ProblemError(Problem("busy"))
    if isinstance(found, Draining):
        raise ProblemError(Problem("leaving"))
    return found


def respond_with(request: Request, answer: Answer) -> Response:
    """Return the response for what the writer answered."""
    if not isinstance(answer, Done):
        raise ProblemError(problem_of(answer))
    if answer.commit is not None:
        note_commit(request.scope, answer.commit)
    headers = {"Idempotent-Replayed": "true"} if answer.replayed else None
    return Response(answer.body, answer.status, headers, media_type="application/json")


def problem_of(answer: Answer) -> Problem:
    """Return the problem that tells what the writer answered, where that is not that it was carried out."""
    match answer:
        case Done() | Each():
            raise AssertionError("what was carried out is no problem")
        case Refused(rejection, replayed):
            return refusal(rejection, replayed=replayed)
        case KeyTaken():
            return Problem("key-reused")
        case KeyUnknown():
            return Problem("command-not-found")
        case StoreBusy():
            return Problem("store-busy")
        case OutcomeUnknown():
            return Problem("outcome-unknown")
        case Leaving():
            return Problem("leaving")
        case ReadOnly(reason):
            return safe_mode(reason)
        case SetAside():
            return set_aside(answer)
        case Limited():
            return limited(answer)
        case DecisionFailed(text):
            logger.error("A command could not be decided: %s", text)
            return Problem("internal", outcome=Outcome.NOT_DONE)
        case _:
            assert_never(answer)


def accepted(command: T | Rejection) -> T:
    """Return the command, or end the request with what is wrong with it."""
    if isinstance(command, Rejection):
        raise ProblemError(refusal(command))
    return command


def as_list(items: Sequence[Any], next_cursor: str | None) -> dict[str, Any]:
    """Return a list as answers show it."""
    return {"items": items, "next_cursor": next_cursor}


def as_json(value: Any) -> Response:
    """Return a value as a response."""
    return Response(msgspec.json.encode(value), media_type="application/json")
