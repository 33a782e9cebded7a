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
from core.web.openapi_plans import BATCH_RESULTS, BUDGETS, SHAPES, plan_paths, two_phase_paths
from core.web.openapi_words import (
    AS_OF,
    IF_MATCH,
    KEY,
    PROBLEM_RESPONSE,
    get_of,
    limit_of,
    page_of,
    path_of,
    post_of,
    query_of,
    ref,
)
from core.web.problems import PROBLEM_KINDS, Outcome

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


def document() -> bytes:
    """Return the description as JSON."""
    _, shapes = msgspec.json.schema_components(
        (*_SHAPES, *SHAPES, *IMPORT_SHAPES), ref_template="#/components/schemas/{name}"
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
                "BatchResults": BATCH_RESULTS,
                "Budgets": BUDGETS,
            },
        },
    }
    return msgspec.json.encode(described)


def _paths() -> dict[str, Any]:
    return {
        "/api/ledger/accounts": {
            "get": get_of(
                "All accounts, by id; their versions are those of today",
                page_of("AccountView"),
                AS_OF,
                query_of("cursor"),
                limit_of(10_000),
            ),
            "post": post_of("Open an account", {"201": ref("AccountAnswer")}, "AccountBody"),
        },
        "/api/ledger/accounts/{id}": {
            "get": get_of("One account; its `ETag` is its version", ref("AccountView"), path_of("id"), AS_OF)
        },
        "/api/ledger/accounts/{id}/close": {
            "post": post_of(
                "Close an account: it takes no more postings",
                {"200": ref("AccountAnswer")},
                None,
                path_of("id"),
                IF_MATCH,
            ),
        },
        "/api/ledger/transactions": {
            "get": get_of(
                "Transactions, newest first",
                page_of("TransactionView"),
                query_of("account"),
                query_of("from", "First day, YYYY-MM-DD"),
                query_of("to", "Last day, YYYY-MM-DD"),
                query_of("q", "Words in the description"),
                query_of("state", "`posted` (as if absent) or `pending`: those that still wait"),
                query_of("cursor"),
                limit_of(500),
            ),
            "post": post_of("Book a transaction", {"201": ref("TransactionView")}, "TransactionBody"),
        },
        "/api/ledger/transactions/{id}": {
            "get": get_of("One transaction", ref("TransactionView"), path_of("id")),
        },
        **two_phase_paths(),
        **_household(),
        **plan_paths(),
        "/api/ledger/events": {
            "get": get_of(
                "Events in order; `next_cursor` is the next `after`",
                page_of("EventView"),
                query_of("after", "Begin after this sequence"),
                limit_of(500),
            ),
        },
        "/api/ledger/verify": {"get": get_of("Prove the whole book", ref("Verdict"))},
        "/api/ledger/export": {"get": _export()},
        "/api/ledger/drill": {
            "post": post_of(
                "The command of a drill, without effect; only the armed key's is there",
                {"200": ref("Drilled")},
                None,
            ),
        },
        "/api/ledger/commands/{key}": {
            "get": get_of("What became of a key (404: not done)", ref("LookUp"), path_of("key")),
        },
        **import_paths(KEY),
        "/api/openapi.json": {"get": get_of("This description", {"type": "object"})},
        "/healthz": {"get": get_of("Epoch and last sequence, without asking the store", ref("Health"))},
    }


def _household() -> dict[str, Any]:
    return {
        "/api/ledger/entries": {
            "get": get_of(
                "What stands of the household's entries, newest day first", page_of("EntryView"), *_LIST
            ),
            "post": post_of(
                "Write an entry down: minus was spent; accounts named for the first time are opened with it",
                {"201": ref("EntryView")},
                "EntryBody",
            ),
        },
        "/api/ledger/entries/{id}": {
            "get": get_of("The newest content of an entry", ref("EntryView"), path_of("id")),
            "put": post_of(
                "Have an entry say something else: what stood is reversed and kept",
                {"200": ref("EntryView")},
                "EntryChangeBody",
                path_of("id"),
            ),
            "delete": post_of(
                "Reverse an entry: nothing is ever deleted",
                {"200": ref("EntryReversal")},
                "EntryReversalBody",
                path_of("id"),
                body_required=False,
            ),
        },
        "/api/ledger/register": {
            "get": get_of(
                "What stands on an account (on all accounts of money), newest day first, with its balance",
                page_of("RegisterLine"),
                *_LIST,
            ),
        },
        "/api/ledger/summary": {
            "get": get_of(
                "A month in sums by the days of its entries, and what is owned now",
                ref("Summary"),
                query_of("month", "YYYY-MM; absent: the one of the server's calendar"),
            ),
        },
        "/api/ledger/categories": {
            "get": get_of(
                "Open categories by id", page_of("CategoryView"), query_of("cursor"), limit_of(10_000)
            ),
        },
    }


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
            "default": PROBLEM_RESPONSE,
        },
    }


_LIST: Final = (
    query_of("account", "Id of an account"),
    query_of("from", "First day, YYYY-MM-DD"),
    query_of("to", "Last day, YYYY-MM-DD"),
    query_of("q", "Words in the description or the category, or an amount"),
    query_of("cursor"),
    limit_of(500),
)
