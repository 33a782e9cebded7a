"""The ledger's own pages: what each shows, read from the book in one moment and drawn in the reader's language.

The browser gets finished pages; its scripts only send forms without leaving, and ask for the same page again when
the ledger says that something changed. A program in the browser that draws from the API was not chosen: the page
must be readable at once, without scripts, and on the slowest phone in the house.
"""

import functools
import time
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

import msgspec
from starlette.requests import Request
from starlette.responses import Response

from core.ledger.accounts import AccountType, is_account_id
from core.ledger.fields import is_date
from core.web import pages_book
from core.web.asking import left_out, read, service_of
from core.web.entries import days_of, entry_in_path
from core.web.intake import WORDS_CHARACTERS_MAX, read_position
from core.web.pages_answers import ACCOUNT_COOKIE, reader_of, show
from core.web.pages_book import EntryPicture
from core.web.pages_forms import Drawn
from core.web.problems import Problem, ProblemError
from frontend.amounts import group_digits
from frontend.charts import chart
from frontend.render import Language

RECENT_MAX: Final = 8
PAGE_LINES_MAX: Final = 50
MINUTE_NS: Final = 60_000_000_000
CURRENCIES: Final = ("KRW", "USD", "EUR", "JPY", "GBP", "CNY")
HOME_CURRENCY: Final[MappingProxyType[Language, str]] = MappingProxyType({"ko": "KRW", "en": "USD"})
TYPES: Final = (AccountType.ASSET, AccountType.LIABILITY, AccountType.EXPENSE, AccountType.INCOME)
EMPTY_FORM: Final[MappingProxyType[str, str]] = MappingProxyType(
    {
        "kind": "out", "description": "", "amount": "", "account": "", "to": "", "category": "", "date": "",
        "name": "", "type": "asset", "currency": "", "expected_seq": "",
    }
)  # fmt: skip
PLAIN: Final = Drawn(EMPTY_FORM)
_ASKED: Final = ("account", "q", "from", "to", "cursor")


async def overview(request: Request) -> Response:
    """GET /."""
    return await draw_new_entry(request, _fresh(request), 200, None)


async def draw_new_entry(request: Request, form: Drawn, status: int, key: str | None) -> Response:
    """Return the overview with this state of its form."""
    reader = reader_of(request)
    seq = service_of(request).head_seq
    now = f"{reader.today:%Y-%m}"
    question = functools.partial(
        pages_book.overview,
        month=_month(request) or now,
        last_month=now,
        recent_max=RECENT_MAX,
        parked=left_out(request),
    )
    seen = await read(request, "page.overview", question)
    if all(one.id != form.account for one in seen.money_accounts):
        form = msgspec.structs.replace(form, values={**form.values, "account": seen.first_account})
    return show(
        request,
        "overview.html.j2",
        "/",
        status=status,
        key=key,
        seq=seq,
        form=form,
        accounts=seen.accounts,
        open_accounts=seen.money_accounts,
        categories=seen.categories,
        summary=seen.summary,
        flows=seen.flows,
        days=days_of(seen.summary.month),
        spent=seen.spent,
        repeated=pages_book.repeated(line.name for line in seen.spent),
        recent=seen.recent,
        pendings=seen.pendings,
        proven=_proven(request),
        charts=[(course, chart(course.months)) for course in seen.courses],
        currencies=CURRENCIES,
        currency_here=HOME_CURRENCY[reader.lang],
    )


async def register(request: Request) -> Response:
    """GET /register."""
    given = {name: request.query_params.get(name, "") for name in _ASKED}
    _refuse_strange(given)
    form = Drawn({"date": reader_of(request).today.isoformat(), "amount": ""})
    return await draw_register(request, given, form, 200, None)


async def draw_register(
    request: Request, given: Mapping[str, str], form: Drawn, status: int, key: str | None
) -> Response:
    """Return a page of the register as it was asked for; `form`: the state of what the bank says of its account."""
    asked = {name: given.get(name, "") for name in _ASKED}
    seq = service_of(request).head_seq
    question = functools.partial(
        pages_book.register, asked=asked, limit=PAGE_LINES_MAX, parked=left_out(request)
    )
    seen = await read(request, "page.register", question)
    older = dict(asked, cursor=seen.next_cursor) if seen.next_cursor else None
    return show(
        request,
        "register.html.j2",
        "/register",
        status=status,
        key=key,
        form=form,
        said_before=seen.asserted,
        seq=seq,
        asked={**asked, "any": any(asked.values())},
        account=seen.account,
        accounts=seen.accounts,
        lines=seen.lines,
        older=pages_book.register_link(older) if older else None,
        newer=pages_book.register_link({**asked, "cursor": ""}) if asked["cursor"] else None,
    )


