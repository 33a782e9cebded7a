"""The page of plans: what a month is meant to cost, and what comes back by itself.

Three forms on one page (a budget, a recurring entry, the end of one), each with fields of its own names, so that a fault of
one never stands at another. They make the bodies of the API. What comes back as a whole transaction is shown here and
written over the API: a form for it would be the full form once more, for the few who would use it.
"""

from functools import partial
from types import MappingProxyType
from typing import Final

import msgspec
from starlette.requests import Request
from starlette.responses import Response

from core.ledger.budgets import BudgetLine
from core.ledger.fields import is_date
from core.ledger.planning import set_budget, set_recurring
from core.ledger.plans import BudgetBody, EndRecurring, EntryTemplate, RecurringBody
from core.ledger.reasons import Fault
from core.ledger.recurrence import Rule, Unit
from core.web import pages_book
from core.web.asking import accepted, left_out, read, service_of
from core.web.entries import days_of
from core.web.pages_answers import reader_of, show
from core.web.pages_forms import Drawn, carry_out, go_on, read_form
from core.web.pages_granting import granted
from core.web.problems import Problem, ProblemError
from frontend.amounts import group_digits, read_amount

NO_AMOUNT: Final = "?"  # what no amount can be: it goes on to the ledger's own check
EVERY_DIGITS_MAX: Final = 4
BLANK: Final = MappingProxyType(
    {
        "budget_account": "", "budget_amount": "", "title": "", "kind": "out", "money": "", "from": "", "category": "",
        "unit": "month", "every": "1", "start": "", "end": "",
    }
)  # fmt: skip
#: Where the API speaks of a field, and what it is called in the forms.
_FIELDS: Final = MappingProxyType(
    {
        "/account": "budget_account", "/amount": "budget_amount", "/title": "title", "/entry/amount": "money",
        "/entry/account": "from", "/entry/category": "category", "/rule/every": "every", "/rule/unit": "every",
        "/start": "start", "/end": "end",
    }
)  # fmt: skip


async def plans(request: Request) -> Response:
    """GET /plans."""
    return await draw_plans(
        request, Drawn({**BLANK, "start": reader_of(request).today.isoformat()}), 200, None
    )


async def draw_plans(request: Request, form: Drawn, status: int, key: str | None) -> Response:
    """Return the page of plans with this state of its forms."""
    today = reader_of(request).today
    month = _month(request) or f"{today:%Y-%m}"
    first, last = days_of(month)
    question = partial(
        pages_book.plans, month=month, days=(first, last), today=today, parked=left_out(request)
    )
    seq = service_of(request).head_seq
    seen = await read(request, "page.plans", question)
    return show(
        request,
        "plans.html.j2",
        "/plans",
        status=status,
        key=key,
        seq=seq,
        form=form,
        plain=Drawn(BLANK),
        month_shown=month,
        budgets=[(line, bar_of(line), group_digits(line.amount)) for line in seen.budgets],
        free=seen.free,
        items=seen.items,
        accounts=seen.money_accounts,
        categories=seen.categories,
        units=[unit.value for unit in Unit],
    )


async def budget(request: Request) -> Response:
    """POST /plans/budgets: an empty amount means nothing any more."""
    form = await read_form(request)
    month = form.text("month")
    if not is_date(f"{month}-01"):
        raise ProblemError(Problem("invalid-parameter"))

    async def wish() -> Response:
        typed = form.text("budget_amount")
        amount = (read_amount(typed) or NO_AMOUNT) if typed else None
        command = accepted(set_budget(BudgetBody(form.text("budget_account"), amount), month))
        await carry_out(request, form, "budget.set", command)
        return go_on(request, f"/plans?month={month}", "budget_saved" if amount else "budget_cleared")

    return await granted(request, form, wish, draw_plans, BLANK, _at_its_field)


async def recurring(request: Request) -> Response:
    """POST /plans/recurring."""
    form = await read_form(request)

    async def wish() -> Response:
        amount = read_amount(form.text("money")) or NO_AMOUNT
        every = form.text("every")
        # The choice of an account says its currency too (`bank KRW`).
        account, _, currency = form.text("from").partition(" ")
        fits = every.isascii() and every.isdigit() and len(every) <= EVERY_DIGITS_MAX
        body = RecurringBody(
            title=form.text("title"),
            rule=Rule(form.text("unit"), int(every) if fits else 0),
            start=form.text("start"),
            end=form.text("end") or None,
            entry=EntryTemplate(
                amount if form.text("kind") == "in" else f"-{amount}",
                currency=currency or None,
                account=account or None,
                category=form.text("category") or None,
                description=form.text("title"),
            ),
        )
        command = accepted(set_recurring(body, service_of(request).new_id(), is_new=True))
        made = await carry_out(request, form, "recurring.set", command)
        return go_on(request, "/plans", "recurring_saved", id=made["id"])

    return await granted(request, form, wish, draw_plans, BLANK, _at_its_field)


async def one_recurring(request: Request) -> Response:
    """GET /plans/recurring/{id}."""
    wanted: str = request.path_params["id"]
    question = partial(
        pages_book.recurring, item_id=wanted, today=reader_of(request).today, parked=left_out(request)
    )
    seen = await read(request, "page.recurring", question, transaction_id=wanted)
    if seen is None:
        raise ProblemError(Problem("recurring-not-found"))
    return show(request, "recurring.html.j2", "/plans", item=seen, plain=Drawn(BLANK))


async def end_recurring(request: Request) -> Response:
    """POST /plans/recurring/{id}/end."""
    form = await read_form(request)
    wanted: str = request.path_params["id"]

    async def wish() -> Response:
        await carry_out(request, form, "recurring.end", EndRecurring(wanted))
        return go_on(request, "/plans", "recurring_ended", id=wanted)

    return await granted(request, form, wish)


def bar_of(line: BudgetLine) -> int:
    """Return how far a bar goes, of a hundred; nothing was meant: it is full as soon as anything was spent."""
    if line.used_percent is None:
        return 100 if line.left.startswith("-") else 0
    return round(min(max(line.used_percent, 0.0), 100.0))


def _month(request: Request) -> str | None:
    given = request.query_params.get("month", "")
    if given and not is_date(f"{given}-01"):
        raise ProblemError(Problem("not-found"))
    return given or None


def _at_its_field(problem: Problem) -> Problem:
    faults = tuple(
        Fault(f"/{_FIELDS.get(fault.pointer, fault.pointer.strip('/'))}", fault.reason)
        for fault in problem.faults
    )
    return msgspec.structs.replace(problem, faults=faults)
