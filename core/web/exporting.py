"""`GET /api/ledger/export`: the whole book as a file, of one moment.

CSV has a line for each posting, for a spreadsheet; JSON has each transaction as the API shows it, for a program; the other
two are plain-text ledgers (`core/exporting/`). The answer is streamed as the client takes it, and it says in a header up to
which event it goes. Not chosen: to make the file first and send it then; a large book would need the room of a second one.
"""

import csv
import io
from collections.abc import AsyncIterator, Iterable
from contextlib import ExitStack
from enum import StrEnum
from types import ModuleType
from typing import Final

import msgspec
from starlette.requests import Request
from starlette.responses import Response, StreamingResponse

from core.exporting import beancount, hledger
from core.exporting.names import names_of
from core.exporting.paper import NO_DAY, Paper
from core.journal.exporting import Exported, Moment
from core.journal.store import StoreError
from core.ledger.accounts import Account
from core.slots import Draining
from core.web.asking import Routes, granted, logger, service_of
from core.web.problems import Problem, ProblemError

VERSION: Final = 1
SEQ_HEADER: Final = "X-Ledger-Seq"
BYTE_ORDER_MARK: Final = (
    "\ufeff"  # without it a spreadsheet of some countries takes Korean for something else
)
COLUMNS: Final = (
    "seq",
    "booked_at",
    "date",
    "transaction",
    "entry",
    "reverses",
    "description",
    "account",
    "account_name",
    "amount",
    "currency",
    "category",
    "payment_method",
    "tags",
)
_FORMULA: Final = ("=", "+", "-", "@", "\t", "\r")  # what a spreadsheet would take for something to compute


class Format(StrEnum):
    """What a book can be exported as."""

    CSV = "csv"
    JSON = "json"
    BEANCOUNT = "beancount"
    HLEDGER = "hledger"


MEDIA_TYPES: Final = {
    Format.CSV: "text/csv; charset=utf-8",
    Format.JSON: "application/json",
    Format.BEANCOUNT: "text/plain; charset=utf-8",
    Format.HLEDGER: "text/plain; charset=utf-8",
}
ENDINGS: Final = {Format.HLEDGER: "journal"}  # of the file; else the name of the format


async def export(request: Request) -> Response:
    """GET /api/ledger/export."""
    form = _format(request)
    service = service_of(request)
    if service.draining:
        granted(Draining())
    with ExitStack() as ending:
        if not ending.enter_context(service.exporter.place()):
            raise ProblemError(Problem("busy"))
        of = await service.exporter.now()
        if isinstance(of, StoreError):
            logger.error("The ledger could not be read for an export: %s", of.text)
            raise ProblemError(Problem("store-unreadable"))
        held = ending.pop_all()
    headers = {
        SEQ_HEADER: str(of.seq),
        "Content-Disposition": f'attachment; filename="ledger-{of.seq}.{ENDINGS.get(form, form)}"',
        "Cache-Control": "no-store",
    }
    parts = _parts(form, of, service.exporter.slices(of, lambda: service.draining), held)
    return StreamingResponse(parts, headers=headers, media_type=MEDIA_TYPES[form])


ROUTES: Final[Routes] = {"/api/ledger/export": {"GET": export}}


def _format(request: Request) -> Format:
    given = dict(request.query_params)
    text = given.pop("format", "")
    if given or text not in set(Format):
        raise ProblemError(Problem("export-format-unknown", values={"formats": ", ".join(Format)}))
    return Format(text)


async def _parts(
    form: Format, of: Moment, slices: AsyncIterator[list[Exported]], held: ExitStack
) -> AsyncIterator[bytes]:
    with held:  # until the last byte was taken, or the client has left
        match form:
            case Format.CSV:
                yield (BYTE_ORDER_MARK + _as_lines([COLUMNS])).encode()
                async for some in slices:
                    yield _as_lines(row for one in some for row in _rows(one, of)).encode()
            case Format.JSON:
                yield _json_head(of)
                begun = False
                async for some in slices:
                    yield (b",\n" if begun else b"") + b",\n".join(
                        msgspec.json.encode(one.seen) for one in some
                    )
                    begun = True
                yield b"\n]}\n"
            case Format.BEANCOUNT | Format.HLEDGER:
                async for text in _printed(beancount if form is Format.BEANCOUNT else hledger, of, slices):
                    yield text


async def _printed(
    printer: ModuleType, of: Moment, slices: AsyncIterator[list[Exported]]
) -> AsyncIterator[bytes]:
    """Give a book as one of the two printers writes it."""
    days = of.first_day or NO_DAY, of.last_day or NO_DAY
    paper = Paper(of.seq, of.accounts, names_of(of.accounts.values()), *days, of.pendings)
    yield "".join(printer.head(paper)).encode()
    async for some in slices:
        yield "".join(
            text for one in some for text in printer.transaction(paper, one.seen, one.payment_method)
        ).encode()
    yield "".join(printer.foot(paper)).encode()


def _json_head(of: Moment) -> bytes:
    accounts = [_account(account) for account in of.accounts.values()]
    head = msgspec.json.encode({"version": VERSION, "seq": of.seq, "epoch": of.epoch, "accounts": accounts})
    return head[:-1] + b',"transactions":[\n'


def _account(account: Account) -> dict[str, object]:
    return {
        "id": account.id,
        "name": account.name,
        "type": account.type.value,
        "currency": account.currency,
        "no_overdraft": account.no_overdraft,
        "closed": account.closed,
    }


def _rows(one: Exported, of: Moment) -> Iterable[tuple[str, ...]]:
    seen = one.seen
    for line in seen.postings:
        account = of.accounts.get(line.account)
        yield (
            str(seen.seq),
            seen.booked_at,
            seen.date,
            seen.id,
            seen.entry or "",
            seen.reverses or "",
            _as_text(seen.description),
            line.account,
            _as_text(account.name if account else line.account),
            line.amount,
            line.currency,
            _as_text(one.category or ""),
            _as_text(one.payment_method or ""),
            _as_text(" ".join(seen.tags)),
        )


def _as_text(text: str) -> str:
    """Return somebody's text so that a spreadsheet takes it for text: what it would compute gets an apostrophe."""
    return f"'{text}" if text.startswith(_FORMULA) else text


def _as_lines(rows: Iterable[Iterable[str]]) -> str:
    out = io.StringIO()
    csv.writer(out, lineterminator="\r\n").writerows(rows)
    return out.getvalue()
