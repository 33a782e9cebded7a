"""The handlers: one short function per thing that can be asked over HTTP.

Each takes a request apart, gets a slot, asks the service and tells what came back. Whether something may be
done is never decided here; a handler only knows shapes.
"""

import logging
from collections.abc import Callable, Sequence
from typing import Any, Final, TypeVar, assert_never

import msgspec
from sqlalchemy import Connection
from starlette.requests import Request
from starlette.responses import Response

from core.journal import queries
from core.journal.answers import (
    Answer,
    DecisionFailed,
    Done,
    KeyTaken,
    KeyUnknown,
    Leaving,
    OutcomeUnknown,
    Refused,
    StoreBusy,
    status_of,
)
from core.journal.queries import TransactionFilter
from core.journal.store import StoreError
from core.ledger.accounts import is_account_id
from core.ledger.commands import (
    AccountBody,
    Command,
    NoBody,
    TransactionBody,
    accounts_of,
    close_account,
    open_account,
    post_transaction,
    transaction_of,
)
from core.ledger.reasons import Rejection
from core.ledger.views import view_account
from core.service import Draining, NoSlot, ReadTooLong, Service
from core.web.door import take_slot
from core.web.intake import (
    Parameters,
    asked_digest,
    check_key,
    decode_body,
    digest_of,
    idempotency_key,
    make_cursor,
    read_body,
)
from core.web.problems import Outcome, Problem, ProblemError, problem_json, refusal
from frontend.render import language

T = TypeVar("T")

logger = logging.getLogger("core.web")

NAMED_MAX: Final = 128  # characters of somebody's text that a sentence repeats

_TRANSACTION_PARAMETERS: Final = frozenset({"account", "from", "to", "q", "limit", "cursor"})
_ACCOUNT_PARAMETERS: Final = frozenset({"limit", "cursor"})
_EVENT_PARAMETERS: Final = frozenset({"after", "limit"})


def service_of(request: Request) -> Service:
    """Return the service this application was made for."""
    service: Service = request.app.state.service
    return service


async def create_account(request: Request) -> Response:
    """POST /api/ledger/accounts."""
    body = await read_body(request, service_of(request).settings.body_bytes_max)
    command = _accepted(open_account(decode_body(body, AccountBody)))
    return await _carry_out(request, "account.open", command, body)


async def close(request: Request) -> Response:
    """POST /api/ledger/accounts/{id}/close."""
    body = await read_body(request, service_of(request).settings.body_bytes_max)
    if body:
        decode_body(body, NoBody)
    account_id = _account_in_path(request)
    return await _carry_out(request, "account.close", close_account(account_id), body)


async def create_transaction(request: Request) -> Response:
    """POST /api/ledger/transactions."""
    service = service_of(request)
    body = await read_body(request, service.settings.body_bytes_max)
    command = _accepted(post_transaction(decode_body(body, TransactionBody), service.new_id()))
    return await _carry_out(request, "transaction.post", command, body)


async def list_accounts(request: Request) -> Response:
    """GET /api/ledger/accounts."""
    parameters = Parameters(request, _ACCOUNT_PARAMETERS)
    limit = parameters.limit(queries.ACCOUNTS_MAX, queries.ACCOUNTS_MAX)
    after = parameters.account("cursor")
    parameters.check()
    accounts = await _read(request, "read.accounts", lambda c: queries.list_accounts(c, after, limit + 1))
    page = [view_account(account) for account in accounts[:limit]]
    return _json(_page(page, page[-1].id if len(accounts) > limit else None))


async def get_account(request: Request) -> Response:
    """GET /api/ledger/accounts/{id}."""
    account_id = _account_in_path(request)
    account = await _read(
        request, "read.account", lambda c: queries.get_account(c, account_id), account_ids=(account_id,)
    )
    if account is None:
        raise ProblemError(Problem("account-not-found", values={"account": account_id}))
    return _json(view_account(account))


async def list_transactions(request: Request) -> Response:
    """GET /api/ledger/transactions."""
    parameters = Parameters(request, _TRANSACTION_PARAMETERS)
    limit = parameters.limit()
    wanted = TransactionFilter(
        account=parameters.account(),
        date_from=parameters.day("from"),
        date_to=parameters.day("to"),
        words=parameters.words("q"),
        before_seq=parameters.cursor(),
        limit=limit + 1,
    )
    parameters.check()
    found = await _read(request, "read.transactions", lambda c: queries.list_transactions(c, wanted))
    page = found[:limit]
    return _json(_page(page, make_cursor(page[-1].seq) if len(found) > limit else None))


async def get_transaction(request: Request) -> Response:
    """GET /api/ledger/transactions/{id}."""
    wanted: str = request.path_params["id"]
    found = await _read(
        request, "read.transaction", lambda c: queries.get_transaction(c, wanted), transaction_id=wanted
    )
    if found is None:
        raise ProblemError(Problem("transaction-not-found", values={"transaction": wanted[:NAMED_MAX]}))
    return _json(found)


