"""The handlers of plans: a month's budgets, and what comes back by itself.

As in `handlers.py`, each takes a request apart, asks and tells. Which day it is, is the server's calendar's to say, and is
said here and nowhere below.
"""

import datetime as dt
import re
from functools import partial
from typing import Final

from starlette.requests import Request
from starlette.responses import Response

from core.journal import planned
from core.ledger.commands import NoBody
from core.ledger.planning import set_budget, set_recurring
from core.ledger.plans import BudgetBody, EndRecurring, RecurringBody
from core.web.asking import Routes, accepted, as_json, as_list, carry_out, left_out, read, service_of
from core.web.entries import days_of
from core.web.intake import Parameters, decode_body, read_body
from core.web.problems import Problem, ProblemError

_ID: Final = re.compile(r"[0-9a-f-]{36}")
_MONTH: Final = frozenset({"month"})
_LIST: Final = frozenset({"limit", "cursor"})


async def list_budgets(request: Request) -> Response:
    """GET /api/ledger/budgets?month=."""
    month = _month(request)
    first, last = days_of(month)
    found = await read(request, "read.budgets", lambda c: planned.budgets_of(c, month, first, last))
    return as_json({"month": month, **as_list(found, None)})


async def put_budget(request: Request) -> Response:
    """PUT /api/ledger/budgets?month=: from that month on, until another is said."""
    body = await read_body(request, service_of(request).settings.body_bytes_max)
    command = accepted(set_budget(decode_body(body, BudgetBody), _month(request)))
    return await carry_out(request, "budget.set", command, body)


async def create_recurring(request: Request) -> Response:
    """POST /api/ledger/recurring."""
    service = service_of(request)
    body = await read_body(request, service.settings.body_bytes_max)
    command = accepted(set_recurring(decode_body(body, RecurringBody), service.new_id(), is_new=True))
    return await carry_out(request, "recurring.set", command, body)


async def change_recurring(request: Request) -> Response:
    """PUT /api/ledger/recurring/{id}: from today on it is this."""
    body = await read_body(request, service_of(request).settings.body_bytes_max)
    item = _item_in_path(request)
    command = accepted(set_recurring(decode_body(body, RecurringBody), item, is_new=False))
    return await carry_out(request, "recurring.set", command, body)


async def end_recurring(request: Request) -> Response:
    """DELETE /api/ledger/recurring/{id}: it comes back no more, and what it has booked stays."""
    body = await read_body(request, service_of(request).settings.body_bytes_max)
    if body:
        decode_body(body, NoBody)
    return await carry_out(request, "recurring.end", EndRecurring(_item_in_path(request)), body)


async def get_recurring(request: Request) -> Response:
    """GET /api/ledger/recurring/{id}."""
    item = _item_in_path(request)
    ask = partial(planned.get_recurring, item_id=item, today=_today(), parked=left_out(request))
    found = await read(request, "read.recurring", ask, transaction_id=item)
    if found is None:
        raise ProblemError(Problem("recurring-not-found"))
    return as_json(found)


async def list_recurring(request: Request) -> Response:
    """GET /api/ledger/recurring."""
    parameters = Parameters(request, _LIST)
    limit, after = parameters.limit(), parameters.item("cursor")
    parameters.check()
    parked = left_out(request)
    found = await read(
        request, "read.recurring", lambda c: planned.list_recurring(c, after, limit + 1, _today(), parked)
    )
    page = found[:limit]
    return as_json(as_list(page, page[-1].id if len(found) > limit else None))


def _today() -> dt.date:
    return dt.date.today()  # noqa: DTZ011  people's own day


def _month(request: Request) -> str:
    parameters = Parameters(request, _MONTH)
    month = parameters.month("month") or _today().strftime("%Y-%m")
    parameters.check()
    return month


def _item_in_path(request: Request) -> str:
    item: str = request.path_params["id"]
    if _ID.fullmatch(item) is None:
        raise ProblemError(Problem("recurring-not-found"))
    return item


ROUTES: Final[Routes] = {
    "/api/ledger/budgets": {"GET": list_budgets, "PUT": put_budget},
    "/api/ledger/recurring": {"GET": list_recurring, "POST": create_recurring},
    "/api/ledger/recurring/{id}": {
        "GET": get_recurring,
        "PUT": change_recurring,
        "DELETE": end_recurring,
    },
}
