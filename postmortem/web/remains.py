"""The quieter pages: the evidence that is kept, how it went over the weeks, what the guard goes by, who did what."""

import platform
import shutil
from collections.abc import Mapping, Sequence
from typing import Any, Final

from starlette.requests import Request
from starlette.responses import Response

from frontend.admin_paper import knows
from postmortem import bundle
from postmortem.bundle import BundleFailed
from postmortem.incident import mapping, mappings, number
from postmortem.views import Filter, IncidentLine, Refusal
from postmortem.web import story
from postmortem.web.incidents import FILTER_CHARACTERS_MAX, PAGE_LINES_MAX, cause_words
from postmortem.web.lobby import Lobby, Question, is_sure, lead_to, reader_of, words_of
from postmortem.web.outlook import growing
from postmortem.web.promises import promises
from postmortem.web.proofs import drills

WEEKS: Final = 12
DRILLS_MAX: Final = 20
PROMISES_SHOWN_MAX: Final = 10
SETTINGS_MAX: Final = 300
FREE_BYTES_MIN: Final = 1 << 30
#: Fewer incidents than this make no trend.
SAMPLES_MIN: Final = 5


async def snapshots(lobby: Lobby, request: Request) -> Response:
    """GET /admin/snapshots."""
    cursor = request.query_params.get("cursor", "")[:FILTER_CHARACTERS_MAX]
    page = await lobby.read(lambda: lobby.reads.incidents(Filter(), PAGE_LINES_MAX, cursor))
    kept = await lobby.read(lambda: _kept(lobby, page.items))
    free_bytes = await lobby.read(lambda: _free_bytes(lobby))
    return lobby.show(
        request,
        "snapshots.html.j2",
        "/admin/snapshots",
        kept=kept,
        free=None if free_bytes is None else size_text(free_bytes),
        low=free_bytes is not None and free_bytes < FREE_BYTES_MIN,
        size=size_text,
        more=f"/admin/snapshots?cursor={page.more}" if page.more else "",
    )


async def remove(lobby: Lobby, request: Request) -> Response:
    """POST /admin/incidents/{id}/remove: asked about first, because evidence that is gone does not come back."""
    form = await lobby.form(request)
    if isinstance(form, Response):
        return form
    here, incident_id, words = "/admin/snapshots", request.path_params["id"], words_of(request)
    line = await lobby.read(
        lambda: lobby.reads.incident(incident_id) if bundle.is_incident_id(incident_id) else None
    )
    if line is None:
        return lobby.lost(request, here, here)
    if is_sure(form):
        told = await lobby.acts.incidents.remove_evidence(incident_id)
        return (
            lobby.refuse(request, here, told, here) if isinstance(told, Refusal) else lead_to(here, "removed")
        )
    question = Question(
        title=words("remove_title"),
        action=f"/admin/incidents/{incident_id}/remove",
        sure=words("snapshot_remove"),
        back=here,
        keep=words("cancel"),
        lines=(line.summary[reader_of(request).lang], words("remove_told")),
        harms=True,
    )
    return lobby.ask(request, here, question)


async def trends(lobby: Lobby, request: Request) -> Response:
    """GET /admin/trends."""
    told = await lobby.read(lambda: lobby.reads.trends(WEEKS))
    promised = await lobby.read(lambda: promises(lobby.places.data))
    weeks = mappings(told.get("weeks"))
    most = max([1, *(number(one.get("incidents")) or 0 for one in weeks)])
    return lobby.show(
        request,
        "trends.html.j2",
        "/admin/trends",
        weeks=weeks,
        most=most,
        total=number(told.get("incidents")) or 0,
        growth=growing(words_of(request), await lobby.places.ask_guard({"verb": "curve"})),
        few=(number(told.get("incidents")) or 0) < SAMPLES_MIN,
        mtbf=told.get("mtbf_hours"),
        promised=promised[:PROMISES_SHOWN_MAX],
        scored=len(promised),
        kept=sum(one.within for one in promised),
        causes=mappings(told.get("causes")),
        cause_words=cause_words(reader_of(request).lang),
        drills=await lobby.read(lambda: drills(lobby.reads, DRILLS_MAX)),
        drill_words=_drill_words(words_of(request)),
    )


async def settings(lobby: Lobby, request: Request) -> Response:
    """GET /admin/settings."""
    answer = mapping(await lobby.places.ask_guard({"verb": "policy"}))
    values = _flat(mapping(answer.get("policy")))
    cursor = request.query_params.get("cursor", "")[:FILTER_CHARACTERS_MAX]
    audit = await lobby.read(lambda: lobby.reads.audit(PAGE_LINES_MAX, cursor))
    words = words_of(request)
    return lobby.show(
        request,
        "settings.html.j2",
        "/admin/settings",
        explained=[
            (name, value, words(f"means_{name}", n=value))
            for name, value in ((path.rpartition(".")[2], value) for path, value in values)
            if knows(f"means_{name}") and isinstance(value, int)
        ],
        values=[(path, str(value)) for path, value in values],
        python=platform.python_version(),
        audit=audit,
        more=f"/admin/settings?cursor={audit.more}#audit" if audit.more else "",
    )


def size_text(size_bytes: int) -> str:
    """Return a size for people."""
    for unit, name in ((1 << 30, "GB"), (1 << 20, "MB"), (1 << 10, "kB")):
        if size_bytes >= unit:
            return f"{size_bytes / unit:.1f} {name}"
    return f"{size_bytes} B"


def _kept(lobby: Lobby, lines: Sequence[IncidentLine]) -> list[Mapping[str, Any]]:
    """Return what each incident left behind; those whose evidence is gone already are left out."""
    kept: list[Mapping[str, Any]] = []
    for line in lines:
        found = story.find(lobby.places.incidents, line.id)
        if found is None:
            continue
        manifest = bundle.read_manifest(found.path)
        files = {} if isinstance(manifest, BundleFailed) else manifest.files
        missing = {} if isinstance(manifest, BundleFailed) else manifest.missing
        whole = (
            not isinstance(manifest, BundleFailed) and manifest.complete and not missing and not found.partial
        )
        size_bytes = sum(entry.size_bytes for entry in files.values())
        kept.append(
            {"line": line, "files": len(files), "bytes": size_bytes, "whole": whole, "missing": missing}
        )
    return kept


def _free_bytes(lobby: Lobby) -> int | None:
    try:
        return shutil.disk_usage(lobby.places.data).free
    except OSError:
        return None


def _flat(values: Mapping[str, Any], lead: str = "") -> list[tuple[str, Any]]:
    """Return the settings as one list of paths and plain values."""
    found: list[tuple[str, Any]] = []
    for name, value in values.items():
        if isinstance(value, dict):
            found += _flat(value, f"{lead}{name}.")
        else:
            found.append((f"{lead}{name}", value))
    return found[:SETTINGS_MAX]


def _drill_words(words: Any) -> Any:
    return lambda fault: words(f"drill_{fault}") if knows(f"drill_{fault}") else fault
