"""The page of one dead letter, and everything a person may do with it.

The dry run is the button that stands first, because it changes nothing. A retry says before whether a dry run went
well lately, and without one it has to be said twice. Discarding needs a reason, and is a mark that stays visible.
"""

import json
from collections.abc import Awaitable, Mapping
from datetime import UTC, datetime, timedelta
from typing import Any, Final

from starlette.requests import Request
from starlette.responses import Response

from frontend.admin_paper import knows, shortened
from postmortem.dead_letters.masking import shown
from postmortem.dead_letters.ordeals import was_refused
from postmortem.reports.evidence_words import command_word
from postmortem.views import DryRun, Letter, LetterState, Refusal
from postmortem.web.letters import HERE, REASON_CHARACTERS_MAX, reason_words
from postmortem.web.lobby import Lobby, Question, field, is_sure, lead_to, reader_of, words_of
from postmortem.wording import is_said

NOTE_CHARACTERS_MAX: Final = 2_000
PAYLOAD_SHOWN_CHARACTERS_MAX: Final = 4_000
PAYLOAD_FIELDS_MAX: Final = 40
POSTINGS_SHOWN_MAX: Final = 50
FRESH: Final = timedelta(minutes=10)
#: What may be done in which state; the table of a letter's life decides, these are only the buttons.
_OFFERED: Final[Mapping[LetterState, tuple[str, ...]]] = {
    LetterState.QUARANTINED: ("dry-run", "retry", "requeue", "hold", "discard"),
    LetterState.HELD: ("dry-run", "retry", "discard"),
    LetterState.RETRYING: (),
    LetterState.RESOLVED: (),
    LetterState.DISCARDED: (),
}
_ASKED_FIRST: Final = frozenset({"retry", "requeue", "discard", "correct"})
_VERBS: Final = ("dry-run", "retry", "requeue", "hold", "discard", "undo", "note", "correct")
#: What is changed by hand fits a form; a larger request is sent anew by whoever made it.
CORRECTED_CHARACTERS_MAX: Final = 12_000
_TEXT_MAX: Final[Mapping[str, int]] = {"note": NOTE_CHARACTERS_MAX, "correct": CORRECTED_CHARACTERS_MAX}


async def letter(lobby: Lobby, request: Request) -> Response:
    """GET /admin/dlq/{id}."""
    found = await lobby.read(lambda: lobby.reads.letter(request.path_params["id"]))
    return lobby.lost(request, HERE, HERE) if found is None else _show(lobby, request, found, shown(found))


async def reveal(lobby: Lobby, request: Request) -> Response:
    """POST /admin/dlq/{id}/reveal: the same page with the masked values, once it is written down."""
    form = await lobby.form(request)
    if isinstance(form, Response):
        return form
    found = await lobby.read(lambda: lobby.reads.letter(request.path_params["id"]))
    if found is None:
        return lobby.lost(request, HERE, HERE)
    await lobby.places.write_down("reveal", f"letter {found.id}", "", "shown")
    return _show(lobby, request, found, found)


def _show(lobby: Lobby, request: Request, kept: Letter, found: Letter) -> Response:
    """Return the page of a letter. `found`: `kept` as it may be seen."""
    words = words_of(request)
    whole = payload_text(found)
    step = f"next_{found.reason}"
    refused = found.dry_run is not None and was_refused(found.dry_run)
    return lobby.show(
        request,
        "letter.html.j2",
        HERE,
        letter=found,
        kind=command_word(found.kind, reader_of(request).lang),
        reason=reason_words(words, found.reason),
        next=words("next_refused" if refused else step if knows(step) else "next_other"),
        would_fail=refused,
        answer=_answer_text(found.dry_run),
        fields=_fields(found.payload),
        postings=_postings(found.payload),
        is_masked=found != kept,
        # What is hidden can't be sent again as it was.
        to_correct=_to_correct(found, whole) if found.payload == kept.payload else "",
        payload=shortened(whole, PAYLOAD_SHOWN_CHARACTERS_MAX),
        is_cut=len(whole) > PAYLOAD_SHOWN_CHARACTERS_MAX,
        row=shortened(json.dumps(found.row, ensure_ascii=False, indent=1, default=str)) if found.row else "",
        verbs=_OFFERED[found.state],
        asked_first=_ASKED_FIRST,
        may_undo=found.state is LetterState.DISCARDED and request.query_params.get("said") == "discard",
    )


async def payload(lobby: Lobby, request: Request) -> Response:
    """GET /admin/dlq/{id}/payload: all of it, as a file and never as a page, once it is written down."""
    found = await lobby.read(lambda: lobby.reads.letter(request.path_params["id"]))
    if found is None or found.payload is None:
        return lobby.lost(request, HERE, HERE)
    await lobby.places.write_down("payload", f"letter {found.id}", "", "given")
    headers = {
        "Content-Disposition": 'attachment; filename="letter.txt"',
        "Content-Security-Policy": "default-src 'none'; sandbox",
        "X-Content-Type-Options": "nosniff",
        "Cache-Control": "no-store",
    }
    return Response(payload_text(found).encode("utf-8", "replace"), media_type="text/plain", headers=headers)


