"""What the forms of the pages wish: an entry written, changed or deleted, an account opened or closed, a start.

Each handler turns fields into a body of the API and that into a command, so a form can't wish anything that a
program can't, and every rule is checked in one place. What is wrong comes back at its field, with everything
that was typed still there.
"""

from typing import Final

import msgspec
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response

from core.ledger.accounts import AccountType, is_account_id
from core.ledger.book import ids_for
from core.ledger.commands import (
    AccountBody,
    PostingBody,
    TransactionBody,
    close_account,
    open_account,
    post_transaction,
)
from core.ledger.entries import SEQ_MAX, EntryBody, record_entry, replace_entry, reverse_entry
from core.ledger.money import is_currency
from core.ledger.reasons import Fault, Reason, Slug
from core.web import pages
from core.web.asking import accepted, service_of
from core.web.entries import entry_in_path
from core.web.intake import SEQ_DIGITS_MAX
from core.web.pages_answers import ACCOUNT_COOKIE, LANGUAGE_COOKIE, reader_of, text_for
from core.web.pages_forms import (
    Drawn,
    Form,
    carry_out,
    go_on,
    read_form,
)
from core.web.pages_granting import granted
from core.web.problems import Problem, ProblemError
from frontend.amounts import read_amount, show_amount
from frontend.paper import LANGUAGES, page_text
from frontend.render import Language

YEAR_S: Final = 365 * 24 * 3_600
# What no amount can be: whatever was typed goes on to the ledger's own check, together with the other fields.
NO_AMOUNT: Final = "?"

_SET_ASIDE: Final = frozenset({"set-aside", "account-set-aside"})

#: The accounts of an empty start, by the name of their text. The first is what a form begins with.
EXAMPLES: Final[tuple[tuple[str, AccountType], ...]] = (
    ("example_bank", AccountType.ASSET),
    ("example_cash", AccountType.ASSET),
    ("example_card", AccountType.LIABILITY),
    ("example_salary", AccountType.INCOME),
    ("example_other_income", AccountType.INCOME),
    ("example_food", AccountType.EXPENSE),
    ("example_transport", AccountType.EXPENSE),
    ("example_home", AccountType.EXPENSE),
    ("example_phone", AccountType.EXPENSE),
    ("example_health", AccountType.EXPENSE),
    ("example_leisure", AccountType.EXPENSE),
)


async def write_entry(request: Request) -> Response:
    """POST /entries."""
    form = await read_form(request)

    async def wish() -> Response:
        write = _move if form.text("kind") == "move" else _write
        response = await write(request, form)
        response.set_cookie(
            ACCOUNT_COOKIE, form.text("account"), max_age=YEAR_S, path="/", samesite="lax", httponly=True
        )
        return response

    return await granted(request, form, wish, pages.draw_new_entry, pages.EMPTY_FORM, _of_a_move)


async def _write(request: Request, form: Form) -> Response:
    """Record an entry."""
    command = accepted(record_entry(_entry_body(form), service_of(request).new_id()))
    made = await carry_out(request, form, "entry.record", command)
    much = show_amount(made["amount"], made["currency"], reader_of(request).lang, signed=True)
    what = made["description"] or made["category"] or text_for(request, "no_description")
    undo = {"path": f"/entries/{made['id']}/delete", "seq": made["seq"]}
    return go_on(request, "/", "saved", id=made["id"], about=what, much=much, undo=undo)


async def _move(request: Request, form: Form) -> Response:
    """Book a transaction between two accounts of one's own: no entry, because nothing was spent or earned."""
    command = accepted(post_transaction(_move_body(form), service_of(request).new_id()))
    made = await carry_out(request, form, "transaction.post", command)
    came = next(line for line in made["postings"] if not line["amount"].startswith("-"))
    much = show_amount(came["amount"], came["currency"], reader_of(request).lang)
    what = made["description"] or text_for(request, "entry_move")
    undo = {"path": f"/transactions/{made['id']}/reverse", "seq": None}
    return go_on(request, "/", "saved", id=made["id"], about=what, much=much, undo=undo)


async def change_entry(request: Request) -> Response:
    """POST /entries/{id}."""
    form = await read_form(request)
    entry_id = entry_in_path(request)

    async def wish() -> Response:
        service = service_of(request)
        # The form shows neither: what it does not show, it does not change.
        wish = replace_entry(
            entry_id,
            _entry_body(form),
            service.new_id(),
            service.new_id(),
            expected_seq=_seq_seen(form),
            keeps_the_rest=True,
        )
        command = accepted(wish)
        await carry_out(request, form, "entry.replace", command)
        return go_on(request, "/register", "saved_change", id=entry_id)

    async def redraw(request: Request, drawn: Drawn, status: int, key: str | None) -> Response:
        return await pages.draw_entry(request, await pages.entry_of(request), drawn, status, key)

    return await granted(request, form, wish, redraw, pages.EMPTY_FORM)


async def delete_entry(request: Request) -> Response:
    """POST /entries/{id}/delete: a reversal; nothing leaves the record."""
    form = await read_form(request)
    entry_id = entry_in_path(request)

    async def wish() -> Response:
        command = reverse_entry(entry_id, service_of(request).new_id(), _seq_seen(form))
        await carry_out(request, form, "entry.reverse", command)
        return go_on(request, "/register", "deleted", id=entry_id)

    return await granted(request, form, wish)


