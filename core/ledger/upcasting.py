"""Upcasting: an event that was written in an older shape, raised to the shape of today before it is read.

Events are never changed, so a kind that gets another shape keeps the old ones in the book for ever. Here stands, by kind
and version, how a body of that version becomes one of the next: a function from its members to its members. Reading goes
step by step, so each function is written once and never touched again. Not chosen: reading code that knows every shape,
which would spread the past over all rooms; and to write old events anew, which the chain forbids.
"""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, Final

import msgspec

Members = dict[str, Any]
#: kind -> version -> what makes the members of the next version of it.
Upcasts = Mapping[str, Mapping[int, Callable[[Members], Members]]]

#: Every kind still has its first shape.
UPCASTS: Final[Upcasts] = MappingProxyType({})


def raised(body: bytes, upcasts: Upcasts) -> bytes | None:
    """Return the body in the newest shape that there are steps to; None: there is no step from its own."""
    try:
        members = msgspec.json.decode(body)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None
    if not isinstance(members, dict) or not isinstance(members.get("kind"), str):
        return None
    steps = upcasts.get(members["kind"], {})
    first = members.get("v", 1)
    version = first
    while isinstance(version, int) and version in steps:
        version += 1
        members = {**steps[version - 1](members), "kind": members["kind"], "v": version}
    return msgspec.json.encode(members) if version != first else None
