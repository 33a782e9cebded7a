"""The answers the gateway gives in its own name: problems, pages, its files, and whether it is alive and ready.

Everything here is made from texts in memory, because it is needed exactly when nothing else works. The
health answers say in their status all that a machine needs; the body is for the person who looks. Whoever waits
before a tab gets a page; a program gets the same facts as problem+json.
"""

import html
import json
import re
from collections.abc import Sequence
from email.utils import formatdate
from http import HTTPStatus
from typing import Final, assert_never
from urllib.parse import urlsplit

import msgspec
from msgspec import structs

from frontend.catalogue_gateway import DOUBTFUL, NUMBER, PROBLEMS
from frontend.render import language
from hardcore.crisis.heads import ALLOW, AnswerHead, Header, RequestHead
from hardcore.crisis.problems import RETRY_AFTER_S, STATUS, Outcome, Problem
from hardcore.crisis.quarantine import Refusal, SetAside, Stopped
from hardcore.crisis.receipts_form import KeptForm, hidden_fields
from hardcore.crisis.shelf import FIELDS_MARK, HTML, Sheet


class Answer(msgspec.Struct, frozen=True):
    """A whole answer: head and body."""

    head: AnswerHead
    body: bytes


#: So many characters of a key, or of a letter's number, are its number for people.
NUMBER_CHARACTERS: Final = 8
#: Of the page that is shown when none was rendered: it needs nothing but itself.
_PLAIN_POLICY = "default-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
_PLAIN = (
    '<!doctype html><html lang="{lang}"><head><meta charset="utf-8">'
    '<meta name="viewport" content="width=device-width"><meta name="color-scheme" content="light dark">'
    "{again}<title>{title}</title></head><body><h1>{title}</h1><p>{detail}</p></body></html>"
)


def whole(
    status: int, kind: bytes, body: bytes, extra: Sequence[Header] = (), *, kept: bytes = b"no-store"
) -> Answer:
    """A whole answer of our own. `kept`: what a cache may do with it."""
    headers = (
        (b"Date", formatdate(usegmt=True).encode()),
        (b"Content-Type", kind),
        (b"Cache-Control", kept),
        (b"X-Content-Type-Options", b"nosniff"),
        *extra,
    )
    length = None if status == 304 else len(body)
    return Answer(AnswerHead(status, HTTPStatus(status).phrase.encode(), headers, length), body)


def problem(
    what: Problem,
    accept_language: str,
    outcome: Outcome | None = None,
    *,
    again_s: int | None = None,
    **more: str,
) -> Answer:
    """The answer for a problem, in the language its reader asked for; `again_s`: when to come again, where it is not
    as usual; `more` are further fields.
    """
    tongue = language(accept_language)
    title, detail = _words(what, tongue, outcome)
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
    fields |= more
    if (seconds := again_s or RETRY_AFTER_S.get(what)) is not None:
        fields["retry_after"] = seconds
        extra.append((b"Retry-After", b"%d" % seconds))
    if what is Problem.METHOD_NOT_ALLOWED:
        extra.append((b"Allow", ALLOW.encode()))
    body = json.dumps(fields, ensure_ascii=False).encode()
    return whole(status, b"application/problem+json", body, extra)


def with_headers(answer: Answer, extra: Sequence[Header]) -> Answer:
    """The same answer, and these headers."""
    return Answer(structs.replace(answer.head, headers=(*answer.head.headers, *extra)), answer.body)


def elsewhere(to: str, extra: Sequence[Header] = ()) -> Answer:
    """Lead a tab to another page of ours, which it asks for with GET."""
    return whole(303, b"text/plain", b"", [(b"Location", to.encode("ascii", "replace")), *extra])


def _words(what: Problem, tongue: str, outcome: Outcome | None) -> tuple[str, str]:
    """What a problem is called, and what it says; other words for some of which nobody knows whether it was done."""
    doubtful = DOUBTFUL.get(what) if outcome is Outcome.UNKNOWN else None
    return (doubtful or PROBLEMS[what])[tongue]


def plain(what: Problem, head: RequestHead, number: str = "", outcome: Outcome | None = None) -> Answer:
    """A problem as a bare page. One that only reads comes back by itself; nothing is ever sent again. `number`: of
    what was set aside.
    """
    tongue = language(head.accept_language)
    title, detail = (html.escape(words) for words in _words(what, tongue, outcome))
    seconds = RETRY_AFTER_S.get(what)
    again = f'<meta http-equiv="refresh" content="{seconds}">' if head.safe and seconds else ""
    if number:
        detail = f"{detail}</p><p>{html.escape(NUMBER[tongue].format(id=number))}"
    body = _PLAIN.format(lang=tongue, again=again, title=title, detail=detail).encode()
    return whole(STATUS[what], HTML, body, _of_a_page(tongue, _PLAIN_POLICY, what))


def barred(refusal: Refusal, head: RequestHead, outcome: Outcome) -> Answer:
    """A request that the quarantine refuses: to a program with the letter's whole number, to a tab with its end."""
    match refusal:
        case Stopped(for_s=for_s):
            if head.navigation:
                return plain(Problem.SOURCE_STOPPED, head, outcome=outcome)
            return problem(Problem.SOURCE_STOPPED, head.accept_language, outcome, again_s=for_s)
        case SetAside(letter=letter):
            if head.navigation:
                return plain(Problem.SET_ASIDE, head, letter[-NUMBER_CHARACTERS:], outcome)
            return problem(Problem.SET_ASIDE, head.accept_language, outcome, letter=letter)
        case _:
            assert_never(refusal)


