"""The description of the API, OpenAPI 3.1, written by hand as data.

It says what is promised, and only that. Generating it from handlers was not chosen: a description that follows
the code can't tell anybody that the code has left its promise; a test compares routes, problems and the
shapes of answers with it instead.
"""

from typing import Any, Final

import msgspec

from core.journal.verify import Verdict
from core.ledger.commands import AccountBody, TransactionBody
from core.ledger.entries import EntryBody, EntryChangeBody, EntryReversalBody
from core.ledger.overview import CategoryView, RegisterLine, Summary
from core.ledger.reasons import Reason
from core.ledger.views import (
    AccountAnswer,
    AccountView,
    EntryReversal,
    EntryView,
    EventView,
    TransactionView,
)
from core.web.exporting import Format
from core.web.openapi_imports import (
    IMPORT_PROBLEM_MEMBERS,
    IMPORT_SHAPES,
    MAPPING_REASONS,
    import_paths,
)
from core.web.problems import PROBLEM_JSON, PROBLEM_KINDS, Outcome

API_VERSION: Final = "1.0.0"

_SHAPES: Final = (
    AccountBody,
    TransactionBody,
    AccountView,
    AccountAnswer,
    TransactionView,
    EventView,
    Verdict,
    EntryBody,
    EntryChangeBody,
    EntryReversalBody,
    EntryView,
    EntryReversal,
    RegisterLine,
    CategoryView,
    Summary,
)

_PROBLEM: Final[dict[str, Any]] = {
    "type": "object",
    "description": "RFC 9457. `outcome` stands wherever a request was not simply answered.",
    "required": ["type", "title", "status", "detail"],
    "properties": {
        "type": {"type": "string", "enum": [f"/problems/{slug}" for slug in sorted(PROBLEM_KINDS)]},
        "title": {"type": "string"},
        "status": {"type": "integer"},
        "detail": {"type": "string", "description": "In Korean or English, by Accept-Language."},
        "outcome": {"type": "string", "enum": [outcome.value for outcome in Outcome]},
        "retry_after": {"type": "integer", "description": "Seconds."},
        "safe": {
            "type": "string",
            "description": "Of `safe-mode`: the diagnosis because of which only reads are served.",
        },
        "letter": {
            "type": "string",
            "description": "Of `set-aside`, `account-set-aside` and `partly-done`: the number under which it is kept.",
        },
        "account": {"type": "string", "description": "Of `account-set-aside`: the account."},
        "rule": {"type": "string", "description": "Of `limited`: the rule that takes no more."},
        **IMPORT_PROBLEM_MEMBERS,
        "errors": {
            "type": "array",
            "items": {
                "type": "object",
                "required": ["pointer", "reason"],
                "properties": {
                    "pointer": {
                        "type": "string",
                        "description": "JSON pointer into the body, or `?name` for a parameter.",
                    },
                    "reason": {
                        "type": "string",
                        "enum": [*(reason.value for reason in Reason), *MAPPING_REASONS],
                    },
                },
            },
        },
    },
}

_LOOK_UP: Final[dict[str, Any]] = {
    "type": "object",
    "required": ["key", "outcome"],
    "properties": {
        "key": {"type": "string"},
        "outcome": {
            "type": "string",
            "enum": ["done", "unknown"],
            "description": "unknown: the key is another request's than the one that X-Request-Digest names.",
        },
        "status": {"type": "integer", "description": "The status the command was answered with."},
        "answer": {"type": "object", "description": "The answer, or the problem it was refused with."},
    },
}

_HEALTH: Final[dict[str, Any]] = {
    "type": "object",
    "required": ["epoch", "seq", "safe", "checkpoint"],
    "properties": {
        "epoch": {"type": "integer"},
        "seq": {"type": "integer"},
        "safe": {"type": ["string", "null"]},
        "checkpoint": {"type": ["string", "null"], "description": "The one that the start went by."},
    },
}

