"""What a program asks for, read strictly: a name that nobody knows, or a value of another type, is no wish at all.

A misspelt filter that narrows nothing would mean every letter there is. So a request is understood whole or answered
400, before anything is done; to pass over what is unknown, as pages do with an old bookmark, was not chosen here.
"""

import json
from collections.abc import Mapping, Sequence
from typing import Any, Final

from msgspec import structs
from starlette.exceptions import HTTPException
from starlette.requests import Request

from postmortem.views import Filter

TEXT_CHARACTERS_MAX: Final = 256
#: What any address may be asked beside a filter.
_ABOUT: Final = frozenset({"limit", "cursor", "lang", "weeks", "incident"})
_FILTERS: Final = tuple(one.name for one in structs.fields(Filter) if one.name != "drills")
_NO: Final = ("0", "false", False)
_YES: Final = ("1", "true", True)


def listed(query: Mapping[str, str]) -> Filter:
    """The filter of an address. Raises HTTPException (400) for a name that no address has."""
    return narrowed({name: value for name, value in query.items() if name not in _ABOUT})


def narrowed(given: Mapping[str, Any]) -> Filter:
    """The filter of a body. Raises HTTPException (400) for an unknown name, another type, or what can't be seen."""
    if not given.keys() <= {*_FILTERS, "drills"}:
        raise HTTPException(400)
    told = {name: name_in(given, name) for name in _FILTERS}
    return Filter(**told, drills=flag(given, "drills", otherwise=True))


def meant(told: Mapping[str, Any]) -> Filter | Sequence[str]:
    """Which letters a body means: those of `ids`, or those that fit `where`, which has to narrow something."""
    ids, where = told.get("ids"), told.get("where")
    if isinstance(ids, list) and where is None:
        return [name_in({"id": one}, "id") for one in ids]
    if not isinstance(where, dict) or ids is not None:
        raise HTTPException(400)
    wanted = narrowed(where)
    if wanted == Filter(drills=wanted.drills):
        raise HTTPException(400)  # all of them is never meant by saying nothing
    return wanted


def name_in(given: Mapping[str, Any], name: str) -> str:
    """A name or an id out of a body, empty where it is absent."""
    value = given.get(name, "")
    if not isinstance(value, str) or len(value) > TEXT_CHARACTERS_MAX or not value.isprintable():
        raise HTTPException(400)
    return value


def text_in(given: Mapping[str, Any], name: str) -> str:
    """What a person wrote, empty where it is absent; it is made harmless where it is kept (`wording`)."""
    value = given.get(name, "")
    if not isinstance(value, str):
        raise HTTPException(400)
    return value


def flag(given: Mapping[str, Any], name: str, *, otherwise: bool) -> bool:
    """A yes or a no, in the words that a form and JSON have for it."""
    value = given.get(name, otherwise)
    if isinstance(value, bool | str) and value in (*_NO, *_YES):
        return value in _YES
    raise HTTPException(400)


async def body_of(request: Request, *names: str) -> Mapping[str, Any]:
    """The body as an object: JSON's, or a form's fields. Raises HTTPException (400) for another, and for other names."""
    body = await request.body()
    told: Any = {}
    if request.headers.get("content-type", "").startswith("application/x-www-form-urlencoded"):
        told = dict(await request.form())
    elif body:
        try:
            told = json.loads(body)
        except (ValueError, RecursionError):
            raise HTTPException(400) from None
    if not isinstance(told, dict) or not told.keys() <= {*names, "_csrf"}:
        raise HTTPException(400)
    return told
