"""Carrying requests to the serving core: over a free connection or a new one, whole or piece by piece.

A sending that finds no connection has not happened: the dial's refusal comes back as "not run", and only a
request whose bytes were written counts as seen by a core. Looking a key up is a sending of another kind,
with a question of our own instead of the client's.
"""

import json
import secrets
from collections.abc import Callable
from typing import Protocol
from urllib.parse import quote

from hardcore.crisis import pages
from hardcore.crisis.burden import Burden
from hardcore.crisis.exchange import Exchange
from hardcore.crisis.forwarding import Forwarding, Reader
from hardcore.crisis.heads import AnswerHead, Header, RequestDigest, request_bytes
from hardcore.crisis.holding import Life
from hardcore.crisis.limits import GatewayLimits
from hardcore.crisis.outlook import Errand, Outlook
from hardcore.crisis.upstream import Pool, UpstreamConnection

#: Of a name that is made: as many as of a key's hash.
NAME_BYTES = 16


class Sender(Reader, Protocol):
    """Who has requests carried."""

    def undelivered(self, exchange: Exchange, pool: Pool) -> None:
        """No core took it."""

    def looked_up(self, exchange: Exchange, pool: Pool, *, found: pages.Answer | None) -> None:
        """The ledger has it (with this answer), or does not, says the core behind `pool`."""

    def not_told(self, exchange: Exchange, pool: Pool) -> None:
        """The core behind `pool` did not say whether the ledger has it."""


class Courier:
    """Carries requests over the outlook's connections, and tells `sender` what became of them."""

    def __init__(self, outlook: Outlook, limits: GatewayLimits, sender: Sender) -> None:
        self._outlook = outlook
        self._limits = limits
        self._sender = sender
        self._kept = Burden(limits.answers_bytes_max)

    def send(self, exchange: Exchange) -> None:
        """Give a request to the serving core."""
        self._connected(exchange, Life.FORWARDED, self._write)

    def look_up(self, exchange: Exchange) -> None:
        """Ask the serving core what it knows of the request's key."""
        self._connected(exchange, Life.ASKED, self._ask)

    def _connected(
        self,
        exchange: Exchange,
        life: Life,
        then: Callable[[Exchange, Pool, UpstreamConnection], None],
    ) -> None:
        """Call `then` with a connection, if the request is still in `life` when there is one."""
        pool = self._outlook.pool
        assert pool is not None, "nothing is sent while no core is named"
        free = pool.idle()
        if free is not None:
            then(exchange, pool, free)
            return
        dial = exchange.dial = object()

        def dialled(connection: UpstreamConnection | None) -> None:
            wanted = exchange.dial is dial and exchange.life is life
            if connection is None:
                if wanted:
                    self._sender.undelivered(exchange, pool)
            elif wanted:
                then(exchange, pool, connection)
            else:
                pool.give_back(connection)

        pool.dial(dialled)

    # -- the client's request --------------------------------------------------------------------------

    def _write(self, exchange: Exchange, pool: Pool, connection: UpstreamConnection) -> None:
        head = exchange.head
        exchange.sends += 1
        exchange.upstream = connection
        kept = self._kept.share()
        asker = Forwarding(self._sender, exchange, pool, connection, self._limits, kept)
        no_body = head.method == "HEAD"
        own = _name_line(exchange)
        if not exchange.streamed:
            data = request_bytes(head, length=exchange.received_bytes, own=own)
            connection.ask(asker, b"".join((data, *exchange.body)), no_body=no_body, whole=True)
            return
        exchange.spent = True
        exchange.digest = RequestDigest(head)
        data = request_bytes(head, length=head.content_length, own=own)
        connection.ask(asker, data, no_body=no_body, whole=False)
        early, exchange.body = exchange.body, []
        exchange.flowing = True
        for data in early:
            self.piece(exchange, data)
        if exchange.whole:
            self.last_piece(exchange)
        exchange.client.flow()

    def piece(self, exchange: Exchange, data: bytes) -> None:
        """Pass a piece of a streamed body on; the deadline starts anew, because the request moves."""
        connection, digest = exchange.upstream, exchange.digest
        assert connection is not None
        assert digest is not None
        digest.add(data)
        exchange.client.limit.set(self._limits.upstream_deadline_ms)
        if exchange.head.content_length is None:
            data = b"%x\r\n%b\r\n" % (len(data), data)
        connection.send(data)

    def last_piece(self, exchange: Exchange) -> None:
        """A streamed body is at its end."""
        connection = exchange.upstream
        assert connection is not None
        if exchange.head.content_length is None:
            connection.send(b"0\r\n\r\n")
        connection.finish()

    # -- our own question ------------------------------------------------------------------------------

    def _ask(self, exchange: Exchange, pool: Pool, connection: UpstreamConnection) -> None:
        key = exchange.head.key
        assert key is not None, "only a request with a key can be looked up"
        exchange.upstream = connection

        def answered(head: AnswerHead | None, body: bytes) -> None:
            exchange.upstream = None
            self._judge(exchange, pool, head, body)

        errand = Errand(connection, answered, bytes_max=self._limits.unsafe_answer_bytes_max)
        path = quote(key, safe="")
        lines = (
            f"GET /api/ledger/commands/{path} HTTP/1.1",
            "Host: localhost",
            f"X-Request-Digest: {exchange.digest_hex()}",
            "\r\n",
        )
        connection.ask(errand, "\r\n".join(lines).encode(), no_body=False, whole=True)

    def _judge(self, exchange: Exchange, pool: Pool, head: AnswerHead | None, body: bytes) -> None:
        """What a look-up says. Only the two answers of the contract are believed."""
        if head is None or head.epoch != pool.epoch or (head.draining and head.status == 503):
            self._sender.undelivered(exchange, pool)
        elif head.status == 404 and _says_not_done(body):
            self._sender.looked_up(exchange, pool, found=None)
        elif head.status == 200 and (answer := _stored_answer(body)) is not None:
            self._sender.looked_up(exchange, pool, found=answer)
        else:
            self._sender.not_told(exchange, pool)


def _name_line(exchange: Exchange) -> tuple[Header, ...]:
    """What a request without a key is called, in case it is suspected of a death; made for it alone."""
    if exchange.head.safe or exchange.head.key is not None:
        return ()
    exchange.made_name = secrets.token_hex(NAME_BYTES)
    return ((b"X-Request-Name", exchange.made_name.encode()),)


def _object(body: bytes) -> dict[str, object]:
    try:
        fields = json.loads(body)
    except (ValueError, RecursionError):
        return {}
    return fields if isinstance(fields, dict) else {}


def _says_not_done(body: bytes) -> bool:
    """A 404 alone is not enough: any program says it for a path it does not know."""
    return _object(body).get("outcome") == "not_done"


def _stored_answer(body: bytes) -> pages.Answer | None:
    fields = _object(body)
    status = fields.get("status")
    if fields.get("outcome") != "done" or not isinstance(status, int) or not 200 <= status <= 599:
        return None
    return pages.stored(status, fields.get("answer"))
