"""What a form's wish comes to: what follows it, or its no, in the words and at the fields of the form.

One way for all forms. A script is told as JSON and shows it itself; a browser alone gets the form again with everything
that was typed, each fault at its field and what concerns none of them below. A form that an answer is still owed for keeps
its key, so that sending it again can't do it twice.
"""

from collections.abc import Awaitable, Callable, Mapping
from typing import Final

import msgspec
from starlette.requests import Request
from starlette.responses import Response

from core.ledger.reasons import Fault, Slug
from core.web.pages_answers import reader_of, show_problem
from core.web.pages_forms import Drawn, Form, from_script, refuse_script, sentences
from core.web.problems import RULE_HEADER, Problem, ProblemError
from frontend.paper import page_text
from frontend.render import problem_text

_GONE: Final = frozenset({Slug.ENTRY_NOT_FOUND, Slug.ENTRY_REVERSED})  # there is no form to show again

Redraw = Callable[[Request, Drawn, int, str | None], Awaitable[Response]]


def _at_its_field(problem: Problem) -> Problem:
    # People give names; the id is ours, made of the name. What a form has seen is no field of anybody.
    faults = tuple(
        Fault("/name", fault.reason) if fault.pointer == "/id" else fault
        for fault in problem.faults
        if fault.pointer != "/expected_seq"
    )
    return msgspec.structs.replace(problem, faults=faults)


async def granted(
    request: Request,
    form: Form,
    wish: Callable[[], Awaitable[Response]],
    redraw: Redraw | None = None,
    blank: Mapping[str, str] | None = None,
    at_its_field: Callable[[Problem], Problem] = _at_its_field,
) -> Response:
    """Return what the wish gives, or its no: to a script as JSON, else as the form with its faults.

    `redraw` draws the form again, of which `blank` has all fields; None: the no is a page of its own.
    """
    try:
        return await wish()
    except ProblemError as error:
        problem = at_its_field(error.problem)
        if from_script(request):
            return refuse_script(request, problem)
        response = show_problem(request, problem)
        if redraw is None or blank is None or problem.slug in _GONE:
            return response
        lang = reader_of(request).lang
        _title, detail = problem_text(problem.slug, lang, **problem.values)
        if problem.slug == "safe-mode":
            detail = f"{detail} {page_text('safe_kept', lang)}"
        faults = sentences(request, problem.faults)
        at_a_field = any(name in blank for name in faults)
        drawn = Drawn({**blank, **form.fields}, faults, "" if at_a_field else detail, wrong=True)
        unanswered = response.status_code >= 500
        drawn_page = await redraw(request, drawn, response.status_code, form.key if unanswered else None)
        for name in ("retry-after", "x-core-draining", RULE_HEADER):
            if name in response.headers:
                drawn_page.headers[name] = response.headers[name]
        return drawn_page