async def act(lobby: Lobby, request: Request) -> Response:
    """POST /admin/dlq/{id}/{verb}."""
    form = await lobby.form(request)
    if isinstance(form, Response):
        return form
    verb, letter_id = request.path_params["verb"], request.path_params["id"]
    found = await lobby.read(lambda: lobby.reads.letter(letter_id))
    if found is None or verb not in _VERBS:
        return lobby.lost(request, HERE, HERE)
    text = field(form, "text")[: _TEXT_MAX.get(verb, REASON_CHARACTERS_MAX)]
    anyway = field(form, "anyway") == "1"
    if verb in _ASKED_FIRST and (not is_sure(form) or (verb == "discard" and not is_said(text))):
        words = words_of(request)
        if verb == "correct":
            return lobby.ask(request, HERE, _correct_question(words, found, text))
        return lobby.ask(request, HERE, _question(words, found, verb, was_asked=is_sure(form)))
    told = await _doing(lobby, verb, found.id, text, anyway=anyway)
    back = f"{HERE}/{found.id}"
    return lobby.refuse(request, HERE, told, back) if isinstance(told, Refusal) else lead_to(back, verb)


def _answer_text(dry_run: DryRun | None) -> str:
    answer = None if dry_run is None else dry_run.answer
    if not answer:
        return ""
    told = (
        answer if isinstance(answer, str) else json.dumps(answer, ensure_ascii=False, indent=1, default=str)
    )
    return shortened(told)


def payload_text(letter: Letter) -> str:
    """Return a letter's contents as text: JSON over many lines, or what it was."""
    if isinstance(letter.payload, str) or letter.payload is None:
        return letter.payload or ""
    return json.dumps(letter.payload, ensure_ascii=False, indent=1, default=str)


def is_fresh(dry_run: DryRun | None, at: datetime) -> bool:
    """Tell whether a dry run went well within the last ten minutes."""
    if dry_run is None or dry_run.ordeal not in {"survived", "committed"}:
        return False
    try:
        return timedelta(0) <= at - datetime.fromisoformat(dry_run.at) < FRESH
    except (ValueError, TypeError):
        return False


def _doing(
    lobby: Lobby, verb: str, letter_id: str, text: str, *, anyway: bool
) -> Awaitable[Letter | Refusal]:
    acts = lobby.acts
    match verb:
        case "dry-run":
            return acts.dry_run(letter_id)
        case "retry":
            return acts.retry(letter_id, anyway=anyway)
        case "requeue":
            return acts.requeue(letter_id)
        case "hold":
            return acts.hold(letter_id)
        case "discard":
            return acts.discard(letter_id, text)
        case "undo":
            return acts.undo_discard(letter_id)
        case "correct":
            return acts.correct(letter_id, text)
        case _:
            assert verb == "note", verb
            return acts.note(letter_id, text)


def _question(words: Any, letter: Letter, verb: str, *, was_asked: bool) -> Question:
    fresh = is_fresh(letter.dry_run, datetime.now(UTC))
    discards = verb == "discard"
    risky = not discards and not fresh
    lines = [words("letter_number", id=letter.id), words("discard_told" if discards else "retry_told")]
    if not discards:
        lines.append(words("retry_fresh" if fresh else "retry_stale"))
    return Question(
        title=words(f"{verb}_title"),
        action=f"{HERE}/{letter.id}/{verb}",
        sure=words("retry_anyway" if risky and verb == "retry" else f"do_{verb}"),
        back=f"{HERE}/{letter.id}",
        keep=words("keep"),
        lines=lines,
        fields=(("anyway", "1"),) if risky else (),
        typed=("text", words("discard_reason"), REASON_CHARACTERS_MAX) if discards else None,
        fault=words("discard_needs") if was_asked else "",
        harms=discards or risky,
    )


def _correct_question(words: Any, letter: Letter, body: str) -> Question:
    return Question(
        title=words("correct_title"),
        action=f"{HERE}/{letter.id}/correct",
        sure=words("do_correct"),
        back=f"{HERE}/{letter.id}",
        keep=words("keep"),
        lines=(words("letter_number", id=letter.id), words("correct_told")),
        fields=(("text", body),),
    )


def _to_correct(letter: Letter, whole: str) -> str:
    """Return what may be changed by hand and sent instead; empty: this letter is not for that."""
    waits = letter.state in {LetterState.QUARANTINED, LetterState.HELD}
    fits = isinstance(letter.payload, Mapping) and len(whole) <= CORRECTED_CHARACTERS_MAX
    return whole if waits and fits and letter.row is None else ""


def _fields(payload: Any) -> list[tuple[str, str]]:
    """Return the contents as a form would show them: the first fields, each cut; postings have their own table."""
    if not isinstance(payload, Mapping):
        return []
    tabled = {"postings"} if _postings(payload) else set()
    return [
        (
            shortened(name, 64),
            shortened(
                value if isinstance(value, str) else json.dumps(value, ensure_ascii=False, default=str)
            ),
        )
        for name, value in list(payload.items())[:PAYLOAD_FIELDS_MAX]
        if name not in tabled
    ]


def _postings(payload: Any) -> list[tuple[str, str, str]]:
    """Return the account, the amount and the currency of each posting; nothing where one has another shape."""
    given = payload.get("postings") if isinstance(payload, Mapping) else None
    rows = [
        tuple(one.get(name) for name in ("account", "amount", "currency")) if isinstance(one, Mapping) else ()
        for one in (given[:POSTINGS_SHOWN_MAX] if isinstance(given, list) else [])
    ]
    if not all(len(row) == 3 and all(isinstance(cell, str) for cell in row) for row in rows):
        return []
    return [
        (shortened(account, 120), shortened(amount, 60), shortened(currency, 16))
        for account, amount, currency in rows
    ]
