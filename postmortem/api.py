"""`/admin/api/…`: the archive and the desk for programs, and for the command line.

A thin table: each address is one reading or one act, and what is not in a reading's shape is answered in one form (problem+json
with its sentence in the asked language). The readings happen on a thread, so that one slow disk does not stop the others.
"""

import json
from collections.abc import Awaitable, Callable, Mapping
from typing import Any, Final, assert_never

import msgspec
from msgspec import structs
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from postmortem import as_told, asked, bundle, reading
from postmortem.guard_line import GuardLine
from postmortem.reports.as_json import as_story
from postmortem.views import Acts, Bulk, Group, IncidentLine, Letter, Proposal, Reads, Refusal
from postmortem.web.places import Places

LIMIT: Final = 50
LIMIT_MAX: Final = 500
WEEKS: Final = 26
FOLLOW: Final = "/admin/api"

Answer = Callable[[Request], Awaitable[Response]]
#: What the body of an act may say; every other name in it is refused.
_SAID: Final[Mapping[str, str]] = {"retry": "anyway", "correct": "body", "discard": "reason", "note": "text"}
_SAID_OF_INCIDENTS: Final[Mapping[str, str]] = {"merge": "into", "split": "incident", "note": "text"}


class Api(msgspec.Struct, frozen=True):
    """What the addresses need."""

    reads: Reads
    acts: Acts
    places: Places
    guard: GuardLine

    async def incidents(self, request: Request) -> Response:
        """The list of incidents."""
        found = await run_in_threadpool(
            self.reads.incidents, asked.listed(request.query_params), *_piece(request)
        )
        return as_json(as_told.page(found, structs.asdict))

    async def incident(self, request: Request) -> Response:
        """One incident: its whole story while its folder is kept, else its line."""
        return await run_in_threadpool(self._incident, request.path_params["id"], _lang(request))

    def _incident(self, incident_id: str, lang: str) -> Response:
        line = self.reads.incident(incident_id)
        if line is None or not bundle.is_incident_id(incident_id):
            return _no(Refusal("incident_unknown", {}), lang)
        found = [one for one in reading.find(self.places.incidents, line.id) if one.id == line.id]
        story = as_story(reading.read_report(found[0]), lang) if found else structs.asdict(line)
        proposals = [as_told.proposal(one) for one in self.reads.proposals(line.id)]
        return as_json({**story, "proposals": proposals})

    async def letters(self, request: Request) -> Response:
        """The list of letters."""
        found = await run_in_threadpool(
            self.reads.letters, asked.listed(request.query_params), *_piece(request)
        )
        lang = _lang(request)
        counts = await run_in_threadpool(self.reads.counts)
        return as_json({**as_told.page(found, lambda one: as_told.letter(one, lang)), "counts": dict(counts)})

    async def letter(self, request: Request) -> Response:
        """One letter."""
        found = await run_in_threadpool(self.reads.letter, request.path_params["id"])
        return _answer(found or Refusal("letter_unknown", {}), _lang(request))

    async def act(self, request: Request) -> Response:
        """One act on one letter."""
        letter_id, verb = request.path_params["id"], request.path_params["verb"]
        told = await asked.body_of(request, *filter(None, [_SAID.get(verb)]))
        match verb:
            case "dry-run":
                done = await self.acts.dry_run(letter_id)
            case "retry":
                done = await self.acts.retry(letter_id, anyway=asked.flag(told, "anyway", otherwise=False))
            case "correct":
                body = told.get("body")
                done = await self.acts.correct(letter_id, body if isinstance(body, str) else json.dumps(body))
            case "requeue":
                done = await self.acts.requeue(letter_id)
            case "hold":
                done = await self.acts.hold(letter_id)
            case "discard":
                done = await self.acts.discard(letter_id, asked.text_in(told, "reason"))
            case "undo-discard":
                done = await self.acts.undo_discard(letter_id)
            case "note":
                done = await self.acts.note(letter_id, asked.text_in(told, "text"))
            case "reveal":
                return await self._reveal(letter_id, _lang(request))
            case _:
                done = Refusal("not_found", {})
        return _answer(done, _lang(request))

    async def _reveal(self, letter_id: str, lang: str) -> Response:
        """One letter with its secrets, once that is written down."""
        found = await run_in_threadpool(self.reads.letter, letter_id)
        if found is None:
            return _no(Refusal("letter_unknown", {}), lang)
        await self.places.write_down("reveal", f"letter {found.id}", "", "shown")
        return as_json(as_told.whole_letter(found, lang, revealed=True))

    async def begin_bulk(self, request: Request) -> Response:
        """Begin many at once: `verb`, and `ids` or `where`."""
        told = await asked.body_of(request, "verb", "ids", "where", "reason")
        done = await self.acts.bulk(
            asked.text_in(told, "verb"), asked.meant(told), asked.text_in(told, "reason")
        )
        return _answer(done, _lang(request), status=202)

    async def bulk(self, request: Request) -> Response:
        """How far many are."""
        found = await run_in_threadpool(self.reads.bulk, request.path_params["id"])
        return _answer(found or Refusal("bulk_unknown", {}), _lang(request))

    async def cancel_bulk(self, request: Request) -> Response:
        """End many where they are."""
        return _answer(await self.acts.cancel_bulk(request.path_params["id"]), _lang(request))

    async def decide(self, request: Request) -> Response:
        """A person's word on a proposal."""
        told, place = await asked.body_of(request, "owner", "note"), request.path_params
        owner, note = asked.text_in(told, "owner"), asked.text_in(told, "note")
        done = await self.acts.decide(place["id"], place["verb"], owner, note)
        return _answer(done, _lang(request))

    async def mark_fixed(self, request: Request) -> Response:
        """A person's word on a group."""
        told = await asked.body_of(request, "version")
        done = await self.acts.mark_fixed(request.path_params["id"], asked.text_in(told, "version"))
        return _answer(done, _lang(request))

    async def change_incidents(self, request: Request) -> Response:
        """A group put into another one or taken apart, an incident's note, or its evidence removed."""
        verb, identity = request.url.path.rpartition("/")[2], request.path_params["id"]
        told, acts = (
            await asked.body_of(request, *filter(None, [_SAID_OF_INCIDENTS.get(verb)])),
            self.acts.incidents,
        )
        match verb:
            case "merge":
                done: Group | IncidentLine | Refusal = await acts.merge(identity, asked.name_in(told, "into"))
            case "split":
                done = await acts.split(identity, asked.name_in(told, "incident"))
            case "note":
                done = await acts.note(identity, asked.text_in(told, "text"))
            case _:
                done = await acts.remove_evidence(identity)
        return _answer(done, _lang(request))


