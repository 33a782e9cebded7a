"""The answers the gateway gives in its own name: problems, and whether it is alive and ready.

Everything here is made from texts in memory, because it is needed exactly when nothing else works. The
health answers say in their status all that a machine needs; the body is for the person who looks.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from email.utils import formatdate
from http import HTTPStatus

from frontend.catalogue_gateway import PROBLEMS
from frontend.render import language
from hardcore.crisis.heads import ALLOW, AnswerHead, Header
from hardcore.crisis.problems import RETRY_AFTER_S, STATUS, Outcome, Problem


@dataclass(frozen=True, slots=True)
class Answer:
    """A whole answer: head and body."""

    head: AnswerHead
    body: bytes


def _answer(status: int, kind: bytes, body: bytes, extra: Sequence[Header] = ()) -> Answer:
    headers = (
        (b"Date", formatdate(usegmt=True).encode()),
        (b"Content-Type", kind),
        (b"Cache-Control", b"no-store"),
        (b"X-Content-Type-Options", b"nosniff"),
        *extra,
    )
    return Answer(AnswerHead(status, HTTPStatus(status).phrase.encode(), headers, len(body)), body)


def problem(what: Problem, accept_language: str, outcome: Outcome | None = None) -> Answer:
    """The answer for a problem, in the language its reader asked for."""
    tongue = language(accept_language)
    title, detail = PROBLEMS[what][tongue]
    status = STATUS[what]
    fields: dict[str, object] = {
        "type": f"/problems/{what}",
        "title": title,
        "status": status,
        "detail": detail,
    }
    extra = [(b"Content-Language", tongue.encode()), (b"Vary", b"Accept-Language")]
    if outcome is not None:
        fields["outcome"] = outcome
    if (seconds := RETRY_AFTER_S.get(what)) is not None:
        fields["retry_after"] = seconds
        extra.append((b"Retry-After", b"%d" % seconds))
    if what is Problem.METHOD_NOT_ALLOWED:
        extra.append((b"Allow", ALLOW.encode()))
    body = json.dumps(fields, ensure_ascii=False).encode()
    return _answer(status, b"application/problem+json", body, extra)


def stored(status: int, answer: object) -> Answer:
    """The answer that the ledger keeps under a key, as it would have been given the first time."""
    body = json.dumps(answer, ensure_ascii=False, separators=(",", ":")).encode()
    kind = b"application/problem+json" if status >= 400 else b"application/json"
    return _answer(status, kind, body, [(b"Idempotent-Replayed", b"true")])


def live(*, heard: bool) -> Answer:
    """Whether the guard is alive: this process, and a sentinel that was heard lately."""
    extra = [] if heard else [(b"Retry-After", b"1")]
    body = json.dumps({"alive": heard}).encode()
    return _answer(200 if heard else 503, b"application/json", body, extra)


def ready(state: str, *, serving: bool) -> Answer:
    """Whether traffic may be sent here, and the state that says so."""
    extra = [] if serving else [(b"Retry-After", b"1")]
    body = json.dumps({"ready": serving, "state": state or "UNKNOWN"}).encode()
    return _answer(200 if serving else 503, b"application/json", body, extra)
