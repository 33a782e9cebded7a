"""Signing in and out: the gateway's own pages for it, in every phase, and what happens behind them.

A form and a cookie, readable without scripts. Passwords are compared on a thread, few at a time, because each costs memory
on purpose; who guesses waits. A page that was asked for is answered with the form in its own place, so that the address
stays and what follows leads back to it. A link from elsewhere does not carry a strict cookie: the page then looks once
whether its reader is signed in, and opens again. Sessions in a header that scripts keep were not chosen: a script can be
made to give them away, a cookie that none can read cannot.
"""

import asyncio
import html
import json
import secrets
import time
from collections.abc import Callable, Coroutine
from functools import partial
from typing import Final
from urllib.parse import parse_qsl, urlencode

from hardcore.access import passwords
from hardcore.access.attempts import Attempts
from hardcore.access.people import People, Person, Scope, is_name
from hardcore.crisis import pages
from hardcore.crisis.exchange import Exchange
from hardcore.crisis.gate import FORM_BYTES_MAX, Gate
from hardcore.crisis.heads import Header, RequestHead
from hardcore.crisis.limits import GatewayLimits
from hardcore.crisis.mishap import contained
from hardcore.crisis.problems import Problem
from hardcore.crisis.receipts_form import is_own_path
from hardcore.crisis.routing import INVITED_PATH, ME_PATH, SIGN_IN_PATH, SIGN_OUT_PATH
from hardcore.crisis.shelf import TO_MARK, WHO_MARK, Sheet
from hardcore.crisis.visitors import COOKIES, PLAIN_COOKIE, Visitor, cookie_of, visitor_of

#: Passwords that are compared at a time, and those that may wait for it.
AT_ONCE: Final = 2
WAITING_MAX: Final = 16
_FIELDS_MAX: Final = 16
_SECRET_BYTES: Final = 32
_YEAR_S: Final = 31_536_000
_NS_PER_MS: Final = 1_000_000
_NS_PER_S: Final = 1_000_000_000


