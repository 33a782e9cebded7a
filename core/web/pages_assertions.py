"""What the bank says: the form beside an account's register, which holds the book against a balance of a day.

People say a balance as the bank's letter does: what there is, or what is owed, without a sign that means an accountant's side.
"""

from types import MappingProxyType
from typing import Final

from starlette.requests import Request
from starlette.responses import Response

from core.ledger.accounts import is_account_id
from core.ledger.commands import AssertionBody, assert_balance
from core.web import pages
from core.web.asking import accepted, service_of
from core.web.pages_forms import Drawn, carry_out, go_on, read_form
from core.web.pages_granting import granted
from core.web.problems import Problem, ProblemError
from frontend.amounts import read_amount

BLANK: Final = MappingProxyType({"date": "", "amount": ""})
NO_AMOUNT: Final = "?"  # what no amount can be: it goes on to the ledger's own check


async def say_balance(request: Request) -> Response:
    """POST /accounts/{id}/balance."""
    form = await read_form(request)
    account_id: str = request.path_params["id"]
    if not is_account_id(account_id):
        raise ProblemError(Problem("not-found"))

    async def wish() -> Response:
        typed = form.text("amount")
        amount = read_amount(typed.lstrip("-−")) or NO_AMOUNT
        below = typed.startswith(("-", "−"))
        body = AssertionBody(account_id, form.text("date"), f"-{amount}" if below else amount)
        command = accepted(assert_balance(body, service_of(request).new_id()))
        made = await carry_out(request, form, "balance.assert", command)
        said = "bank_agrees" if made["holds"] else "bank_differs"
        return go_on(request, f"/register?account={account_id}", said, id=made["id"])

    async def redraw(request: Request, drawn: Drawn, status: int, key: str | None) -> Response:
        return await pages.draw_register(request, {"account": account_id}, drawn, status, key)

    return await granted(request, form, wish, redraw, BLANK)