async def add_account(request: Request) -> Response:
    """POST /accounts."""
    form = await read_form(request)

    async def wish() -> Response:
        command = accepted(open_account(_account_body(form)))
        made = await carry_out(request, form, "account.open", command)
        return go_on(request, "/accounts", "account_added", id=made["id"])

    return await granted(request, form, wish, pages.draw_accounts, pages.EMPTY_FORM)


async def shut_account(request: Request) -> Response:
    """POST /accounts/{id}/close."""
    form = await read_form(request)
    account_id: str = request.path_params["id"]
    if not is_account_id(account_id):
        raise ProblemError(Problem("not-found"))

    async def wish() -> Response:
        await carry_out(request, form, "account.close", close_account(account_id))
        return go_on(request, "/accounts", "account_closed", id=account_id)

    return await granted(request, form, wish)


async def start(request: Request) -> Response:
    """POST /start: open the example accounts, each under a key of its own made from the form's."""
    form = await read_form(request)
    lang = reader_of(request).lang

    async def wish() -> Response:
        currency = form.text("currency").upper()
        if not is_currency(currency):
            raise ProblemError(Problem("invalid-parameter"))
        for number, (text, kind) in enumerate(EXAMPLES):
            try:
                await _open_example(request, form, f":{number}", page_text(text, lang), kind, currency)
            except ProblemError as error:
                raise ProblemError(_of_a_part(error.problem, number)) from None
        return go_on(request, "/", "account_added")

    return await granted(request, form, wish)


async def choose_language(request: Request) -> Response:
    """POST /language: keep the reader's choice in a cookie and go back to where it was made."""
    form = await read_form(request)
    back = form.text("back")
    # A path of this server and nothing else: "//elsewhere" and "/\elsewhere" would leave it.
    own = (
        back.startswith("/") and not back.startswith(("//", "/\\")) and back.isprintable() and back.isascii()
    )
    response = RedirectResponse(back if own else "/", 303, {"Cache-Control": "no-store"})
    chosen: Language | None = next((lang for lang in LANGUAGES if lang == form.text("lang")), None)
    if chosen is not None:
        response.set_cookie(LANGUAGE_COOKIE, chosen, max_age=YEAR_S, path="/", samesite="lax")
    return response


async def _open_example(
    request: Request, form: Form, part: str, name: str, kind: AccountType, currency: str
) -> None:
    body = AccountBody(ids_for(name, kind, currency)[0], name, kind.value, currency)
    try:
        await carry_out(request, form, "account.open", accepted(open_account(body)), part)
    except ProblemError as error:
        # Pressed twice, or half done before: what is there already is what was wished.
        if error.problem.slug != Slug.ACCOUNT_EXISTS:
            raise


def _of_a_part(problem: Problem, done: int) -> Problem:
    """Return what is told of a form of which so many parts are done: never that it was not.

    Where the same form may be sent again its key sees to the rest, and nothing else need be said.
    """
    return (
        msgspec.structs.replace(problem, slug="partly-done")
        if done and problem.slug in _SET_ASIDE
        else problem
    )


def _seq_seen(form: Form) -> int | None:
    """Return the `seq` of the entry that the form showed, None where it says none."""
    text = form.text("expected_seq")
    if not text:
        return None
    if not (text.isascii() and text.isdigit() and len(text) <= SEQ_DIGITS_MAX and int(text) <= SEQ_MAX):
        raise ProblemError(Problem("invalid-body", (Fault("/expected_seq", Reason.MALFORMED),)))
    return int(text)


def _entry_body(form: Form) -> EntryBody:
    amount = read_amount(form.text("amount")) or NO_AMOUNT
    return EntryBody(
        date=form.text("date"),
        amount=amount if form.text("kind") == "in" else f"-{amount}",
        account=form.text("account") or None,
        category=form.text("category") or None,
        description=form.text("description"),
    )


def _move_body(form: Form) -> TransactionBody:
    given = form.text("account")
    taker, _, currency = form.text("to").partition(" ")
    if not taker or taker == given:
        reason = Reason.EXISTS if taker else Reason.MISSING
        raise ProblemError(Problem("invalid-body", (Fault("/to", reason),)))
    amount = read_amount(form.text("amount")) or NO_AMOUNT
    if not amount.strip("0."):
        raise ProblemError(Problem("invalid-body", (Fault("/amount", Reason.ZERO),)))
    lines = [PostingBody(taker, amount, currency), PostingBody(given, f"-{amount}", currency)]
    return TransactionBody(date=form.text("date"), description=form.text("description"), postings=lines)


def _of_a_move(problem: Problem) -> Problem:
    """Return a problem whose faults name the fields of the form: a posting's account is one of two."""
    faults = []
    for fault in problem.faults:
        parts = fault.pointer.strip("/").split("/")
        is_line = parts[0] == "postings" and len(parts) > 1
        field = "amount" if parts[-1] == "amount" else "to" if parts[1:2] == ["0"] else "account"
        faults.append(Fault(f"/{field}", fault.reason) if is_line else fault)
    return msgspec.structs.replace(problem, faults=tuple(faults))


def _account_body(form: Form) -> AccountBody:
    name, kind, currency = form.text("name"), form.text("type"), form.text("currency").upper()
    known = next((one for one in AccountType if one.value == kind), AccountType.ASSET)
    return AccountBody(ids_for(name, known, currency)[0], name, kind, currency)
