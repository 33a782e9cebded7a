"""Problems: everything that is not an answer, in one closed list, told as RFC 9457 in the reader's language.

The list says for each slug its status and, where a request was not simply answered, what is known of its
outcome: `not_done` and `unknown` are promises that programs act on, so they stand in a table and nowhere else.
Inside this package a problem is raised, because it ends a request from any depth; it never leaves the package
as an exception.
"""

from enum import StrEnum
from typing import Any, Final

import msgspec
from starlette.responses import Response

from core.journal.answers import Limited, SetAside, status_of
from core.ledger.reasons import Fault, Rejection, Slug
from core.settings import Settings
from frontend.render import Language, problem_text

PROBLEM_JSON: Final = "application/problem+json"
#: Names the rule that refused: the gateway counts it, and takes it off.
RULE_HEADER: Final = "X-Core-Rule"
TOO_LARGE: Final = 413


class Outcome(StrEnum):
    """What is known of a request that was not simply answered."""

    NOT_DONE = "not_done"
    UNKNOWN = "unknown"


class ProblemKind(msgspec.Struct, frozen=True):
    """A row of the closed list.

    `again`: the same request may well succeed in a moment; `resting`: in some time, and not before somebody or
    something has changed. `draining`: this core did not run it and leaves,
    so whoever stands before it may keep it for the next one.
    """

    status: int
    outcome: Outcome | None = None
    again: bool = False
    draining: bool = False
    resting: bool = False

    def retry_after_s(self, settings: Settings) -> int | None:
        """Return what Retry-After says; None: asking again is of no use."""
        if self.resting:
            return settings.safe_retry_after_s
        return settings.retry_after_s if self.again else None


PROBLEM_KINDS: Final[dict[str, ProblemKind]] = {
    "malformed-json": ProblemKind(400),
    "invalid-key": ProblemKind(400),
    "invalid-parameter": ProblemKind(400),
    "subprotocol-unknown": ProblemKind(400),
    "export-format-unknown": ProblemKind(400),
    "foreign-page": ProblemKind(403),
    "not-found": ProblemKind(404),
    "account-not-found": ProblemKind(404),
    "command-not-found": ProblemKind(404, Outcome.NOT_DONE),
    "import-not-found": ProblemKind(404),
    "malformed-upload": ProblemKind(400),
    "file-too-large": ProblemKind(413),
    "file-unreadable": ProblemKind(422),
    "import-committed": ProblemKind(409),
    "import-mapping": ProblemKind(422),
    "import-without-account": ProblemKind(422),
    "import-format-unknown": ProblemKind(422),
    "import-not-kept": ProblemKind(507),
    "method-not-allowed": ProblemKind(405),
    "body-too-large": ProblemKind(413),
    **{slug.value: ProblemKind(status_of(slug)) for slug in Slug},
    "key-reused": ProblemKind(422),
    "set-aside": ProblemKind(422, Outcome.NOT_DONE),
    "account-set-aside": ProblemKind(422, Outcome.NOT_DONE),
    "partly-done": ProblemKind(422, Outcome.UNKNOWN),
    "limited": ProblemKind(429, Outcome.NOT_DONE),
    "internal": ProblemKind(500),
    "busy": ProblemKind(503, Outcome.NOT_DONE, again=True),
    "leaving": ProblemKind(503, Outcome.NOT_DONE, again=True, draining=True),
    "store-busy": ProblemKind(503, Outcome.NOT_DONE, again=True),
    "safe-mode": ProblemKind(503, Outcome.NOT_DONE, resting=True),
    "store-unreadable": ProblemKind(503, again=True),
    "read-too-long": ProblemKind(503),
    "outcome-unknown": ProblemKind(503, Outcome.UNKNOWN),
}