async def accounts(request: Request) -> Response:
    """GET /accounts."""
    return await draw_accounts(request, _fresh(request), 200, None)


async def draw_accounts(request: Request, form: Drawn, status: int, key: str | None) -> Response:
    """Return the page of accounts with this state of its form."""
    seq = service_of(request).head_seq
    groups = await read(request, "page.accounts", pages_book.account_groups)
    return show(
        request,
        "accounts.html.j2",
        "/accounts",
        status=status,
        key=key,
        seq=seq,
        form=form,
        plain=PLAIN,
        groups=[(kind, group, pages_book.repeated(one.name for one in group)) for kind, group in groups],
        types=[kind.value for kind in TYPES],
        currencies=CURRENCIES,
    )


async def entry(request: Request) -> Response:
    """GET /entries/{id}."""
    seen = await entry_of(request)
    return await draw_entry(request, seen, _as_form(seen), 200, None)


async def entry_of(request: Request) -> EntryPicture:
    """Return the entry that the path names and what its form needs, or end the request."""
    entry_id = entry_in_path(request)
    seen = await read(
        request,
        "page.entry",
        functools.partial(pages_book.entry, entry_id=entry_id, parked=left_out(request)),
        transaction_id=entry_id,
    )
    if seen is None:
        raise ProblemError(Problem("entry-not-found"))
    return seen


async def draw_entry(
    request: Request, seen: EntryPicture, form: Drawn, status: int, key: str | None
) -> Response:
    """Return the page of an entry with this state of its form.

    A form that was drawn before the entry changed is shown what stands now, and from then on has seen it.
    """
    now = str(seen.entry.seq)
    changed = form.expected_seq not in {"", now}
    return show(
        request,
        "entry.html.j2",
        "/register",
        status=status,
        key=key,
        form=msgspec.structs.replace(form, values={**form.values, "expected_seq": now}),
        changed=changed,
        plain=PLAIN,
        id=seen.entry.id,
        entry=seen.entry,
        action=f"/entries/{seen.entry.id}",
        accounts=seen.accounts,
        categories=seen.categories,
    )


def _proven(request: Request) -> tuple[int, int] | None:
    """Return how many minutes ago this core has proven the whole book, and how many events that were; None: not yet."""
    proven = service_of(request).auditor.proven
    if proven is None:
        return None
    return (time.monotonic_ns() - proven.at_ns) // MINUTE_NS, proven.events


def _fresh(request: Request) -> Drawn:
    reader = reader_of(request)
    return Drawn(
        {
            **EMPTY_FORM,
            "account": request.cookies.get(ACCOUNT_COOKIE, ""),
            "date": reader.today.isoformat(),
            "currency": HOME_CURRENCY[reader.lang],
        }
    )


def _as_form(seen: EntryPicture) -> Drawn:
    shown = seen.entry
    return Drawn(
        {
            **EMPTY_FORM,
            "kind": "out" if shown.amount.startswith("-") else "in",
            "description": shown.description,
            "amount": group_digits(shown.amount.removeprefix("-")),
            "account": shown.account,
            "category": shown.category or "",
            "date": shown.date,
            "expected_seq": str(shown.seq),
        }
    )


def _month(request: Request) -> str | None:
    given = request.query_params.get("month", "")
    if not given:
        return None
    if not is_date(f"{given}-01"):
        raise ProblemError(Problem("not-found"))
    return given


def _refuse_strange(asked: dict[str, str]) -> None:
    days_fit = all(not asked[name] or is_date(asked[name]) for name in ("from", "to"))
    account_fits = not asked["account"] or is_account_id(asked["account"])
    cursor_fits = not asked["cursor"] or read_position(asked["cursor"]) is not None
    if not (days_fit and account_fits and cursor_fits and len(asked["q"]) <= WORDS_CHARACTERS_MAX):
        raise ProblemError(Problem("invalid-parameter"))
