"""The words of which the descriptions of the API are made: a question, a command, a page, a parameter.

Data in, data out: whoever describes a path says what is its own, and what all of them promise (the key, the problems) is
said once, here.
"""

from typing import Any, Final

from core.web.problems import PROBLEM_JSON

KEY: Final[dict[str, Any]] = {
    "name": "Idempotency-Key",
    "in": "header",
    "description": (
        "1 to 255 visible ASCII characters, made by the client, once per wish. The same key with the same "
        "wish gets the same answer with `Idempotent-Replayed: true`; with another wish it gets 422."
    ),
    "schema": {"type": "string", "minLength": 1, "maxLength": 255},
}


PROBLEM_RESPONSE: Final = {
    "description": "A problem",
    "content": {PROBLEM_JSON: {"schema": {"$ref": "#/components/schemas/Problem"}}},
}


IF_MATCH: Final[dict[str, Any]] = {
    "name": "If-Match",
    "in": "header",
    "description": "The account's `ETag` as it was seen; 412 if anything has touched the account since.",
    "schema": {"type": "string"},
}


def get_of(summary: str, shape: dict[str, Any], *parameters: dict[str, Any]) -> dict[str, Any]:
    """Describe a question: what is asked, the shape of its answer, its parameters."""
    responses = {"200": content("The answer", shape), "default": PROBLEM_RESPONSE}
    return {"summary": summary, "parameters": list(parameters), "responses": responses}


def post_of(
    summary: str,
    answers: dict[str, dict[str, Any]],
    body: str | None,
    *parameters: dict[str, Any],
    body_required: bool = True,
) -> dict[str, Any]:
    """Describe a command: the shapes of its answers by their status, that of its body (None: it has none)."""
    described: dict[str, Any] = {
        "summary": summary,
        "parameters": [*parameters, KEY],
        "responses": {
            **{status: content("Done", shape) for status, shape in answers.items()},
            "default": PROBLEM_RESPONSE,
        },
    }
    if body is not None:
        described["requestBody"] = {
            "required": body_required,
            "content": {"application/json": {"schema": ref(body)}},
        }
    return described


def ref(name: str) -> dict[str, Any]:
    """Name a shape that is described."""
    return {"$ref": f"#/components/schemas/{name}"}


def page_of(item: str) -> dict[str, Any]:
    """Describe a page of a list."""
    return {
        "type": "object",
        "required": ["items", "next_cursor"],
        "properties": {
            "items": {"type": "array", "items": ref(item)},
            "next_cursor": {"type": ["string", "null"]},
        },
    }


def path_of(name: str) -> dict[str, Any]:
    """Describe a part of a path."""
    return {"name": name, "in": "path", "required": True, "schema": {"type": "string"}}


def query_of(name: str, description: str = "") -> dict[str, Any]:
    """Describe a parameter of a query."""
    return {"name": name, "in": "query", "description": description, "schema": {"type": "string"}}


def limit_of(most: int) -> dict[str, Any]:
    """Describe how many items may be asked for."""
    schema = {"type": "integer", "minimum": 1, "maximum": most}
    return {"name": "limit", "in": "query", "schema": schema}


def content(description: str, shape: dict[str, Any]) -> dict[str, Any]:
    """Describe an answer of this shape."""
    return {"description": description, "content": {"application/json": {"schema": shape}}}


AS_OF: Final = query_of(
    "as_of", "YYYY-MM-DD: what stood by the end of that day; what is pending is not in it"
)