def recovery(sheet: Sheet, what: Problem, head: RequestHead, form: KeptForm | None = None) -> Answer:
    """The recovery page on the URL that was asked for. `form`: the wish that it offers to keep."""
    extra = _of_a_page(language(head.accept_language), sheet.policy, what)
    way = way_back(head)
    if form is None and (head.safe or way is None):
        body = _packed(sheet, head, extra)
    else:
        # Uncompressed, because it is this reader's alone; the address and the form's wish are all that differs.
        body = sheet.plain.replace(b'<a href="/">', b'<a href="%s">' % html.escape(way or "/").encode())
        body = body if form is None else body.replace(FIELDS_MARK, hidden_fields(form))
    return whole(STATUS[what], sheet.kind, body, extra)


def way_back(head: RequestHead) -> str | None:
    """The page of ours that a form was sent from, as far as the browser says it."""
    told = [value for name, value in head.headers if name.lower() == b"referer"]
    if len(told) != 1:
        return None
    try:
        parts = urlsplit(told[0].decode("ascii"))
    except ValueError:
        return None
    ours = parts.netloc.lower() == head.host.decode("ascii", "replace").lower()
    if parts.scheme not in {"http", "https"} or not ours or not re.match(r"/(?![/\\])", parts.path):
        return None
    return parts.path + (f"?{parts.query}" if parts.query else "")


def _of_a_page(tongue: str, policy: str, what: Problem | None = None) -> list[Header]:
    """The headers of a page of our own."""
    extra: list[Header] = [
        (b"Content-Language", tongue.encode()),
        (b"Content-Security-Policy", policy.encode()),
        (b"Referrer-Policy", b"same-origin"),
    ]
    if what in RETRY_AFTER_S:
        extra.append((b"Retry-After", b"%d" % RETRY_AFTER_S[what]))
    return extra


def _packed(sheet: Sheet, head: RequestHead, extra: list[Header]) -> bytes:
    """The sheet as this client can read it; what it is packed in is added to `extra`."""
    if not head.gzip:
        return sheet.plain
    extra.append((b"Content-Encoding", b"gzip"))
    return sheet.zipped


def filled(sheet: Sheet, head: RequestHead, body: bytes, status: int = 200) -> Answer:
    """A page of the gateway's own with what is this reader's alone put into it, as `body`."""
    return whole(status, sheet.kind, body, _of_a_page(language(head.accept_language), sheet.policy))


def own_page(sheet: Sheet, head: RequestHead) -> Answer:
    """A page of the gateway's own, as it always is."""
    extra = _of_a_page(language(head.accept_language), sheet.policy)
    body = _packed(sheet, head, extra)
    return whole(200, sheet.kind, body, extra)


def own_file(sheet: Sheet, head: RequestHead) -> Answer:
    """A file of the gateway's own; 304 if the client has it. It is asked for anew each time, and cheaply."""
    tag = f'"{sheet.tag}{"-gz" if head.gzip else ""}"'.encode()
    extra: list[Header] = [
        (b"ETag", tag),
        (b"Vary", b"Accept-Encoding"),
        (b"Cross-Origin-Resource-Policy", b"same-origin"),
    ]
    known = [value for name, value in head.headers if name.lower() == b"if-none-match"]
    if any(tag in value or value.strip() == b"*" for value in known):
        return whole(304, sheet.kind, b"", extra, kept=b"no-cache")
    body = _packed(sheet, head, extra)
    return whole(200, sheet.kind, body, extra, kept=b"no-cache")


def drill_begun(fault: str) -> Answer:
    """The guard was told, and the core is being broken."""
    return whole(202, b"application/json", json.dumps({"ok": True, "fault": fault}).encode())


def stored(status: int, answer: object) -> Answer:
    """The answer that the ledger keeps under a key, as it would have been given the first time."""
    body = json.dumps(answer, ensure_ascii=False, separators=(",", ":")).encode()
    kind = b"application/problem+json" if status >= 400 else b"application/json"
    return whole(status, kind, body, [(b"Idempotent-Replayed", b"true")])


def stored_for_tab(answer: Answer, head: RequestHead) -> Answer:
    """The same to a tab, which can show no JSON: lead it back to where it came from, or say the ledger's no."""
    if answer.head.status < 400:
        return whole(303, b"text/plain", b"", [(b"Location", (way_back(head) or "/").encode())])
    tongue = language(head.accept_language)
    told = json.loads(answer.body)
    told = told if isinstance(told, dict) else {}
    title, detail = (html.escape(str(told.get(name, ""))) for name in ("title", "detail"))
    body = _PLAIN.format(lang=tongue, again="", title=title, detail=detail).encode()
    return whole(answer.head.status, HTML, body, _of_a_page(tongue, _PLAIN_POLICY))


def live(*, heard: bool, young: bool) -> Answer:
    """Whether the guard is alive: this process, and a sentinel that was heard lately.

    `young`: we are new, and have heard nobody yet; that is no reason to end us, and is said beside it.
    """
    extra = [] if heard or young else [(b"Retry-After", b"1")]
    told = {"alive": heard or young, **({"heard": False} if young and not heard else {})}
    body = json.dumps(told).encode()
    return whole(200 if heard or young else 503, b"application/json", body, extra)


def ready(state: str, *, serving: bool) -> Answer:
    """Whether traffic may be sent here, and the state that says so."""
    extra = [] if serving else [(b"Retry-After", b"1")]
    body = json.dumps({"ready": serving, "state": state or "UNKNOWN"}).encode()
    return whole(200 if serving else 503, b"application/json", body, extra)
