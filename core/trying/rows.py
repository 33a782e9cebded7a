"""A row on trial: booked in a throw-away core as the importer books it, from the files of the household's own import.

The files are only read, and read anew for each row, as after a death; which row it is, is its place in the file, because its
key is. It is asked for over the core's own socket, on a path that nobody else knows, so that it is watched like any request.
Not chosen: to have the importer do it; it would begin where the import stands, and run the rows before it too.
"""

import asyncio
from itertools import islice
from pathlib import Path
from typing import Any, Final

import msgspec
from starlette.requests import Request as Asked
from starlette.responses import Response

from core.imports import judging
from core.imports.folder import Imports, is_import_id
from core.imports.importer import KIND
from core.imports.looking import results
from core.imports.reading.candidates import Candidate, Result
from core.imports.reading.kept import open_table
from core.imports.reading.table import Unreadable
from core.imports.records import Manifest
from core.ledger.commands import accounts_of
from core.ledger.reasons import Rejection
from core.web import asking

GONE: Final = 410  # a row that is not to be found any more
NOT_BOOKED: Final = 422  # a row of which nothing comes


def booking(data: Path) -> asking.Handler:
    """Return who books a row of the household's imports, as the importer does."""

    async def book(request: Asked) -> Response:
        import_id, ordinal = request.path_params["id"], request.path_params["ordinal"]
        found = await asyncio.to_thread(_row, data, import_id, ordinal)
        if found is None:
            return Response(status_code=GONE)
        manifest, result = found
        judged = judging.judge(result, manifest.currency)
        if not isinstance(judged, Candidate):
            return Response(status_code=NOT_BOOKED)
        return await _book(request, manifest, judged, ordinal)

    return book


async def _book(request: Asked, manifest: Manifest, candidate: Candidate, ordinal: int) -> Response:
    service = asking.service_of(request)
    command = judging.command_of(candidate, ordinal, manifest, service.new_id())
    if isinstance(command, Rejection):
        return Response(status_code=NOT_BOOKED)
    key = judging.key_of(manifest, ordinal)
    named: dict[str, Any] = {
        "key": key,
        "command_id": command.id,
        "transaction_id": command.id,
        "account_ids": accounts_of(command),
    }
    with asking.working(request, KIND, judging.payload_of(candidate), **named) as held:
        answer = await service.carry_out(command, key, key.encode(), command.id, held.slot, kind=KIND)
        response = asking.respond_with(request, answer)
        held.status = response.status_code
    return response


def _row(data: Path, import_id: str, ordinal: int) -> tuple[Manifest, Result] | None:
    """Return the wish of an import and what its row is under it, None where either is gone."""
    folder = Imports(data).open(import_id) if is_import_id(import_id) else None
    manifest = folder.manifest() if folder is not None else None
    if folder is None or manifest is None or manifest.account is None:
        return None
    table = open_table(folder.rows)
    if isinstance(table, Unreadable):
        return None
    try:
        result = next(islice(results(manifest, table), ordinal - 1, ordinal), None)
    except (OSError, msgspec.MsgspecError):
        return None
    return None if result is None else (manifest, result)
