"""The description of what is done in two phases, of many transactions at once, of assertions and of plans: OpenAPI 3.1.

It stands beside `openapi.py` as `openapi_imports.py` does, with the words that all of them are made of in
`openapi_words.py`; the shapes are those of the types that bodies are decoded into and answers are encoded from.
"""

from typing import Any, Final

from core.ledger.budgets import BudgetLine
from core.ledger.commands import AccountAssertionBody, BatchBody, PendingPostBody
from core.ledger.plan_views import PlanAnswer, RecurringView
from core.ledger.plans import BudgetBody, RecurringBody
from core.ledger.seen import SeenBody
from core.ledger.views import AssertionView, BatchAnswer, PendingEnd
from core.web.openapi_words import get_of, limit_of, page_of, path_of, post_of, query_of, ref

SHAPES: Final = (
    PendingPostBody,
    SeenBody,
    BatchBody,
    BatchAnswer,
    PendingEnd,
    AccountAssertionBody,
    AssertionView,
    BudgetBody,
    BudgetLine,
    RecurringBody,
    RecurringView,
    PlanAnswer,
)

#: What is answered to a batch of which each transaction stands for itself.
BATCH_RESULTS: Final[dict[str, Any]] = {
    "type": "object",
    "required": ["done", "refused", "results"],
    "properties": {
        "done": {"type": "integer"},
        "refused": {"type": "integer"},
        "results": {
            "type": "array",
            "items": {
                "type": "object",
                "required": ["index", "status"],
                "properties": {
                    "index": {"type": "integer", "description": "The place in `transactions`."},
                    "status": {"type": "integer"},
                    "id": {"type": "string"},
                    "seq": {"type": "integer"},
                    "state": {"type": "string"},
                    "problem": {"$ref": "#/components/schemas/Problem"},
                },
            },
        },
    },
}

BUDGETS: Final[dict[str, Any]] = {
    "type": "object",
    "required": ["month", "items", "next_cursor"],
    "properties": {
        "month": {"type": "string"},
        "items": {"type": "array", "items": {"$ref": "#/components/schemas/BudgetLine"}},
        "next_cursor": {"type": "null"},
    },
}

_MONTH: Final = query_of("month", "YYYY-MM; absent: the one of the server's calendar")


def two_phase_paths() -> dict[str, Any]:
    """Return what can be done with transactions beside booking them."""
    return {
        "/api/ledger/transactions/batch": {
            "post": post_of(
                "Book up to 8,190 transactions: `atomic`, all or none (201); else each by itself (200), the nth "
                "under the key of the request, a colon and n with four digits",
                {"200": ref("BatchResults"), "201": ref("BatchAnswer")},
                "BatchBody",
            ),
        },
        "/api/ledger/transactions/{id}/post": {
            "post": post_of(
                "Book what is pending, all of it or what `postings` say; what is left of it is released",
                {"201": ref("TransactionView")},
                "PendingPostBody",
                path_of("id"),
                body_required=False,
            ),
        },
        "/api/ledger/transactions/{id}/void": {
            "post": post_of(
                "Give up what is pending",
                {"200": ref("PendingEnd")},
                "SeenBody",
                path_of("id"),
                body_required=False,
            ),
        },
        "/api/ledger/transactions/{id}/expire": {
            "post": post_of(
                "Free what a pending transaction holds that has run out",
                {"200": ref("PendingEnd")},
                None,
                path_of("id"),
                body_required=False,
            ),
        },
        "/api/ledger/transactions/{id}/reverse": {
            "post": post_of(
                "Book the opposite of a transaction, once; nothing is ever deleted",
                {"201": ref("TransactionView")},
                "SeenBody",
                path_of("id"),
                body_required=False,
            ),
        },
        "/api/ledger/accounts/{id}/assertions": {
            "get": get_of(
                "What was asserted of an account, newest first",
                page_of("AssertionView"),
                path_of("id"),
                query_of("cursor"),
                limit_of(500),
            ),
            "post": post_of(
                "Write down what the account stood at by the end of a day, and whether it does",
                {"201": ref("AssertionView")},
                "AccountAssertionBody",
                path_of("id"),
            ),
        },
    }


def plan_paths() -> dict[str, Any]:
    """Return what can be done with plans."""
    item = path_of("id")
    return {
        "/api/ledger/budgets": {
            "get": get_of(
                "What is meant for a month by category, and what was spent", ref("Budgets"), _MONTH
            ),
            "put": post_of(
                "Set what is meant for a category from a month on; `amount` null: nothing any more",
                {"200": ref("PlanAnswer")},
                "BudgetBody",
                _MONTH,
            ),
        },
        "/api/ledger/recurring": {
            "get": get_of(
                "What comes back, with its next days",
                page_of("RecurringView"),
                query_of("cursor"),
                limit_of(500),
            ),
            "post": post_of("Have something come back", {"201": ref("PlanAnswer")}, "RecurringBody"),
        },
        "/api/ledger/recurring/{id}": {
            "get": get_of("One of them, with what became of its last days", ref("RecurringView"), item),
            "put": post_of(
                "Change it from today on; what it has booked stays",
                {"200": ref("PlanAnswer")},
                "RecurringBody",
                item,
            ),
            "delete": post_of("End it; what it has booked stays", {"200": ref("PlanAnswer")}, None, item),
        },
    }
