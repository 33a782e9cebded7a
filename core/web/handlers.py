"""The handlers: one short function per thing that can be asked over HTTP.

Each takes a request apart, gets a slot, asks the service and tells what came back. Whether something may be
done is never decided here; a handler only knows shapes.
"""

import logging
from functools import partial
from typing import Any, Final

import msgspec
from sqlalchemy import Connection
from starlette.requests import Request
from starlette.responses import Response

from core.journal import as_of, pendings, queries
from core.journal.answers import Done, KeyTaken, KeyUnknown, Refused, status_of
from core.journal.queries import TransactionFilter
from core.journal.store import StoreError
from core.ledger.accounts import Account
from core.ledger.commands import (
    AccountBody,
    NoBody,
    TransactionBody,
    close_account,
    open_account,
    post_transaction,
)
from core.ledger.views import TransactionView, view_account
from core.service import DRILL
from core.web import batches
from core.web.asking import (
    accepted,
    as_json,
    as_list,
    begin,
    carry_out,
    granted,
    left_out,
    read,
    respond_with,
    service_of,
)
from core.web.intake import (
    NAMED_MAX,
    Parameters,
    account_in_path,
    asked_digest,
    check_key,
    decode_body,
    digest_of,
    expected_version,
    idempotency_key,
    make_cursor,
    read_body,
    version_tag,
)
from core.web.problems import Outcome, Problem, ProblemError, problem_json, refusal
from frontend.render import language

logger = logging.getLogger("core.web")

DRILL_ACCOUNT: Final = "system:drill"
DRILL_BYTES_MAX: Final = 255  # its key, so that no two of them have the same digest

_TRANSACTION_PARAMETERS: Final = frozenset({"account", "from", "to", "q", "state", "limit", "cursor"})
_STATES: Final = frozenset({"posted", "pending"})
_ACCOUNT_PARAMETERS: Final = frozenset({"as_of", "limit", "cursor"})
_AS_OF: Final = frozenset({"as_of"})
_EVENT_PARAMETERS: Final = frozenset({"after", "limit"})


async def create_account(request: Request) -> Response:
    """POST /api/ledger/accounts."""
    body = await read_body(request, service_of(request).settings.body_bytes_max)
    command = accepted(open_account(decode_body(body, AccountBody)))
    return await carry_out(request, "account.open", command, body)


async def close(request: Request) -> Response:
    """POST /api/ledger/accounts/{id}/close."""
    body = await read_body(request, service_of(request).settings.body_bytes_max)
    if body:
        decode_body(body, NoBody)
    account_id, version = account_in_path(request), expected_version(request)
    seen = {account_id: version} if version is not None else {}
    return await carry_out(request, "account.close", close_account(account_id, seen), body)


async def create_transaction(request: Request) -> Response:
    """POST /api/ledger/transactions."""
    service = service_of(request)
    body = await read_body(request, service.settings.body_bytes_max)
    said = decode_body(body, TransactionBody)
    command = accepted(post_transaction(said, service.new_id(), said.expected_versions))
    return await carry_out(request, "transaction.post", command, body)


async def list_accounts(request: Request) -> Response:
    """GET /api/ledger/accounts."""
    parameters = Parameters(request, _ACCOUNT_PARAMETERS)
    limit = parameters.limit(queries.ACCOUNTS_MAX, queries.ACCOUNTS_MAX)
    after, day = parameters.account("cursor"), parameters.day("as_of")
    parameters.check()

    def ask(connection: Connection) -> list[Account]:
        if day is not None:
            return as_of.accounts_as_of(connection, day, after, limit + 1)
        return queries.list_accounts(connection, after, limit + 1)

    accounts = await read(request, "read.accounts", ask)
    page = [view_account(account) for account in accounts[:limit]]
    return as_json(as_list(page, page[-1].id if len(accounts) > limit else None))


