"""Whether somebody else's page makes a request.

A browser says by itself where a request comes from; a program says nothing and is believed, because it can reach
this core only from the same machine. A gateway asks the same before it lets anything through; a core that runs
alone has nobody before it, so it asks too. Tokens in forms were not chosen: they need a session to be kept in,
and every browser of this decade sends `Sec-Fetch-Site` or at least `Origin`.
"""

from collections.abc import Mapping
from typing import Final

_OWN: Final = frozenset({"same-origin", "none"})


def is_foreign(headers: Mapping[str, str]) -> bool:
    """Whether a browser says that a page of another origin makes this request. Names in lower case."""
    site = headers.get("sec-fetch-site")
    if site is not None and site.strip().lower() not in _OWN:
        return True
    origin = headers.get("origin")
    if origin is None:
        return False
    _scheme, _, authority = origin.strip().lower().partition("://")
    return authority != headers.get("host", "").lower()