_DRILLED: Final[dict[str, Any]] = {"type": "object", "description": "Nothing was booked."}

_KEY: Final[dict[str, Any]] = {
    "name": "Idempotency-Key",
    "in": "header",
    "description": (
        "1 to 255 visible ASCII characters, made by the client, once per wish. The same key with the same "
        "wish gets the same answer with `Idempotent-Replayed: true`; with another wish it gets 422."
    ),
    "schema": {"type": "string", "minLength": 1, "maxLength": 255},
}


def document() -> bytes:
    """Return the description as JSON."""
    _, shapes = msgspec.json.schema_components(
        (*_SHAPES, *IMPORT_SHAPES), ref_template="#/components/schemas/{name}"
    )
    described = {
        "openapi": "3.1.0",
        "info": {
            "title": "Ledger",
            "version": API_VERSION,
            "description": (
                "Double entry: the postings of a transaction add up to zero in every currency, debit positive. "
                "Amounts are decimal strings. Every answer carries `X-Core-Epoch`."
            ),
        },
        "paths": _paths(),
        "components": {
            "schemas": {
                **shapes,
                "Problem": _PROBLEM,
                "LookUp": _LOOK_UP,
                "Health": _HEALTH,
                "Drilled": _DRILLED,
            },
        },
    }
    return msgspec.json.encode(described)


def _paths() -> dict[str, Any]:
    return {
        "/api/ledger/accounts": {
            "get": _get("All accounts, by id", _page("AccountView"), _query("cursor"), _limit(10_000)),
            "post": _post("Open an account", "201", "AccountAnswer", "AccountBody"),
        },
        "/api/ledger/accounts/{id}": {"get": _get("One account", _ref("AccountView"), _path("id"))},
        "/api/ledger/accounts/{id}/close": {
            "post": _post(
                "Close an account: it takes no more postings", "200", "AccountAnswer", None, _path("id")
            ),
        },
        "/api/ledger/transactions": {
            "get": _get(
                "Transactions, newest first",
                _page("TransactionView"),
                _query("account"),
                _query("from", "First day, YYYY-MM-DD"),
                _query("to", "Last day, YYYY-MM-DD"),
                _query("q", "Words in the description"),
                _query("cursor"),
                _limit(500),
            ),
            "post": _post("Book a transaction", "201", "TransactionView", "TransactionBody"),
        },
        "/api/ledger/transactions/{id}": {
            "get": _get("One transaction", _ref("TransactionView"), _path("id")),
        },
        **_household(),
        "/api/ledger/events": {
            "get": _get(
                "Events in order; `next_cursor` is the next `after`",
                _page("EventView"),
                _query("after", "Begin after this sequence"),
                _limit(500),
            ),
        },
        "/api/ledger/verify": {"get": _get("Prove the whole book", _ref("Verdict"))},
        "/api/ledger/export": {"get": _export()},
        "/api/ledger/drill": {
            "post": _post(
                "The command of a drill, without effect; only the armed key's is there",
                "200",
                "Drilled",
                None,
            ),
        },
        "/api/ledger/commands/{key}": {
            "get": _get("What became of a key (404: not done)", _ref("LookUp"), _path("key")),
        },
        **import_paths(_KEY),
        "/api/openapi.json": {"get": _get("This description", {"type": "object"})},
        "/healthz": {"get": _get("Epoch and last sequence, without asking the store", _ref("Health"))},
    }