class SignIn:
    """The acts at the gate. `sheet` gives a rendered page by its kind and reader, `stocked` does something once there are."""

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        gate: Gate,
        limits: GatewayLimits,
        sheet: Callable[[str, str], Sheet | None],
        stocked: Callable[[Callable[[], None]], None],
    ) -> None:
        self._loop = loop
        self._gate = gate
        self._sheet = sheet
        self._stocked = stocked
        self._attempts = Attempts(limits.sign_in_tries_max, limits.sign_in_every_ms * _NS_PER_MS)
        self._room = asyncio.Semaphore(AT_ONCE)
        self._waiting = 0
        self._tasks: set[asyncio.Task[None]] = set()

    # -- whoever was not let in ------------------------------------------------------------------------

    def turned_away(self, exchange: Exchange, problem: Problem) -> None:
        """Answer a request that may not come in: a tab with the form, a program with the reason."""
        head = exchange.head
        if head.navigation and problem is Problem.SIGN_IN_NEEDED:
            to = head.target.decode("latin-1") if head.method == "GET" else pages.way_back(head) or "/"
            kind = "in" if head.method == "GET" else "unsent"
            self._show(exchange, kind, to, status=401)
        elif head.navigation:
            self._give(exchange, pages.plain(problem, head))
        else:
            self._give(exchange, self._gate.refusal(problem, head))

    # -- the gate's own paths --------------------------------------------------------------------------

    def asked(self, exchange: Exchange) -> None:
        """A request for one of the gate's own paths."""
        head = exchange.head
        match head.method, head.path:
            case "GET" | "HEAD", path if path == ME_PATH:
                self._give(exchange, self._me(exchange))
            case "GET" | "HEAD", path if path in {SIGN_IN_PATH, INVITED_PATH}:
                self._page(exchange, _query(head))
            case "POST", path if path in {SIGN_IN_PATH, INVITED_PATH}:
                self._soon(exchange, self._tried(exchange, _form(exchange)))
            case "POST", path if path == SIGN_OUT_PATH:
                self._sign_out(exchange)
            case _:
                self._give(exchange, pages.problem(Problem.METHOD_NOT_ALLOWED, head.accept_language))

    def _me(self, exchange: Exchange) -> pages.Answer:
        """Who this browser is signed in as."""
        visitor = self._visitor(exchange)
        if visitor is None and self._gate.closed:
            return self._gate.refusal(Problem.SIGN_IN_NEEDED, exchange.head)
        name, scope = (visitor.name, visitor.scope) if visitor is not None else (None, Scope.ADMIN)
        told = {"name": name, "scope": scope, "proven": visitor.proven if visitor is not None else None}
        return pages.whole(200, b"application/json", json.dumps(told).encode())

    def _page(self, exchange: Exchange, asked: dict[str, str]) -> None:
        head = exchange.head
        to = _own_path(asked.get("to", "/"))
        extra: list[Header] = []
        if (lang := asked.get("lang", "")) in {"ko", "en"}:
            extra.append((b"Set-Cookie", f"lang={lang}; Path=/; Max-Age={_YEAR_S}; SameSite=Lax".encode()))
        if head.path == INVITED_PATH:
            people, key = self._gate.people, asked.get("key", "")
            invited = people.invitation(key, time.time()) if isinstance(people, People) else None
            kind = "invited" if invited is not None else "gone"
            self._show(exchange, kind, key, who=invited.name if invited else "", extra=extra, lang=lang)
            return
        visitor = self._visitor(exchange)
        if not self._gate.closed or (visitor is not None and "again" not in asked):
            self._give(exchange, pages.elsewhere(to, extra))
            return
        who = visitor.name if visitor is not None else ""
        kind = "again" if visitor is not None else "out" if "out" in asked else "in"
        self._show(exchange, kind, to, who=who, extra=extra, lang=lang)

    def _sign_out(self, exchange: Exchange) -> None:
        visitor = self._visitor(exchange)
        if visitor is not None and visitor.session is not None:
            if not exchange.head.own_page:
                self._give(exchange, self._gate.refusal(Problem.FOREIGN_PAGE, exchange.head))
                return
            self._gate.sessions.end(visitor.session.digest)
        cleared = [(b"Set-Cookie", b"%b=; Path=/; Max-Age=0; HttpOnly; SameSite=Strict" % PLAIN_COOKIE)]
        cleared.append(
            (b"Set-Cookie", b"%b=; Path=/; Max-Age=0; HttpOnly; SameSite=Strict; Secure" % COOKIES[0])
        )
        # What was typed and not sent is nobody else's: a browser that knows this word forgets it.
        cleared.append((b"Clear-Site-Data", b'"storage"'))
        self._give(exchange, pages.elsewhere(f"{SIGN_IN_PATH.decode()}?out=1", cleared))

    # -- passwords -------------------------------------------------------------------------------------

    async def _tried(self, exchange: Exchange, form: dict[str, str]) -> None:
        """Somebody has typed a password."""
        gate, head = self._gate, exchange.head
        came = gate.client(head, exchange.client.address)
        if came.refused:
            self._give(exchange, gate.refusal(Problem.AROUND_THE_PROXY, head))
            return
        wait_ns = self._attempts.wait_ns(came.address, gate.now_ns())
        if wait_ns or self._waiting >= WAITING_MAX:
            self._wait(exchange, form, max(1, -(-wait_ns // _NS_PER_S)))
            return
        self._waiting += 1
        try:
            async with self._room:
                if head.path == INVITED_PATH:
                    await self._accept(exchange, form, https=came.https)
                else:
                    await self._compare(exchange, form, came.address, https=came.https)
        finally:
            self._waiting -= 1

    async def _compare(self, exchange: Exchange, form: dict[str, str], address: str, *, https: bool) -> None:
        people = self._gate.people
        if not isinstance(people, People):
            self._give(exchange, pages.plain(Problem.ACCESS_UNREADABLE, exchange.head))
            return
        visitor = self._visitor(exchange)
        again = visitor if visitor is not None and visitor.session is not None and "again" in form else None
        name = again.name if again is not None else form.get("name", "").strip().lower()
        person = people.person(name) if is_name(name) else None
        secret = person.secret if person is not None else None
        typed = form.get("password", "")[: passwords.BYTES_MAX]
        right = await self._loop.run_in_executor(None, passwords.is_right, typed, secret)
        to = _own_path(form.get("to", "/"))
        if not right or person is None:
            kind = "again_wrong" if again is not None else "wrong"
            self._show(exchange, kind, to, who=name if is_name(name) else "", status=401)
            return
        self._attempts.forgive(address)
        if again is not None and again.session is not None:
            self._gate.sessions.prove(again.session, self._gate.now_ns())
            self._give(exchange, pages.elsewhere(to))
            return
        self._let_in(exchange, person, to, https=https)

    async def _accept(self, exchange: Exchange, form: dict[str, str], *, https: bool) -> None:
        """Somebody who was invited chooses a password."""
        people, key = self._gate.people, form.get("key", "")
        invited = people.invitation(key, time.time()) if isinstance(people, People) else None
        if invited is None or not isinstance(people, People):
            self._show(exchange, "gone", "", status=410)
            return
        typed = form.get("password", "")
        if not passwords.is_usable(typed) or typed != form.get("again", ""):
            kind = "differ" if passwords.is_usable(typed) else "short"
            self._show(exchange, kind, key, who=invited.name, status=422)
            return
        secret = await self._loop.run_in_executor(None, passwords.kept, typed)
        person = Person(invited.name, secret)

        def accepted(now: People) -> People | None:  # another tab may have been quicker
            return now.with_person(person) if now.invitation(key, time.time()) is not None else None

        try:
            changed = await self._gate.change_people(accepted)
        except OSError:
            self._show(exchange, "not_kept", key, who=invited.name, status=503)
            return
        if isinstance(changed, People):
            self._let_in(exchange, person, "/", https=https)
        else:
            self._show(exchange, "gone", "", status=410)

    def _let_in(self, exchange: Exchange, person: Person, to: str, *, https: bool) -> None:
        secret = secrets.token_urlsafe(_SECRET_BYTES)
        self._gate.sessions.begin(secret, person, self._gate.now_ns())
        cookie = f"{cookie_of(https=https).decode()}={secret}; Path=/; HttpOnly; SameSite=Strict"
        cookie += "; Secure" if https else ""
        self._give(exchange, pages.elsewhere(to, [(b"Set-Cookie", cookie.encode())]))

    # -- what is shown ---------------------------------------------------------------------------------

    def _visitor(self, exchange: Exchange) -> Visitor | None:
        people = self._gate.people
        if not isinstance(people, People) or not people.closed:
            return None
        https = self._gate.client(exchange.head, exchange.client.address).https
        found = visitor_of(exchange.head, people, self._gate.sessions, self._gate.now_ns(), https=https)
        return None if isinstance(found, Problem) else found

    def _wait(self, exchange: Exchange, form: dict[str, str], seconds: int) -> None:
        head = exchange.head
        to, who = _own_path(form.get("to", "/")), form.get("name", "")
        extra = [(b"Retry-After", b"%d" % seconds)]
        if head.path == INVITED_PATH or not head.navigation:
            made = pages.problem(Problem.TRY_LATER, head.accept_language, again_s=seconds)
            self._give(exchange, made)
        else:
            self._show(exchange, "wait", to, who=who if is_name(who) else "", extra=extra, status=429)

    def _show(
        self,
        exchange: Exchange,
        kind: str,
        to: str,
        *,
        who: str = "",
        status: int = 200,
        extra: list[Header] | None = None,
        lang: str = "",
    ) -> None:
        """Answer with a page of the gate, as soon as there is one."""
        people = self._gate.people
        alone = isinstance(people, People) and len(people.people) == 1
        who = who or (people.people[0].name if alone and isinstance(people, People) else "")
        self._stocked(partial(self._draw, exchange, kind, to, who, status, extra or [], lang))

    def _draw(
        self, exchange: Exchange, kind: str, to: str, who: str, status: int, extra: list[Header], lang: str
    ) -> None:
        head = exchange.head
        sheet = self._sheet(kind, lang or head.accept_language)
        if sheet is None:
            self._give(exchange, pages.plain(Problem.SIGN_IN_NEEDED, head))
            return
        link = urlencode({"to": to} if head.path != INVITED_PATH else {"key": to})
        body = sheet.plain.replace(b"?" + TO_MARK, b"?" + html.escape(link).encode())
        body = body.replace(TO_MARK, html.escape(to).encode()).replace(WHO_MARK, html.escape(who).encode())
        self._give(exchange, pages.with_headers(pages.filled(sheet, head, body, status), extra))

    @staticmethod
    def _give(exchange: Exchange, answer: pages.Answer) -> None:
        exchange.client.answer(answer.head, answer.body)

    def _soon(self, exchange: Exchange, deed: Coroutine[object, object, None]) -> None:
        task = self._loop.create_task(deed)
        self._tasks.add(task)
        task.add_done_callback(partial(self._done, exchange))

    def _done(self, exchange: Exchange, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        if not task.cancelled() and not contained("signing in", task.result):
            self._give(exchange, pages.problem(Problem.GATEWAY_FAULT, exchange.head.accept_language))


def _own_path(text: str) -> str:
    """A path of ours, whatever was asked for; and never the gate itself, which would lead in a circle."""
    ours = is_own_path(text) and not text.startswith((SIGN_IN_PATH.decode(), SIGN_OUT_PATH.decode()))
    return text if ours else "/"


def _query(head: RequestHead) -> dict[str, str]:
    return _fields(head.target.partition(b"?")[2])


def _form(exchange: Exchange) -> dict[str, str]:
    if exchange.streamed or not exchange.whole or exchange.received_bytes > FORM_BYTES_MAX:
        return {}
    return _fields(b"".join(exchange.body))


def _fields(data: bytes) -> dict[str, str]:
    try:
        pairs = parse_qsl(data.decode("ascii"), keep_blank_values=True, max_num_fields=_FIELDS_MAX)
    except ValueError:
        return {}
    return dict(pairs)
