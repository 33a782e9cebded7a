"""Whether somebody else's page asks: one rule for requests and for sockets.

Any web page may send requests to a loopback port, and one whose name was made to point to loopback may read the
answers too. So a core on a port of its own answers under this machine's own names alone, whatever is asked; and
what does something, or goes on telling, it answers only to its own pages. A browser says by itself where a request
comes from; a program says nothing and is believed, because it reaches this core only from the same machine. On a
Unix socket nothing is asked here: whoever may open it has judged that already. Tokens in forms were not chosen: they
need a session to be kept in, and every browser of this decade sends `Sec-Fetch-Site` or at least `Origin`.
"""

import re
from typing import Final

from starlette.requests import HTTPConnection

SAFE_METHODS: Final = frozenset({"GET", "HEAD", "OPTIONS"})

_OWN: Final = frozenset({"same-origin", "none"})
_LOOPBACK: Final = re.compile(r"(127\.0\.0\.1|localhost|\[::1\])(:[0-9]{1,5})?")


def is_foreign(asked: HTTPConnection) -> bool:
    """Whether this request, or this opening of a socket, is one of somebody else's page."""
    server = asked.scope.get("server")
    if server is None or server[1] is None:
        return False
    host = asked.headers.get("host", "").strip().lower()
    if host and _LOOPBACK.fullmatch(host) is None:
        return True
    # A link on another site may lead here: reading is answered to the person who followed it.
    is_read = asked.scope["type"] == "http" and asked.scope["method"] in SAFE_METHODS
    return not is_read and _is_of_another_origin(asked, host)


def _is_of_another_origin(asked: HTTPConnection, host: str) -> bool:
    site = asked.headers.get("sec-fetch-site")
    if site is not None and site.strip().lower() not in _OWN:
        return True
    origin = asked.headers.get("origin")
    return origin is not None and origin.strip().lower() != f"http://{host}"
