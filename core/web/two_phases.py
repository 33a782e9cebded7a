"""The handlers of what becomes of a transaction: posted, voided, reversed.

As in `handlers.py`, each takes a request apart, asks and tells. None of them changes what was booked: each books something
of its own, and what it speaks of is named by its path.
"""

import re
from typing import Final

from starlette.requests import Request
from starlette.responses import Response

from core.ledger.commands import (
    ExpirePending,
    NoBody,
    PendingPostBody,
    ReverseTransaction,
    VoidPending,
    post_pending,
)
from core.ledger.seen import SeenBody, seen
from core.web.asking import Routes, accepted, carry_out, service_of
from core.web.intake import NAMED_MAX, decode_body, read_body
from core.web.problems import Problem, ProblemError

_ID: Final = re.compile(r"[0-9a-f-]{36}")


async def post(request: Request) -> Response:
    """POST /api/ledger/transactions/{id}/post: all of what is pending, or a part."""
    service = service_of(request)
    body = await read_body(request, service.settings.body_bytes_max)
    said = decode_body(body, PendingPostBody) if body else PendingPostBody()
    command = accepted(post_pending(_named_in_path(request), said, service.new_id(), said.expected_versions))
    return await carry_out(request, "pending.post", command, body)


async def void(request: Request) -> Response:
    """POST /api/ledger/transactions/{id}/void: what is pending is given up."""
    body = await read_body(request, service_of(request).settings.body_bytes_max)
    command = VoidPending(_named_in_path(request), _seen_in(body))
    return await carry_out(request, "pending.void", command, body)


async def expire(request: Request) -> Response:
    """POST /api/ledger/transactions/{id}/expire: what has run out is freed, as the scheduler would do it in its next round."""
    body = await read_body(request, service_of(request).settings.body_bytes_max)
    if body:
        decode_body(body, NoBody)
    return await carry_out(request, "pending-expiry", ExpirePending(_named_in_path(request)), body)


async def reverse(request: Request) -> Response:
    """POST /api/ledger/transactions/{id}/reverse: what is booked is taken back by its opposite."""
    service = service_of(request)
    body = await read_body(request, service.settings.body_bytes_max)
    command = ReverseTransaction(_named_in_path(request), service.new_id(), _seen_in(body))
    return await carry_out(request, "transaction.reverse", command, body)


def _seen_in(body: bytes) -> dict[str, int]:
    return accepted(seen(decode_body(body, SeenBody).expected_versions)) if body else {}


def _named_in_path(request: Request) -> str:
    transaction_id: str = request.path_params["id"]
    if _ID.fullmatch(transaction_id) is None:
        raise ProblemError(
            Problem("transaction-not-found", values={"transaction": transaction_id[:NAMED_MAX]})
        )
    return transaction_id


ROUTES: Final[Routes] = {
    "/api/ledger/transactions/{id}/post": {"POST": post},
    "/api/ledger/transactions/{id}/void": {"POST": void},
    "/api/ledger/transactions/{id}/expire": {"POST": expire},
    "/api/ledger/transactions/{id}/reverse": {"POST": reverse},
}