async def get_account(request: Request) -> Response:
    """GET /api/ledger/accounts/{id}."""
    account_id = account_in_path(request)
    parameters = Parameters(request, _AS_OF)
    day = parameters.day("as_of")
    parameters.check()

    def ask(connection: Connection) -> Account | None:
        if day is not None:
            return as_of.account_as_of(connection, account_id, day)
        return queries.get_account(connection, account_id)

    account = await read(request, "read.account", ask, account_ids=(account_id,))
    if account is None:
        raise ProblemError(Problem("account-not-found", values={"account": account_id}))
    answer = as_json(view_account(account))
    if day is None:
        answer.headers["ETag"] = version_tag(account.version)
    return answer


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
    state = parameters.choice("state", _STATES)
    parameters.check()
    ask = pendings.list_pendings if state == "pending" else queries.list_transactions
    question = partial(ask, wanted=wanted, parked=left_out(request))
    found = await read(request, "read.transactions", question)
    page = found[:limit]
    return as_json(as_list(page, make_cursor(page[-1].seq) if len(found) > limit else None))


async def get_transaction(request: Request) -> Response:
    """GET /api/ledger/transactions/{id}."""
    wanted: str = request.path_params["id"]
    parked = left_out(request)

    def ask(connection: Connection) -> TransactionView | None:
        booked = queries.get_transaction(connection, wanted, parked)
        return booked or pendings.get_pending(connection, wanted, parked)

    found = await read(request, "read.transaction", ask, transaction_id=wanted)
    if found is None:
        raise ProblemError(Problem("transaction-not-found", values={"transaction": wanted[:NAMED_MAX]}))
    return as_json(found)


async def list_events(request: Request) -> Response:
    """GET /api/ledger/events."""
    parameters = Parameters(request, _EVENT_PARAMETERS)
    after, limit = parameters.sequence("after"), parameters.limit()
    parameters.check()
    found = await read(request, "read.events", lambda c: queries.list_events(c, after, limit + 1))
    page = found[:limit]
    return as_json(as_list(page, str(page[-1].seq) if len(found) > limit else None))


async def get_verdict(request: Request) -> Response:
    """GET /api/ledger/verify."""
    verdict = granted(await service_of(request).verify())
    if isinstance(verdict, StoreError):
        logger.error("The ledger could not be read for its proof: %s", verdict.text)
        raise ProblemError(Problem("store-unreadable"))
    return as_json(verdict)


async def look_up(request: Request) -> Response:
    """GET /api/ledger/commands/{key}."""
    service = service_of(request)
    key = check_key(request.path_params["key"])
    slot = begin(request, "command.look_up", b"", key=key)
    answer = await service.look_up(key, asked_digest(request), slot)
    match answer:
        case KeyTaken():
            # The same wish in other words, or another wish: only the request itself, sent again, is told which.
            return as_json({"key": key, "outcome": Outcome.UNKNOWN})
        case Done(status, body):
            told: Any = msgspec.Raw(body)
        case Refused(rejection):
            status = status_of(rejection.slug)
            lang = language(request.headers.get("accept-language"))
            told = problem_json(refusal(rejection), lang, service.settings)
        case KeyUnknown() if parts := await batches.recall(request, key, asked_digest(request), slot):
            # Of a batch each part has its key: it is in the book where its parts are.
            return as_json({"key": key, "outcome": "done", "status": 200, "answer": parts})
        case _:
            return respond_with(request, answer)
    return as_json({"key": key, "outcome": "done", "status": status, "answer": told})


async def drill(request: Request) -> Response:
    """POST /api/ledger/drill: the command that a drill has poisoned, without effect; anybody else's is not there."""
    body = await read_body(request, DRILL_BYTES_MAX)
    key = idempotency_key(request)
    if key is None:
        raise ProblemError(Problem("not-found"))
    service = service_of(request)
    command_id = service.new_id()
    slot = begin(
        request,
        DRILL,
        body,
        key=key,
        command_id=command_id,
        transaction_id=command_id,
        account_ids=(DRILL_ACCOUNT,),
    )
    answer = await service.exercise(key, digest_of(request, body), command_id, DRILL_ACCOUNT, slot)
    if answer is None:
        raise ProblemError(Problem("not-found"))
    return respond_with(request, answer)


async def health(request: Request) -> Response:
    """GET /healthz: no slot, no store."""
    service = service_of(request)
    return as_json(
        {
            "epoch": service.epoch,
            "seq": service.head_seq,
            "safe": service.safe,
            "checkpoint": service.gone_by or None,
        }
    )
