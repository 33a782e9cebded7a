"""The list of dead letters, and what is done with many of them at once.

A number is asked about before anything happens: how many, whose accounts, which sum. What is done with a filter is
done with what the filter finds at that moment, and at most LETTERS_MAX of them.
"""

from collections.abc import Sequence
from decimal import Decimal, InvalidOperation
from typing import Any, Final

from starlette.datastructures import FormData
from starlette.requests import Request
from starlette.responses import Response

from frontend.admin_paper import knows
from postmortem.reports.evidence_words import command_word
from postmortem.reports.visible import visible
from postmortem.views import Bulk, Filter, Letter, LetterState, Refusal
from postmortem.web.incidents import FILTER_CHARACTERS_MAX, PAGE_LINES_MAX, address, day_of, filter_of
from postmortem.web.lobby import Lobby, Question, field, is_sure, lead_to, reader_of, words_of
from postmortem.wording import is_said

HERE: Final = "/admin/dlq"
LETTERS_MAX: Final = 500
VERBS: Final = ("dry-run", "retry", "requeue", "hold", "discard")
REASON_CHARACTERS_MAX: Final = 500
_FILTER_FIELDS: Final = ("state", "reason", "account", "fingerprint", "since", "until")


async def letters(lobby: Lobby, request: Request) -> Response:
    """GET /admin/dlq."""
    wanted = filter_of(request.query_params)
    cursor = request.query_params.get("cursor", "")[:FILTER_CHARACTERS_MAX]
    page = await lobby.read(lambda: lobby.reads.letters(wanted, PAGE_LINES_MAX, cursor))
    counts = await lobby.read(lobby.reads.counts)
    words = words_of(request)
    return lobby.show(
        request,
        "letters.html.j2",
        HERE,
        page=page,
        wanted=wanted,
        since=day_of(wanted.since),
        until=day_of(wanted.until),
        narrowed=wanted != Filter(drills=wanted.drills),
        counts=[(visible(code), reason_words(words, code), count) for code, count in counts.items() if count],
        oldest=min((one.quarantined_at for one in page.items), default=""),
        states=[str(state) for state in LetterState],
        kind_of=lambda kind: command_word(kind, reader_of(request).lang),
        reason_of=lambda code: reason_words(words, code),
        verbs=VERBS,
        more=address(HERE, wanted, cursor=page.more) if page.more else "",
    )


async def bulk(lobby: Lobby, request: Request) -> Response:
    """POST /admin/dlq/bulk: asks with number, accounts and sum, then begins."""
    form = await lobby.form(request)
    if isinstance(form, Response):
        return form
    verb = field(form, "verb")
    wanted = _wanted(form)
    if verb not in VERBS:
        return lobby.lost(request, HERE, HERE)
    chosen = await lobby.read(lambda: _chosen(lobby, wanted))
    reason = field(form, "text")[:REASON_CHARACTERS_MAX]
    if not chosen:
        return lead_to(HERE, "refused_bulk_nothing")
    if is_sure(form) and (verb != "discard" or is_said(reason)):
        told = await lobby.acts.bulk(verb, wanted, reason)
        if isinstance(told, Refusal):
            return lobby.refuse(request, HERE, told, HERE)
        return lead_to(f"{HERE}/bulk/{told.id}")
    return lobby.ask(request, HERE, _question(words_of(request), verb, form, chosen))


async def progress(lobby: Lobby, request: Request) -> Response:
    """GET /admin/dlq/bulk/{id}."""
    told: Bulk | None = await lobby.read(lambda: lobby.reads.bulk(request.path_params["id"]))
    if told is None:
        return lobby.lost(request, HERE, HERE)
    return lobby.show(request, "bulk.html.j2", HERE, bulk=told)


async def cancel(lobby: Lobby, request: Request) -> Response:
    """POST /admin/dlq/bulk/{id}/cancel."""
    form = await lobby.form(request)
    if isinstance(form, Response):
        return form
    bulk_id = request.path_params["id"]
    told = await lobby.acts.cancel_bulk(bulk_id)
    if isinstance(told, Refusal):
        return lobby.refuse(request, HERE, told, HERE)
    return lead_to(f"{HERE}/bulk/{told.id}")


def reason_words(words: Any, code: str) -> str:
    """Return the sentence of a reason's code; a code that is newer than the catalogue stands for itself."""
    return str(words(f"reason_{code}")) if knows(f"reason_{code}") else visible(code)


def sums_of(letters: Sequence[Letter]) -> list[str]:
    """Return the total of some letters' amounts, one text for each currency; what is no amount is passed over."""
    totals: dict[str, Decimal] = {}
    for text in (one for letter in letters for one in letter.sums):
        amount, _, currency = text.partition(" ")
        try:
            totals[currency] = totals.get(currency, Decimal(0)) + Decimal(amount)
        except InvalidOperation:
            continue
    return [f"{total:,f} {currency}".strip() for currency, total in sorted(totals.items())]


def _wanted(form: FormData) -> Filter | Sequence[str]:
    """Return which letters a form means: all that fit its filter, or those that were ticked."""
    if field(form, "all") == "1":
        return filter_of(form)
    ids = [one[:64] for one in form.getlist("id") if isinstance(one, str)]
    return list(dict.fromkeys(ids))[:LETTERS_MAX]


def _chosen(lobby: Lobby, wanted: Filter | Sequence[str]) -> list[Letter]:
    if isinstance(wanted, Filter):
        return list(lobby.reads.letters(wanted, LETTERS_MAX).items)
    found = (lobby.reads.letter(one) for one in wanted)
    return [one for one in found if one is not None]


def _question(words: Any, verb: str, form: FormData, chosen: Sequence[Letter]) -> Question:
    accounts = {account for letter in chosen for account in letter.account_ids}
    sums = sums_of(chosen)
    counted = (
        words("bulk_sums", k=len(accounts), sum=", ".join(sums))
        if sums
        else words("bulk_no_sums", k=len(accounts))
    )
    kept = [("verb", verb)]
    if field(form, "all") == "1":
        kept += [("all", "1"), *((name, field(form, name)) for name in _FILTER_FIELDS)]
    else:
        kept += [("id", letter.id) for letter in chosen]
    lines = [counted, words("discard_told") if verb == "discard" else words("bulk_pace")]
    if len(chosen) >= LETTERS_MAX:
        lines.append(words("bulk_capped", cap=LETTERS_MAX))
    return Question(
        title=words(f"bulk_{verb}", n=len(chosen)),
        action=f"{HERE}/bulk",
        sure=words(f"do_{verb}"),
        back=HERE,
        keep=words("keep"),
        lines=lines,
        fields=kept,
        typed=("text", words("discard_reason"), REASON_CHARACTERS_MAX) if verb == "discard" else None,
        fault=words("discard_needs") if is_sure(form) else "",
        harms=verb == "discard",
    )
