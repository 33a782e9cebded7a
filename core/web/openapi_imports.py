"""The description of the imports' part of the API, as data beside `openapi.py`.

A room of its own because an upload is the one request here that is no JSON: its form stands written out.
"""

from typing import Any, Final

from core.imports.reading.mapping import FaultKind
from core.imports.reading.table import Why
from core.web.import_handlers import CommitBody, PreviewBody
from core.web.import_views import ImportList, ImportView

IMPORT_SHAPES: Final = (PreviewBody, CommitBody, ImportView, ImportList)

#: Members that problems of imports have beside those of all problems.
IMPORT_PROBLEM_MEMBERS: Final[dict[str, Any]] = {
    "reason": {
        "type": "string",
        "enum": [*(why.value for why in Why), "kept-file-lost"],
        "description": "Of `file-unreadable`: why the file gives no rows. `locked` asks for a password.",
    },
    "line": {"type": "integer", "description": "Of `file-unreadable`: where it was seen."},
}
MAPPING_REASONS: Final = tuple(kind.value for kind in FaultKind)

_UPLOAD: Final[dict[str, Any]] = {
    "type": "object",
    "required": ["file"],
    "properties": {
        "file": {"type": "string", "format": "binary", "description": "CSV, xlsx, xls, or HTML named .xls."},
        "account": {"type": "string", "description": "The account the rows belong to; may be chosen later."},
        "encoding": {"type": "string", "description": "Of a CSV, where it was not found by itself."},
        "format": {"type": "string", "description": "A known layout; empty: none of them."},
        "password": {"type": "string", "description": "Of a locked workbook. Kept nowhere."},
    },
}
_ID: Final = {"name": "id", "in": "path", "required": True, "schema": {"type": "string"}}
_PROBLEM_RESPONSE: Final = {
    "description": "A problem",
    "content": {"application/problem+json": {"schema": {"$ref": "#/components/schemas/Problem"}}},
}


def import_paths(key: dict[str, Any]) -> dict[str, Any]:
    """Return the described paths; `key` is the description of `Idempotency-Key`."""
    return {
        "/api/ledger/imports": {
            "get": _operation("The newest 20 imports, newest first", "200", "ImportList"),
            "post": {
                **_operation(
                    "Upload a file and look at its rows; nothing is booked", "201", "ImportView", key
                ),
                "requestBody": {"required": True, "content": {"multipart/form-data": {"schema": _UPLOAD}}},
            },
        },
        "/api/ledger/imports/{id}": {
            "get": _operation("One import and how far it is", "200", "ImportView", _ID),
        },
        "/api/ledger/imports/{id}/preview": {
            "post": {
                **_operation("Look at the kept file again, otherwise", "200", "ImportView", _ID),
                "requestBody": _json("PreviewBody"),
            },
        },
        "/api/ledger/imports/{id}/commit": {
            "post": {
                **_operation(
                    "Book the rows. The wish is kept before this is answered and outlives any death; "
                    "the same wish again changes nothing",
                    "202",
                    "ImportView",
                    _ID,
                ),
                "requestBody": _json("CommitBody"),
            },
        },
    }


def _operation(summary: str, status: str, answer: str, *parameters: dict[str, Any]) -> dict[str, Any]:
    content = {"application/json": {"schema": {"$ref": f"#/components/schemas/{answer}"}}}
    return {
        "summary": summary,
        "parameters": list(parameters),
        "responses": {
            status: {"description": "The answer", "content": content},
            "default": _PROBLEM_RESPONSE,
        },
    }


def _json(body: str) -> dict[str, Any]:
    content = {"application/json": {"schema": {"$ref": f"#/components/schemas/{body}"}}}
    return {"required": False, "content": content}
