"""What a page's form says, and what it is told: one reading for a browser alone and for the page's script.

A form is posted to one address in both cases, with the same fields. Without a script its key stands in a hidden
field and the answer is another page (303, or the same form with its faults); with one the key comes in the header
and the answer is JSON that says what to show and where to go. The wish itself becomes a command of the ledger, and
from there on nothing differs from the API. Forms have a handful of short fields, so `urllib` reads them.
"""

import urllib.parse
from collections.abc import Mapping
from typing import Any, Final

import msgspec
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response

from core.guarded.poison import name_of
from core.ledger.commands import Command, accounts_of, transaction_of
from core.ledger.reasons import Fault
from core.web.asking import respond_with, service_of, working
from core.web.intake import check_key, digest_of, idempotency_key, read_body, request_name
from core.web.pages_answers import reader_of, tell_script, text_for
from core.web.problems import Problem, ProblemError
from frontend.catalogue_pages import TEXTS

FORM_BYTES_MAX: Final = 64 << 10
FIELDS_MAX: Final = 40
KEY_FIELD: Final = "_idempotency_key"
_NUMBERS: Final = "_0123456789"  # behind the name of a field that stands in several lines


class Form(msgspec.Struct, frozen=True):
    """A form as it was sent: its key, its fields (the last of equal names wins), and its bytes."""

    key: str | None
    fields: Mapping[str, str]
    body: bytes

    def text(self, name: str) -> str:
        """Return a field, empty if it was not sent."""
        return self.fields.get(name, "")


class Drawn(msgspec.Struct, frozen=True):
    """A form as a template shows it: its values by name, a sentence for each field at fault, and one for all."""

    values: Mapping[str, str]
    faults: Mapping[str, str] = {}
    said: str = ""
    wrong: bool = False

    def __getattr__(self, name: str) -> str:
        """Return a value by its field's name."""
        try:
            return self.values[name]
        except KeyError:
            raise AttributeError(name) from None


async def read_form(request: Request) -> Form:
    """Return the form in the body, or end the request."""
    body = await read_body(request, FORM_BYTES_MAX)
    try:
        pairs = urllib.parse.parse_qsl(
            body.decode("utf-8"), keep_blank_values=True, max_num_fields=FIELDS_MAX, errors="strict"
        )
    except ValueError:  # UnicodeDecodeError is one too
        raise ProblemError(Problem("invalid-body")) from None
    fields = {name: value.strip() for name, value in pairs}
    given = fields.pop(KEY_FIELD, "")
    key = idempotency_key(request) or (check_key(given) if given else None)
    return Form(key, fields, body)


async def carry_out(
    request: Request, form: Form, kind: str, command: Command, part: str = ""
) -> dict[str, Any]:
    """Carry a command out under the form's key and return the ledger's answer, or end the request with its no.

    `part` tells several commands of one form apart. Each is noted under the form's own key, because that is the
    name by which whoever sent the form, and may send it again, knows a suspect.
    """
    service = service_of(request)
    key = form.key + part if form.key is not None else None
    command_id = service.new_id()
    name = name_of(form.key) if form.key is not None else request_name(request)
    with working(
        request,
        kind,
        form.body,
        key=form.key,
        name=name,
        command_id=command_id,
        transaction_id=transaction_of(command),
        account_ids=accounts_of(command),
    ) as held:
        answer = await service.carry_out(
            command,
            key,
            digest_of(request, form.body),
            command_id,
            held.slot,
            kind=kind,
            name=name,
            body_bytes=len(form.body),
        )
        response = respond_with(request, answer)
        held.status = response.status_code
    told: dict[str, Any] = msgspec.json.decode(response.body)
    return told


def from_script(request: Request) -> bool:
    """Whether a script of the page asks, and shows the answer itself."""
    return "application/json" in request.headers.get("accept", "")


def go_on(request: Request, location: str, said: str, **told: Any) -> Response:
    """Return what follows a wish that was carried out. `said` names the text that tells it."""
    if from_script(request):
        body = {"location": location, "said": text_for(request, said), **told}
        headers = {"Cache-Control": "no-store"}
        return Response(msgspec.json.encode(body), 201, headers, media_type="application/json")
    return RedirectResponse(location, 303, {"Cache-Control": "no-store"})


def refuse_script(request: Request, problem: Problem) -> Response:
    """Return a no to the page's script."""
    return tell_script(request, problem, sentences(request, problem.faults))


def sentences(request: Request, faults: tuple[Fault, ...]) -> dict[str, str]:
    """Return a sentence for each field at fault: the one for this field, else for this reason, else a plain one."""
    lang = reader_of(request).lang
    told: dict[str, str] = {}
    for fault in faults:
        name = fault.pointer.strip("/").partition("/")[0]
        reason = fault.reason.value
        known = next(
            one
            for one in (f"fault_{name.rstrip(_NUMBERS)}_{reason}", f"fault_{reason}", "fault_other")
            if one in TEXTS
        )
        told.setdefault(name, TEXTS[known][lang])
    return told
