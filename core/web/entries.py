"""The handlers of the household's side: entries, the register, a month in sums, categories.

As in `handlers.py`, each takes a request apart, asks and tells; the rules are the ledger's.
"""

import calendar
import datetime as dt
import re
from functools import partial
from typing import Final

from starlette.requests import Request
from starlette.responses import Response

from core.journal import register
from core.journal.register import HouseholdFilter, Position
from core.ledger.entries import (
    EntryBody,
    EntryChangeBody,
    EntryReversalBody,
    record_entry,
    replace_entry,
    reverse_entry,
)
from core.web.asking import Routes, accepted, as_json, as_list, carry_out, left_out, read, service_of
from core.web.intake import Parameters, decode_body, make_position, read_body
from core.web.problems import Problem, ProblemError

_ENTRY_ID: Final = re.compile(r"[0-9a-f-]{36}")
_LIST_PARAMETERS: Final = frozenset({"account", "from", "to", "q", "limit", "cursor"})
_CATEGORY_PARAMETERS: Final = frozenset({"limit", "cursor"})
_SUMMARY_PARAMETERS: Final = frozenset({"month"})


async def create_entry(request: Request) -> Response:
    """POST /api/ledger/entries."""
    service = service_of(request)
    body = await read_body(request, service.settings.body_bytes_max)
    command = accepted(record_entry(decode_body(body, EntryBody), service.new_id()))
    return await carry_out(request, "entry.record", command, body)


async def change_entry(request: Request) -> Response:
    """PUT /api/ledger/entries/{id}."""
    service = service_of(request)
    body = await read_body(request, service.settings.body_bytes_max)
    details = decode_body(body, EntryChangeBody)
    wish = replace_entry(
        entry_in_path(request),
        details,
        service.new_id(),
        service.new_id(),
        expected_seq=details.expected_seq,
    )
    return await carry_out(request, "entry.replace", accepted(wish), body)


async def delete_entry(request: Request) -> Response:
    """DELETE /api/ledger/entries/{id}: what stands is reversed, nothing is deleted."""
    service = service_of(request)
    body = await read_body(request, service.settings.body_bytes_max)
    said = decode_body(body, EntryReversalBody) if body else EntryReversalBody()
    command = reverse_entry(entry_in_path(request), service.new_id(), said.expected_seq)
    return await carry_out(request, "entry.reverse", command, body)


async def get_entry(request: Request) -> Response:
    """GET /api/ledger/entries/{id}."""
    wanted = entry_in_path(request)
    question = partial(register.get_entry, entry_id=wanted, parked=left_out(request))
    found = await read(request, "read.entry", question, transaction_id=wanted)
    if found is None:
        raise ProblemError(Problem("entry-not-found"))
    return as_json(found)


async def list_entries(request: Request) -> Response:
    """GET /api/ledger/entries."""
    wanted, limit = _wanted(request)
    parked = left_out(request)
    found = await read(request, "read.entries", lambda c: register.list_entries(c, wanted, parked))
    entries = found[:limit]
    more = len(found) > limit
    return as_json(as_list(entries, make_position(entries[-1].date, entries[-1].seq, 0) if more else None))


async def list_register(request: Request) -> Response:
    """GET /api/ledger/register."""
    wanted, limit = _wanted(request)
    parked = left_out(request)
    found = await read(request, "read.register", lambda c: register.list_register(c, wanted, parked))
    lines = found[:limit]
    last = lines[-1] if len(found) > limit else None
    return as_json(as_list(lines, make_position(last.date, last.seq, last.line) if last else None))


async def get_summary(request: Request) -> Response:
    """GET /api/ledger/summary: without a month, the one of the machine's calendar."""
    parameters = Parameters(request, _SUMMARY_PARAMETERS)
    month = parameters.month("month") or dt.date.today().strftime("%Y-%m")  # noqa: DTZ011  people's own day
    parameters.check()
    first, last = days_of(month)
    found = await read(request, "read.summary", lambda c: register.summary_of(c, month, first, last))
    return as_json(found)


async def list_categories(request: Request) -> Response:
    """GET /api/ledger/categories."""
    parameters = Parameters(request, _CATEGORY_PARAMETERS)
    limit = parameters.limit(register.ACCOUNTS_MAX, register.ACCOUNTS_MAX)
    after = parameters.account("cursor")
    parameters.check()
    found = await read(request, "read.categories", lambda c: register.list_categories(c, after, limit + 1))
    categories = found[:limit]
    return as_json(as_list(categories, categories[-1].account if len(found) > limit else None))


def days_of(month: str) -> tuple[str, str]:
    """Return the first and the last day of a month written YYYY-MM."""
    year, number = int(month[:4]), int(month[5:])
    return f"{month}-01", f"{month}-{calendar.monthrange(year, number)[1]:02d}"


def entry_in_path(request: Request) -> str:
    """Return the id of the entry that the path names, or end the request where no entry can be called so."""
    entry_id: str = request.path_params["id"]
    if _ENTRY_ID.fullmatch(entry_id) is None:
        raise ProblemError(Problem("entry-not-found"))
    return entry_id


def _wanted(request: Request) -> tuple[HouseholdFilter, int]:
    """Return what a list was asked for, with room for one more than the page holds: is there a next one?"""
    parameters = Parameters(request, _LIST_PARAMETERS)
    limit = parameters.limit()
    place = parameters.position("cursor")
    wanted = HouseholdFilter(
        account=parameters.account(),
        date_from=parameters.day("from"),
        date_to=parameters.day("to"),
        words=parameters.words("q"),
        after=Position(*place) if place else None,
        limit=limit + 1,
    )
    parameters.check()
    return wanted, limit


ROUTES: Final[Routes] = {
    "/api/ledger/entries": {"GET": list_entries, "POST": create_entry},
    "/api/ledger/entries/{id}": {"GET": get_entry, "PUT": change_entry, "DELETE": delete_entry},
    "/api/ledger/register": {"GET": list_register},
    "/api/ledger/summary": {"GET": get_summary},
    "/api/ledger/categories": {"GET": list_categories},
}