def _household() -> dict[str, Any]:
    return {
        "/api/ledger/entries": {
            "get": _get(
                "What stands of the household's entries, newest day first", _page("EntryView"), *_LIST
            ),
            "post": _post(
                "Write an entry down: minus was spent; accounts named for the first time are opened with it",
                "201",
                "EntryView",
                "EntryBody",
            ),
        },
        "/api/ledger/entries/{id}": {
            "get": _get("The newest content of an entry", _ref("EntryView"), _path("id")),
            "put": _post(
                "Have an entry say something else: what stood is reversed and kept",
                "200",
                "EntryView",
                "EntryChangeBody",
                _path("id"),
            ),
            "delete": _post(
                "Reverse an entry: nothing is ever deleted",
                "200",
                "EntryReversal",
                "EntryReversalBody",
                _path("id"),
                body_required=False,
            ),
        },
        "/api/ledger/register": {
            "get": _get(
                "What stands on an account (on all accounts of money), newest day first, with its balance",
                _page("RegisterLine"),
                *_LIST,
            ),
        },
        "/api/ledger/summary": {
            "get": _get(
                "A month in sums by the days of its entries, and what is owned now",
                _ref("Summary"),
                _query("month", "YYYY-MM; absent: the one of the server's calendar"),
            ),
        },
        "/api/ledger/categories": {
            "get": _get("Open categories by id", _page("CategoryView"), _query("cursor"), _limit(10_000)),
        },
    }


def _get(summary: str, shape: dict[str, Any], *parameters: dict[str, Any]) -> dict[str, Any]:
    responses = {"200": _content("The answer", shape), "default": _PROBLEM_RESPONSE}
    return {"summary": summary, "parameters": list(parameters), "responses": responses}


def _post(
    summary: str,
    status: str,
    answer: str,
    body: str | None,
    *parameters: dict[str, Any],
    body_required: bool = True,
) -> dict[str, Any]:
    described: dict[str, Any] = {
        "summary": summary,
        "parameters": [*parameters, _KEY],
        "responses": {status: _content("Done", _ref(answer)), "default": _PROBLEM_RESPONSE},
    }
    if body is not None:
        content = {"application/json": {"schema": _ref(body)}}
        described["requestBody"] = {"required": body_required, "content": content}
    return described


def _export() -> dict[str, Any]:
    text = {"schema": {"type": "string"}}
    header = {"description": "The last event in it.", "schema": {"type": "integer"}}
    forms = {"type": "string", "enum": list(Format)}
    return {
        "summary": "The whole book of one moment, as a file",
        "parameters": [{"name": "format", "in": "query", "required": True, "schema": forms}],
        "responses": {
            "200": {
                "description": "Streamed; one that is cut off is not whole.",
                "headers": {"X-Ledger-Seq": header},
                "content": {
                    "text/csv": text,
                    "text/plain": text,
                    "application/json": {"schema": {"type": "object"}},
                },
            },
            "default": _PROBLEM_RESPONSE,
        },
    }


def _ref(name: str) -> dict[str, Any]:
    return {"$ref": f"#/components/schemas/{name}"}


def _page(item: str) -> dict[str, Any]:
    return {
        "type": "object",
        "required": ["items", "next_cursor"],
        "properties": {
            "items": {"type": "array", "items": _ref(item)},
            "next_cursor": {"type": ["string", "null"]},
        },
    }


def _path(name: str) -> dict[str, Any]:
    return {"name": name, "in": "path", "required": True, "schema": {"type": "string"}}


def _query(name: str, description: str = "") -> dict[str, Any]:
    return {"name": name, "in": "query", "description": description, "schema": {"type": "string"}}


def _limit(most: int) -> dict[str, Any]:
    schema = {"type": "integer", "minimum": 1, "maximum": most}
    return {"name": "limit", "in": "query", "schema": schema}


def _content(description: str, shape: dict[str, Any]) -> dict[str, Any]:
    return {"description": description, "content": {"application/json": {"schema": shape}}}


_LIST: Final = (
    _query("account", "Id of an account"),
    _query("from", "First day, YYYY-MM-DD"),
    _query("to", "Last day, YYYY-MM-DD"),
    _query("q", "Words in the description or the category, or an amount"),
    _query("cursor"),
    _limit(500),
)

_PROBLEM_RESPONSE: Final = {
    "description": "A problem",
    "content": {PROBLEM_JSON: {"schema": _ref("Problem")}},
}
