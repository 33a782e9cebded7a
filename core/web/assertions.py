"""The handlers of what somebody asserts of an account: that it stood at an amount by the end of a day.

An assertion is written down whether it holds or not. One that does not is an answer like any other and no problem: that
the book and the bank disagree is what whoever asked wanted to know.
"""

from typing import Final

from starlette.requests import Request
from starlette.responses import Response

from core.journal import as_of
from core.ledger.commands import (
    AccountAssertionBody,
    AssertionBody,
    assert_balance,
)
from core.ledger.seen import seen
from core.web.asking import Routes, accepted, as_json, as_list, carry_out, read, service_of
from core.web.intake import Parameters, account_in_path, decode_body, make_cursor, read_body

_PARAMETERS: Final = frozenset({"limit", "cursor"})


async def create_assertion(request: Request) -> Response:
    """POST /api/ledger/accounts/{id}/assertions."""
    service = service_of(request)
    body = await read_body(request, service.settings.body_bytes_max)
    said = decode_body(body, AccountAssertionBody)
    wish = AssertionBody(account_in_path(request), said.date, said.amount)
    versions = accepted(seen(said.expected_versions))
    command = accepted(assert_balance(wish, service.new_id(), versions))
    return await carry_out(request, "balance.assert", command, body)


async def list_assertions(request: Request) -> Response:
    """GET /api/ledger/accounts/{id}/assertions."""
    account_id = account_in_path(request)
    parameters = Parameters(request, _PARAMETERS)
    limit, before = parameters.limit(), parameters.cursor()
    parameters.check()
    found = await read(
        request,
        "read.assertions",
        lambda c: as_of.list_assertions(c, account_id, before, limit + 1),
        account_ids=(account_id,),
    )
    page = found[:limit]
    return as_json(as_list(page, make_cursor(page[-1].seq) if len(found) > limit else None))


ROUTES: Final[Routes] = {
    "/api/ledger/accounts/{id}/assertions": {"GET": list_assertions, "POST": create_assertion},
}
