"""The page of one incident: what happened, to whom, for how long, why, and what would prevent it.

Whose account it was is masked until somebody asks to see it, and that is written down. The page shows what the
archive knows even where the folder is gone, because the list that led here still names it.
"""

from collections.abc import Mapping
from http import HTTPStatus
from typing import Any, Final

from starlette.requests import Request
from starlette.responses import Response

from postmortem.bundle import is_incident_id
from postmortem.incident import unique
from postmortem.views import Filter, Refusal
from postmortem.web import exports, story
from postmortem.web.lobby import Lobby, field, lead_to, reader_of
from postmortem.web.story import Story

HERE: Final = "/admin/incidents"
SIMILAR_MAX: Final = 6
LETTERS_MAX: Final = 20
OWNER_CHARACTERS_MAX: Final = 100
NOTE_CHARACTERS_MAX: Final = 500
NOTE_TEXT_CHARACTERS_MAX: Final = 2_000
VERBS: Final = ("accept", "decline", "done", "revoke")


async def incident(lobby: Lobby, request: Request) -> Response:
    """GET /admin/incidents/{id}."""
    return await _show(lobby, request, shown=False)


async def reveal(lobby: Lobby, request: Request) -> Response:
    """POST /admin/incidents/{id}/reveal: the same page with the masked values, once it is written down."""
    form = await lobby.form(request)
    if isinstance(form, Response):
        return form
    answer = await _show(lobby, request, shown=True)
    if answer.status_code != HTTPStatus.NOT_FOUND:  # of what is not there nothing was shown
        await lobby.places.write_down("reveal", request.path_params["id"], "", "shown")
    return answer


async def decide(lobby: Lobby, request: Request) -> Response:
    """POST /admin/proposals/{id}/{verb}."""
    form = await lobby.form(request)
    if isinstance(form, Response):
        return form
    incident_id, verb = field(form, "incident"), request.path_params["verb"]
    if verb not in VERBS or not is_incident_id(incident_id):
        return lobby.lost(request, HERE, HERE)
    owner, note = field(form, "owner")[:OWNER_CHARACTERS_MAX], field(form, "note")[:NOTE_CHARACTERS_MAX]
    told = await lobby.acts.decide(request.path_params["id"], verb, owner, note)
    back = f"{HERE}/{incident_id}"
    return lobby.refuse(request, HERE, told, back) if isinstance(told, Refusal) else lead_to(back, "done")


async def note(lobby: Lobby, request: Request) -> Response:
    """POST /admin/incidents/{id}/note."""
    form = await lobby.form(request)
    if isinstance(form, Response):
        return form
    incident_id = request.path_params["id"]
    if not is_incident_id(incident_id):
        return lobby.lost(request, HERE, HERE)
    told = await lobby.acts.incidents.note(incident_id, field(form, "text")[:NOTE_TEXT_CHARACTERS_MAX])
    back = f"{HERE}/{incident_id}"
    return lobby.refuse(request, HERE, told, HERE) if isinstance(told, Refusal) else lead_to(back, "note")


async def _show(lobby: Lobby, request: Request, *, shown: bool) -> Response:
    incident_id, lang = request.path_params["id"], reader_of(request).lang
    found = await lobby.read(lambda: story.find(lobby.places.incidents, incident_id))
    line = (
        await lobby.read(lambda: lobby.reads.incident(incident_id)) if is_incident_id(incident_id) else None
    )
    if found is None and line is None:
        return lobby.lost(request, HERE, HERE)
    told = None if found is None else await lobby.read(lambda: story.tell(found, lang))
    proposals = await lobby.read(lambda: lobby.reads.proposals(incident_id))
    # The archive's first: a person may have put the incident into another group.
    fingerprint = (
        line.fingerprint if line is not None else told.report.fingerprint if told is not None else ""
    )
    similar = await lobby.read(
        lambda: lobby.reads.incidents(Filter(fingerprint=fingerprint), SIMILAR_MAX) if fingerprint else None
    )
    numbers = () if told is None else unique(trial.letter or "" for trial in told.report.incident.trials)
    letters = await lobby.read(lambda: [lobby.reads.letter(one) for one in numbers[:LETTERS_MAX]])
    return lobby.show(
        request,
        "incident.html.j2",
        HERE,
        id=incident_id,
        line=line,
        shown=shown,
        proposals=proposals,
        group=await lobby.read(lambda: lobby.reads.group(fingerprint) if fingerprint else None),
        similar=[one for one in (similar.items if similar else ()) if one.id != incident_id],
        letters=[one for one in letters if one is not None],
        exports=exports.FORMS,
        told=None if told is None else _facts(told, lang, shown=shown),
        story=told,
    )


def _facts(told: Story, lang: str, *, shown: bool) -> Mapping[str, Any]:
    """Return everything of the report as the page's template takes it."""
    report = told.report
    return {
        **story.sentences(report, lang),
        "incident": report.incident,
        "contents": report.contents,
        "causes": story.causes(report, lang, shown=shown),
        "evidence": story.evidence(report, lang, shown=shown),
        "commands": story.commands(report, lang, shown=shown),
        "named": story.named(report, shown=shown),
        "steps": story.steps(report, lang),
        "requests": story.requests(report, lang, shown=shown),
        "crumbs": [story.crumb(one, lang, shown=shown) for one in reversed(told.crumbs)],
    }
