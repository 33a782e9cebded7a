"""The list of incidents, as groups of equal deaths or one by one, and the mark that a group is mended."""

from datetime import UTC, datetime
from typing import Any, Final
from urllib.parse import urlencode

from starlette.requests import Request
from starlette.responses import Response

from frontend import catalogue_reports
from postmortem.bundle import is_incident_id
from postmortem.reports.report import cause_sentence
from postmortem.reports.visible import visible
from postmortem.views import Filter, Refusal
from postmortem.web.lobby import Lobby, field, lead_to, reader_of

PAGE_LINES_MAX: Final = 50
FILTER_CHARACTERS_MAX: Final = 200
HERE: Final = "/admin/incidents"
#: Outcomes as the archive has them, and the word for each: of one that its guard left, a line knows no more.
_OUTCOMES: Final = {
    "recovered": "recovered", "manual": "manual", "safe_mode": "safe_mode", "assist": "assist", "open": "open",
    "abandoned": "untold",
}  # fmt: skip
_NAMES: Final = ("state", "reason", "diagnosis", "outcome", "account", "fingerprint", "since", "until")


async def incidents(lobby: Lobby, request: Request) -> Response:
    """GET /admin/incidents."""
    every = request.query_params.get("view") == "all"
    wanted = filter_of(request.query_params)
    cursor = request.query_params.get("cursor", "")[:FILTER_CHARACTERS_MAX]
    seek = lobby.reads.incidents if every else lobby.reads.groups
    page = await lobby.read(lambda: seek(wanted, PAGE_LINES_MAX, cursor))
    lang = reader_of(request).lang
    words = {code: catalogue_reports.OUTCOME_WORDS[name][lang] for code, name in _OUTCOMES.items()}
    return lobby.show(
        request,
        "incidents.html.j2",
        HERE,
        every=every,
        wanted=wanted,
        narrowed=wanted != Filter(drills=wanted.drills),
        since=day_of(wanted.since),
        until=day_of(wanted.until),
        page=page,
        more=address(HERE, wanted, view="all" if every else "", cursor=page.more) if page.more else "",
        causes=sorted(cause_words(lang).items(), key=lambda item: item[1]),
        files=[address(f"{HERE}.{form}", wanted) for form in ("csv", "json")] if every else [],
        outcomes=sorted(words.items()),
        outcome_words=words,
    )


async def mark_fixed(lobby: Lobby, request: Request) -> Response:
    """POST /admin/groups/{fingerprint}/fixed."""
    form = await lobby.form(request)
    if isinstance(form, Response):
        return form
    version = field(form, "version")[:64]
    if not version:
        return lead_to(HERE, "refused")
    told = await lobby.acts.mark_fixed(request.path_params["fingerprint"], version)
    return lobby.refuse(request, HERE, told, HERE) if isinstance(told, Refusal) else lead_to(HERE, "done")


async def merge(lobby: Lobby, request: Request) -> Response:
    """POST /admin/groups/{fingerprint}/merge: a person says that two groups are one; `split` takes it back."""
    form = await lobby.form(request)
    if isinstance(form, Response):
        return form
    into = field(form, "into")[:FILTER_CHARACTERS_MAX]
    if not into:
        return lead_to(HERE, "refused")
    told = await lobby.acts.incidents.merge(request.path_params["fingerprint"], into)
    return lobby.refuse(request, HERE, told, HERE) if isinstance(told, Refusal) else lead_to(HERE, "done")


async def split(lobby: Lobby, request: Request) -> Response:
    """POST /admin/groups/{fingerprint}/split: a merged group into its parts, or the incident that is named out of it."""
    form = await lobby.form(request)
    if isinstance(form, Response):
        return form
    incident_id = field(form, "incident")
    if incident_id and not is_incident_id(incident_id):
        return lobby.lost(request, HERE, HERE)
    told = await lobby.acts.incidents.split(request.path_params["fingerprint"], incident_id)
    back = f"{HERE}/{incident_id}" if incident_id else HERE
    return lobby.refuse(request, HERE, told, back) if isinstance(told, Refusal) else lead_to(back, "done")


def cause_words(lang: str) -> dict[str, str]:
    """Return each diagnosis as a sentence of its own."""
    return {code: cause_sentence(code, lang) for code in catalogue_reports.CAUSES}


def filter_of(asked: Any) -> Filter:
    """Return what a list is narrowed to, from an address or a form; what is no day is not narrowed by."""
    values = {name: visible(field(asked, name)[:FILTER_CHARACTERS_MAX]) for name in _NAMES}
    for name, clock in (("since", "T00:00:00"), ("until", "T23:59:59.999")):
        values[name] = _day_edge(values[name], clock)
    # A form without a tick says nothing of it; a first visit says nothing at all.
    drills = field(asked, "drills") != "" if any(name in asked for name in _NAMES) else True
    return Filter(**values, drills=drills)


def address(path: str, wanted: Filter, **more: str | None) -> str:
    """Return the address of a list that is narrowed so."""
    asked = {name: value for name in _NAMES if (value := getattr(wanted, name))}
    asked |= {"since": day_of(wanted.since)} if wanted.since else {}
    asked |= {"until": day_of(wanted.until)} if wanted.until else {}
    asked |= {"drills": "1"} if wanted.drills and asked else {}
    return f"{path}?{urlencode(asked | {name: value for name, value in more.items() if value})}"


def day_of(at: str) -> str:
    """Return the day of a filter's edge as this machine's calendar has it: what its field shows."""
    return datetime.fromisoformat(at).astimezone().date().isoformat() if at else ""


def _day_edge(day: str, clock: str) -> str:
    """Return a day's begin or end on this machine's own clock, in UTC as the archive has its times."""
    try:
        at = datetime.fromisoformat(f"{day[:10]}{clock}").astimezone(UTC)
    except (ValueError, OverflowError):
        return ""
    return at.isoformat(timespec="milliseconds").replace("+00:00", "Z")