async def _others(api: Api, request: Request) -> Response:
    """The readings that are one value each."""
    query = request.query_params
    match request.path_params["what"]:
        case "token":
            found: Any = {"token": api.places.token}
        case "groups":
            groups = await run_in_threadpool(api.reads.groups, asked.listed(query), *_piece(request))
            found = as_told.page(groups, as_told.group)
        case "proposals":
            proposals = await run_in_threadpool(api.reads.proposals, query.get("incident", ""))
            found = {"items": [as_told.proposal(one) for one in proposals]}
        case "audit":
            found = as_told.page(await run_in_threadpool(api.reads.audit, *_piece(request)), structs.asdict)
        case "drills":
            drills = await run_in_threadpool(api.reads.drills, _piece(request)[0])
            found = {"items": [structs.asdict(one) for one in drills]}
        case "trends":
            found = dict(await run_in_threadpool(api.reads.trends, _number(query.get("weeks"), WEEKS)))
        case _:
            return _no(Refusal("not_found", {}), _lang(request))
    return as_json(found)


def routes(api: Api) -> list[Route]:
    """The addresses for programs."""

    async def others(request: Request) -> Response:
        return await _others(api, request)

    table: list[tuple[str, str, Answer]] = [
        ("GET", "/incidents", api.incidents),
        ("GET", "/incidents/{id}", api.incident),
        ("GET", "/letters", api.letters),
        ("POST", "/letters/bulk", api.begin_bulk),
        ("GET", "/letters/{id}", api.letter),
        ("POST", "/letters/{id}/{verb}", api.act),
        ("GET", "/bulk/{id}", api.bulk),
        ("POST", "/bulk/{id}/cancel", api.cancel_bulk),
        ("POST", "/proposals/{id}/{verb}", api.decide),
        ("POST", "/groups/{id}/fixed", api.mark_fixed),
        ("POST", "/groups/{id}/merge", api.change_incidents),
        ("POST", "/groups/{id}/split", api.change_incidents),
        ("POST", "/incidents/{id}/note", api.change_incidents),
        ("POST", "/incidents/{id}/remove-evidence", api.change_incidents),
        ("GET", "/{what}", others),
    ]
    return [Route(FOLLOW + path, answer, methods=[method]) for method, path, answer in table]


def _piece(request: Request) -> tuple[int, str]:
    return _number(request.query_params.get("limit"), LIMIT), request.query_params.get("cursor", "")


def _number(given: str | None, otherwise: int) -> int:
    fits = given is not None and given.isascii() and given.isdecimal() and len(given) <= 4
    return min(max(int(given), 1), LIMIT_MAX) if fits and given is not None else otherwise


def _lang(request: Request) -> str:
    asked = request.query_params.get("lang") or request.cookies.get("lang") or ""
    if asked not in ("ko", "en"):
        asked = "ko" if request.headers.get("accept-language", "").lower().startswith("ko") else "en"
    return asked


def _answer(
    found: Letter | Bulk | Proposal | Group | IncidentLine | Refusal, lang: str, status: int = 200
) -> Response:
    match found:
        case Refusal():
            return _no(found, lang)
        case Letter():
            told = as_told.whole_letter(found, lang)
        case Proposal():
            told = as_told.proposal(found)
        case Group():
            told = as_told.group(found)
        case Bulk() | IncidentLine():
            told = structs.asdict(found)
        case _:
            assert_never(found)
    return as_json(told, status)


def _no(refused: Refusal, lang: str) -> Response:
    status, told = as_told.refusal(refused, lang)
    return as_json(told, status, "application/problem+json")


def as_json(value: object, status: int = 200, media_type: str = "application/json") -> Response:
    """Return a value as the JSON of an answer."""
    # A lone surrogate is the one thing UTF-8 can't carry; as an escape it is valid in JSON.
    data = json.dumps(value, ensure_ascii=False).encode("utf-8", "backslashreplace")
    return Response(data, status, media_type=media_type)
