"""The pages of transactions as the books have them: the full form, one transaction, and what may be done with it.

The form is lines of an account and an amount on one of two sides; a line that is left empty is none. It becomes the very body
that a program sends, so every rule stays in one place, and what the ledger says of a line comes back at that line. A table that
adds lines in the browser was not chosen: without a script a person would have no third line.
"""

import functools
from collections.abc import Sequence
from types import MappingProxyType
from typing import Final

import msgspec
from starlette.requests import Request
from starlette.responses import Response

from core.ledger.commands import (
    POSTINGS_MIN,
    PendingPostBody,
    PostingBody,
    ReverseTransaction,
    TransactionBody,
    VoidPending,
    post_pending,
    post_transaction,
)
from core.ledger.reasons import Fault, Reason
from core.web import pages_book
from core.web.asking import accepted, left_out, read, service_of
from core.web.intake import NAMED_MAX
from core.web.pages_answers import reader_of, show
from core.web.pages_book import TransactionPicture
from core.web.pages_forms import Drawn, Form, carry_out, go_on, read_form
from core.web.pages_granting import granted
from core.web.problems import Problem, ProblemError
from frontend.amounts import read_amount

LINES: Final = 10
LINES_SHOWN: Final = 4  # before somebody asks for more
NO_CURRENCY: Final = (
    "XXX"  # of a choice that was none of ours: the ledger says what is wrong with the account
)
NO_AMOUNT: Final = "?"  # what no amount can be: it goes on to the ledger's own check
BLANK: Final = MappingProxyType(
    {
        "description": "", "date": "", "state": "posted",
        **{f"{name}_{at}": "" for at in range(LINES) for name in ("account", "debit", "credit")},
    }
)  # fmt: skip
_SIDES: Final = ("debit", "credit")


class _Line(msgspec.Struct, frozen=True):
    """A line of the form that says something: where it stands there, and the posting it wishes for."""

    at: int
    side: str
    body: PostingBody


async def new_transaction(request: Request) -> Response:
    """GET /transactions/new."""
    values = {**BLANK, "date": reader_of(request).today.isoformat()}
    return await draw_new(request, Drawn(values), 200, None)


async def draw_new(request: Request, form: Drawn, status: int, key: str | None) -> Response:
    """Return the full form in this state."""
    groups = await read(request, "page.accounts", pages_book.account_groups)
    open_ones = [(kind, [one for one in group if not one.closed]) for kind, group in groups]
    used = max((at for at in range(LINES) if form.values[f"account_{at}"]), default=0)
    return show(
        request,
        "transaction_new.html.j2",
        "/register",
        status=status,
        key=key,
        form=form,
        groups=[(kind, group) for kind, group in open_ones if group],
        lines=range(LINES),
        shown=max(LINES_SHOWN, used + 1),
    )


async def write_transaction(request: Request) -> Response:
    """POST /transactions."""
    form = await read_form(request)
    lines = _lines(form)

    async def wish() -> Response:
        _refuse_half_lines(form)
        body = TransactionBody(
            date=form.text("date"),
            description=form.text("description"),
            postings=[line.body for line in lines],
            state=form.text("state") or "posted",
        )
        command = accepted(post_transaction(body, service_of(request).new_id()))
        made = await carry_out(request, form, "transaction.post", command)
        said = "tx_kept_pending" if body.state == "pending" else "tx_saved"
        return go_on(request, f"/transactions/{made['id']}", said, id=made["id"])

    return await granted(request, form, wish, draw_new, BLANK, functools.partial(_at_its_line, lines))


async def transaction(request: Request) -> Response:
    """GET /transactions/{id}."""
    wanted: str = request.path_params["id"]
    question = functools.partial(pages_book.transaction, transaction_id=wanted, parked=left_out(request))
    seen: TransactionPicture | None = await read(request, "page.transaction", question, transaction_id=wanted)
    if seen is None:
        raise ProblemError(Problem("transaction-not-found", values={"transaction": wanted[:NAMED_MAX]}))
    return show(
        request, "transaction.html.j2", "/register", seen=seen.seen, lines=seen.lines, plain=Drawn(BLANK)
    )


async def reverse(request: Request) -> Response:
    """POST /transactions/{id}/reverse."""
    form = await read_form(request)
    wanted: str = request.path_params["id"]

    async def wish() -> Response:
        command = ReverseTransaction(wanted, service_of(request).new_id())
        made = await carry_out(request, form, "transaction.reverse", command)
        return go_on(request, f"/transactions/{made['id']}", "tx_reversed", id=made["id"])

    return await granted(request, form, wish)


async def post(request: Request) -> Response:
    """POST /transactions/{id}/post."""
    form = await read_form(request)
    wanted: str = request.path_params["id"]

    async def wish() -> Response:
        command = accepted(post_pending(wanted, PendingPostBody(), service_of(request).new_id()))
        made = await carry_out(request, form, "pending.post", command)
        return go_on(request, f"/transactions/{made['id']}", "tx_posted", id=made["id"])

    return await granted(request, form, wish)


async def void(request: Request) -> Response:
    """POST /transactions/{id}/void."""
    form = await read_form(request)
    wanted: str = request.path_params["id"]

    async def wish() -> Response:
        await carry_out(request, form, "pending.void", VoidPending(wanted))
        return go_on(request, f"/transactions/{wanted}", "tx_voided", id=wanted)

    return await granted(request, form, wish)


def _lines(form: Form) -> list[_Line]:
    """Return the lines of a form that name an account and an amount, in their order.

    An account's choice says its currency as well (`bank KRW`): a line has both, and the book need not be asked first.
    """
    found: list[_Line] = []
    for at in range(LINES):
        account, _, currency = form.text(f"account_{at}").partition(" ")
        side = next((side for side in _SIDES if form.text(f"{side}_{at}")), None)
        if not account or side is None:
            continue
        amount = read_amount(form.text(f"{side}_{at}")) or NO_AMOUNT
        signed = amount if side == "debit" else f"-{amount}"
        found.append(_Line(at, side, PostingBody(account, signed, currency or NO_CURRENCY)))
    return found


def _refuse_half_lines(form: Form) -> None:
    """End the request where a line says an account without an amount, an amount without an account, or both sides."""
    faults: list[Fault] = []
    said = 0
    for at in range(LINES):
        account = bool(form.text(f"account_{at}"))
        sides = [side for side in _SIDES if form.text(f"{side}_{at}")]
        said += account and bool(sides)
        if len(sides) > 1:
            faults.append(Fault(f"/credit_{at}", Reason.TOO_MANY))
        elif account and not sides:
            faults.append(Fault(f"/debit_{at}", Reason.MISSING))
        elif sides and not account:
            faults.append(Fault(f"/account_{at}", Reason.MISSING))
    if not faults and said < POSTINGS_MIN:
        faults.append(Fault(f"/account_{said}", Reason.MISSING))
    if faults:
        raise ProblemError(Problem("invalid-body", tuple(faults)))


def _at_its_line(lines: Sequence[_Line], problem: Problem) -> Problem:
    """Return a problem whose faults name the fields of the form: a posting's is that of the line it came from."""
    faults = []
    for fault in problem.faults:
        parts = fault.pointer.strip("/").split("/")
        if parts[0] == "postings" and len(parts) > 1 and int(parts[1]) < len(lines):
            line = lines[int(parts[1])]
            field = line.side if parts[-1] == "amount" else "account"
            faults.append(Fault(f"/{field}_{line.at}", fault.reason))
        else:
            faults.append(fault)
    return msgspec.structs.replace(problem, faults=tuple(faults))