class Problem(msgspec.Struct, frozen=True):
    """One problem: its slug, the fields at fault, the values its sentence names.

    `outcome` and `status` override the table's where the place of the fault decides it (our own bug, before or after
    the writer was asked; what is taken too often, or is too large); `headers` are added to the response,
    `extra` members to its body.
    """

    slug: str
    faults: tuple[Fault, ...] = ()
    values: dict[str, Any] = {}
    outcome: Outcome | None = None
    headers: dict[str, str] = {}
    extra: dict[str, Any] = {}
    status: int | None = None

    @property
    def told_status(self) -> int:
        """The status it is told with."""
        return self.status or PROBLEM_KINDS[self.slug].status


class ProblemError(Exception):
    """Ends a request with a problem."""

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem.slug)
        self.problem = problem


def refusal(rejection: Rejection, *, replayed: bool = False) -> Problem:
    """Return the problem that tells a rejection of the ledger."""
    headers = {"Idempotent-Replayed": "true"} if replayed else {}
    return Problem(rejection.slug.value, rejection.faults, dict(rejection.values), headers=headers)


def safe_mode(reason: str, outcome: Outcome | None = None) -> Problem:
    """Return the problem of a write that comes while only reads are served, because of the diagnosis `reason`."""
    return Problem("safe-mode", values={"why": reason}, outcome=outcome, extra={"safe": reason})


def set_aside(refused: SetAside) -> Problem:
    """Return the problem of what the guard has set aside, or of an account of which it has."""
    letter = refused.letter
    named = {"letter": letter} if refused.account is None else {"letter": letter, "account": refused.account}
    slug = "set-aside" if refused.account is None else "account-set-aside"
    return Problem(slug, values=dict(named), headers={RULE_HEADER: letter}, extra=dict(named))


def limited(refused: Limited) -> Problem:
    """Return the problem of what a rule takes no more of: too many of them, or one that is too large."""
    headers, extra = {RULE_HEADER: refused.rule}, {"rule": refused.rule}
    if refused.again_s is None:
        return Problem(
            "limited", values={"rule": refused.rule}, headers=headers, extra=extra, status=TOO_LARGE
        )
    return Problem(
        "limited",
        values={"rule": refused.rule},
        headers={**headers, "Retry-After": str(refused.again_s)},
        extra={**extra, "retry_after": refused.again_s},
    )


def problem_json(problem: Problem, lang: Language, settings: Settings) -> dict[str, Any]:
    """Return the members of a problem's body."""
    kind = PROBLEM_KINDS[problem.slug]
    title, detail = problem_text(problem.slug, lang, **problem.values)
    outcome = problem.outcome or kind.outcome
    body: dict[str, Any] = {
        "type": f"/problems/{problem.slug}",
        "title": title,
        "status": problem.told_status,
        "detail": detail,
    }
    if outcome is not None:
        body["outcome"] = outcome.value
    if problem.faults:
        body["errors"] = [
            {"pointer": fault.pointer, "reason": fault.reason.value} for fault in problem.faults
        ]
    retry_after_s = kind.retry_after_s(settings)
    if retry_after_s is not None:
        body["retry_after"] = retry_after_s
    return {**body, **problem.extra}


def headers_of(problem: Problem, settings: Settings) -> dict[str, str]:
    """Return the headers by which a problem says what may be done about it."""
    kind = PROBLEM_KINDS[problem.slug]
    headers = dict(problem.headers)
    retry_after_s = kind.retry_after_s(settings)
    if retry_after_s is not None:
        headers["Retry-After"] = str(retry_after_s)
    if kind.draining:
        headers["X-Core-Draining"] = "1"
    return headers


def respond(problem: Problem, lang: Language, settings: Settings) -> Response:
    """Return the response that tells a problem."""
    headers = {"Content-Language": lang, "Vary": "Accept-Language", **headers_of(problem, settings)}
    body = msgspec.json.encode(problem_json(problem, lang, settings))
    return Response(body, problem.told_status, headers, media_type=PROBLEM_JSON)
