"""Who asks, and whether it may: what a request brings along is held against who may come in. Pure.

A table of a few lines. Without a password whoever reaches this machine's own address is the owner. With one, a browser
needs a session and says of everything that changes something that a page of ours sends it; a program needs a token.
"""

from collections.abc import Sequence
from typing import Final

import msgspec
from msgspec import structs

from hardcore.access.people import OWNER, People, Scope
from hardcore.access.sessions import Session, Sessions
from hardcore.crisis.heads import Header, RequestHead, cookie_value
from hardcore.crisis.problems import Problem
from hardcore.crisis.routing import Route

#: The names of the cookie: encrypted, no other host and no plain page can set it; in the open the prefix is refused.
SECURE_COOKIE: Final = b"__Host-hc-session"
PLAIN_COOKIE: Final = b"hc-session"
COOKIES: Final = (SECURE_COOKIE, PLAIN_COOKIE)
_BEARER: Final = b"bearer "

#: Answered to everybody: they hold no word of the ledger, and the page to sign in with needs some of them.
PUBLIC: Final = frozenset(
    {Route.LIVE, Route.READY, Route.STARTUP, Route.HEALTH, Route.METRICS, Route.OWN, Route.GATE}
)


class Visitor(msgspec.Struct, frozen=True):
    """Somebody who was let in. `proven`: his password was typed just now; None: he needs none here."""

    name: str
    scope: Scope
    proven: bool | None = None
    session: Session | None = None


#: Whoever runs the server, at the server.
THE_OWNER: Final = Visitor(OWNER, Scope.ADMIN)


def cookie_of(*, https: bool) -> bytes:
    """What the session's cookie is called."""
    return SECURE_COOKIE if https else PLAIN_COOKIE


def visitor_of(
    head: RequestHead, people: People, sessions: Sessions, now_ns: int, *, https: bool
) -> Visitor | Problem:
    """Who asks, by what the request brings along."""
    if head.authorization[: len(_BEARER)].lower() == _BEARER:
        token = people.token(head.authorization[len(_BEARER) :].strip().decode("latin-1"))
        return (
            Visitor(f"token:{token.name}", token.scope, proven=True)
            if token is not None
            else Problem.TOKEN_WRONG
        )
    secret = cookie_value(head.cookie, cookie_of(https=https))
    session = sessions.of(secret.decode("latin-1"), people, now_ns) if secret is not None else None
    person = people.person(session.name) if session is not None else None
    if session is None or person is None:
        return Problem.SIGN_IN_NEEDED
    return Visitor(person.name, person.scope, sessions.is_proven(session, now_ns), session)


def judged(visitor: Visitor, head: RequestHead, way: Route) -> Problem | None:
    """Why somebody who was let in may not do this; None: he may."""
    if way in {Route.ADMIN, Route.DRILL} and visitor.scope is not Scope.ADMIN:
        return Problem.NOT_ALLOWED
    if head.safe:
        return None
    if visitor.session is not None and not head.own_page:
        return Problem.FOREIGN_PAGE  # a cookie comes along whoever sends the request
    return Problem.NOT_ALLOWED if visitor.scope is Scope.READ else None


def without_credentials(head: RequestHead, own: Sequence[Header]) -> RequestHead:
    """The same request without what opened the door. `own`: what is said instead."""
    left = [pair for pair in head.cookie.split(b";") if pair.strip().partition(b"=")[0] not in COOKIES]
    cookie = b";".join(left).strip()
    headers = [one for one in head.headers if one[0].lower() not in {b"cookie", b"authorization"}]
    if cookie:
        headers.append((b"Cookie", cookie))
    return structs.replace(head, headers=(*headers, *own), cookie=cookie, authorization=b"")