async def list_events(request: Request) -> Response:
    """GET /api/ledger/events."""
    parameters = Parameters(request, _EVENT_PARAMETERS)
    after, limit = parameters.sequence("after"), parameters.limit()
    parameters.check()
    found = await _read(request, "read.events", lambda c: queries.list_events(c, after, limit + 1))
    page = found[:limit]
    return _json(_page(page, str(page[-1].seq) if len(found) > limit else None))


async def get_verdict(request: Request) -> Response:
    """GET /api/ledger/verify."""
    verdict = await service_of(request).verify()
    if isinstance(verdict, NoSlot):
        raise ProblemError(Problem("busy"))
    if isinstance(verdict, Draining):
        raise ProblemError(Problem("leaving"))
    if isinstance(verdict, StoreError):
        logger.error("The ledger could not be read for its proof: %s", verdict.text)
        raise ProblemError(Problem("store-unreadable"))
    return _json(verdict)


async def look_up(request: Request) -> Response:
    """GET /api/ledger/commands/{key}."""
    service = service_of(request)
    key = check_key(request.path_params["key"])
    slot = _slot(request, "command.look_up", b"", key=key)
    answer = await service.look_up(key, asked_digest(request), slot)
    match answer:
        case KeyTaken():
            # The same wish in other words, or another wish: only the request itself, sent again, is told which.
            return _json({"key": key, "outcome": Outcome.UNKNOWN})
        case Done(status, body):
            told: Any = msgspec.Raw(body)
        case Refused(rejection):
            status = status_of(rejection.slug)
            lang = language(request.headers.get("accept-language"))
            told = problem_json(refusal(rejection), lang, service.settings.retry_after_s)
        case _:
            return _tell(answer)
    return _json({"key": key, "outcome": "done", "status": status, "answer": told})


async def health(request: Request) -> Response:
    """GET /healthz: no slot, no store."""
    service = service_of(request)
    return _json({"epoch": service.epoch, "seq": service.head_seq})


async def _carry_out(request: Request, kind: str, command: Command, body: bytes) -> Response:
    key = idempotency_key(request)
    service = service_of(request)
    command_id = service.new_id()
    transaction_id = transaction_of(command)
    account_ids = accounts_of(command)
    slot = _slot(
        request,
        kind,
        body,
        key=key,
        command_id=command_id,
        transaction_id=transaction_id,
        account_ids=account_ids,
    )
    return _tell(await service.carry_out(command, key, digest_of(request, body), command_id, slot))


async def _read(
    request: Request,
    kind: str,
    question: Callable[[Connection], T],
    *,
    transaction_id: str = "",
    account_ids: tuple[str, ...] = (),
) -> T:
    payload = request.url.query.encode("utf-8", "replace")
    slot = _slot(request, kind, payload, transaction_id=transaction_id, account_ids=account_ids)
    found = await service_of(request).read(slot, question)
    if isinstance(found, ReadTooLong):
        raise ProblemError(Problem("read-too-long"))
    if isinstance(found, StoreError):
        logger.error("The ledger could not be read: %s", found.text)
        raise ProblemError(Problem("store-unreadable"))
    return found


def _slot(request: Request, kind: str, payload: bytes, **named: Any) -> int:
    slot = service_of(request).begin(kind, payload, **named)
    match slot:
        case NoSlot():
            raise ProblemError(Problem("busy"))
        case Draining():
            raise ProblemError(Problem("leaving"))
        case int():
            take_slot(request.scope, slot)
            return slot
        case _:
            assert_never(slot)


def _tell(answer: Answer) -> Response:
    match answer:
        case Done(status, body, replayed):
            headers = {"Idempotent-Replayed": "true"} if replayed else None
            return Response(body, status, headers, media_type="application/json")
        case Refused(rejection, replayed):
            raise ProblemError(refusal(rejection, replayed=replayed))
        case KeyTaken():
            raise ProblemError(Problem("key-reused"))
        case KeyUnknown():
            raise ProblemError(Problem("command-not-found"))
        case StoreBusy():
            raise ProblemError(Problem("store-busy"))
        case OutcomeUnknown():
            raise ProblemError(Problem("outcome-unknown"))
        case Leaving():
            raise ProblemError(Problem("leaving"))
        case DecisionFailed(text):
            logger.error("A command could not be decided: %s", text)
            raise ProblemError(Problem("internal", outcome=Outcome.NOT_DONE))
        case _:
            assert_never(answer)


def _accepted(command: T | Rejection) -> T:
    if isinstance(command, Rejection):
        raise ProblemError(refusal(command))
    return command


def _account_in_path(request: Request) -> str:
    account_id: str = request.path_params["id"]
    if not is_account_id(account_id):
        raise ProblemError(Problem("account-not-found", values={"account": account_id[:NAMED_MAX]}))
    return account_id


def _page(items: Sequence[Any], next_cursor: str | None) -> dict[str, Any]:
    return {"items": items, "next_cursor": next_cursor}


def _json(value: Any) -> Response:
    return Response(msgspec.json.encode(value), media_type="application/json")
