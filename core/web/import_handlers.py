"""Imports over HTTP: give a file, look at it, choose, commit, watch.

The handlers know shapes and nothing else; what may be done in which state is the desk's to say. An upload holds
no slot while its file streams in and is read, because a slot without progress would look like a hang; its
password is in no body that is kept anywhere, neither by the recorder nor in a log.
"""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

import msgspec
from starlette.requests import Request
from starlette.responses import Response

from core.imports.desk import Desk, Kept
from core.imports.looking import Choices
from core.imports.reading.mapping import Mapping
from core.imports.troubles import Trouble
from core.ledger.reasons import Fault, Reason
from core.web.asking import Routes, as_json, service_of
from core.web.import_views import ImportList, faults_shown, sentence, summary_of, view_of
from core.web.intake import decode_body, idempotency_key, read_body
from core.web.problems import Outcome, Problem, ProblemError, safe_mode
from core.web.upload import Upload, receive
from frontend.render import Language, language

logger = logging.getLogger("core.web")


class PreviewBody(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The body that has a file looked at again; what is left out stays. `format` "": none of the known ones."""

    account: str | None = None
    mapping: Mapping | None = None
    format: str | None = None
    encoding: str | None = None


class CommitBody(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The body that has the rows booked; what is left out is as it was looked at."""

    account: str | None = None
    mapping: Mapping | None = None
    skip_duplicates: bool = True


async def upload(request: Request) -> Response:
    """POST /api/ledger/imports."""
    desk = _desk(request)
    import_id = desk.name(idempotency_key(request))
    # Room may end anywhere between the first byte and the name of the folder: nothing is kept then.
    with _keeping():
        path = await desk.begin(import_id)
        if isinstance(path, Trouble):
            raise _problem(path, _lang(request))
        try:
            came = await receive(request, path, service_of(request).settings.import_file_bytes_max)
            kept = await desk.take_in(
                import_id, came.name, came.sha256, _chosen(came), came.fields.get("password")
            )
        finally:
            await desk.end(import_id)
    return _tell(request, kept, 201)


async def list_imports(request: Request) -> Response:
    """GET /api/ledger/imports."""
    lang = _lang(request)
    found = await _desk(request).newest()
    return as_json(ImportList(tuple(summary_of(kept, lang) for kept in found)))


async def get_import(request: Request) -> Response:
    """GET /api/ledger/imports/{id}."""
    return _tell(request, await _desk(request).get(request.path_params["id"]), 200)


async def preview(request: Request) -> Response:
    """POST /api/ledger/imports/{id}/preview."""
    body = decode_body(await _body(request), PreviewBody)
    choices = Choices(body.account, body.mapping, body.format, body.encoding)
    with _keeping():
        kept = await _desk(request).preview(request.path_params["id"], choices)
    return _tell(request, kept, 200)


async def commit(request: Request) -> Response:
    """POST /api/ledger/imports/{id}/commit."""
    body = decode_body(await _body(request), CommitBody)
    choices = Choices(body.account, body.mapping)
    with _keeping():
        kept = await _desk(request).commit(
            request.path_params["id"], choices, skip_duplicates=body.skip_duplicates
        )
    return _tell(request, kept, 202)


ROUTES: Final[Routes] = {
    "/api/ledger/imports": {"GET": list_imports, "POST": upload},
    "/api/ledger/imports/{id}": {"GET": get_import},
    "/api/ledger/imports/{id}/preview": {"POST": preview},
    "/api/ledger/imports/{id}/commit": {"POST": commit},
}


async def _body(request: Request) -> bytes:
    return await read_body(request, service_of(request).settings.body_bytes_max) or b"{}"


def _chosen(came: Upload) -> Choices:
    given = came.fields
    return Choices(given.get("account"), None, given.get("format"), given.get("encoding"))


def _tell(request: Request, kept: Kept | Trouble, status: int) -> Response:
    lang = _lang(request)
    if isinstance(kept, Trouble):
        raise _problem(kept, lang)
    response = as_json(view_of(kept, lang))
    response.status_code = status
    response.headers["Content-Language"] = lang
    if kept.replayed:
        response.headers["Idempotent-Replayed"] = "true"
    return response


def _problem(trouble: Trouble, lang: Language) -> ProblemError:
    if trouble.slug == "safe-mode":
        return ProblemError(
            safe_mode(trouble.values["why"], Outcome.UNKNOWN if trouble.done_before else None)
        )
    values: dict[str, Any] = dict(trouble.values)
    extra: dict[str, Any] = {}
    if trouble.reason is not None:
        values["sentence"] = sentence(trouble.reason, lang)
        extra = {"reason": trouble.reason, **{name: int(line) for name, line in trouble.values.items()}}
    if trouble.faults:
        shown = faults_shown(trouble.faults, lang)
        values["sentence"] = shown[0].sentence
        extra = {"errors": shown}
    faults = (Fault("/account", Reason.MISSING),) if trouble.slug == "import-without-account" else ()
    return ProblemError(Problem(trouble.slug, faults, values, extra=extra))


@contextmanager
def _keeping() -> Iterator[None]:
    """What the disk does not take was not done, and is answered so."""
    try:
        yield
    except OSError as error:
        raise _no_room(error) from None


def _no_room(error: OSError) -> ProblemError:
    logger.error("An import could not be kept: %s", error.strerror)
    return ProblemError(Problem("import-not-kept"))


def _desk(request: Request) -> Desk:
    desk: Desk = request.app.state.desk
    return desk


def _lang(request: Request) -> Language:
    return language(request.headers.get("accept-language"))
