"""The head of a request or an answer: read from loose header lines, judged, and written anew.

Nothing a client sent is ever passed through as bytes. What is written to the core comes from a value made
here, so an ambiguity that two parsers read differently cannot survive (request smuggling), and the length
of a body is always said by us. Passing the raw head on and patching it was not chosen for that reason.
"""

import base64
import binascii
import hashlib
import re
from collections.abc import Collection, Iterable, Sequence

import msgspec
from msgspec import structs

from hardcore.crisis.problems import Problem

Header = tuple[bytes, bytes]

SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})
METHODS = SAFE_METHODS | {"POST", "PUT", "PATCH", "DELETE"}
ALLOW = "GET, HEAD, POST, PUT, PATCH, DELETE, OPTIONS"

HEADERS_MAX = 128
#: What a name in a header may be made of (RFC 9110 5.6.2).
_TOKEN = re.compile(r"[!#$%&'*+.^_`|~0-9A-Za-z-]+")
#: A longer key is passed on but counts as none: the ledger's own limit is shorter.
KEY_BYTES_MAX = 255

_HOP_BY_HOP = frozenset(
    {
        b"connection",
        b"keep-alive",
        b"proxy-authenticate",
        b"proxy-authorization",
        b"proxy-connection",
        b"te",
        b"trailer",
        b"transfer-encoding",
        b"upgrade",
    }
)
#: Not passed on to the core: hop-by-hop, said anew by us, or a claim that only we may make.
_NOT_TO_CORE = _HOP_BY_HOP | {
    b"content-length",
    b"expect",
    b"forwarded",
    b"host",
    b"x-actor",
    b"x-admin",
    b"x-proven",
    b"x-real-ip",
    b"x-request-name",
}
_NOT_TO_CORE_PREFIXES = (b"x-forwarded-", b"x-core-", b"sec-websocket-")
_NOT_TO_CLIENT = _HOP_BY_HOP | {b"content-length"}
#: Not passed on of a navigation: its page is changed on the way back, so it is asked for plain and whole, and
#: no copy of it can be confirmed by the tag of what the core wrote.
_NOT_OF_A_PAGE = frozenset({b"accept-encoding", b"if-none-match", b"if-modified-since"})

#: What a rule of the quarantine may be called.
_RULE = re.compile(rb"[0-9A-Za-z_.:-]{1,64}")
#: What a core says of the commit that its answer stands for: the sequence and the event's hash.
_COMMIT = re.compile(rb"([0-9]{1,18}):([0-9a-f]{64})")

#: Languages that a page may put into its cookie.
_TONGUES = frozenset({b"ko", b"en"})


class Handshake(msgspec.Struct, frozen=True):
    """What a client says that asks for a WebSocket: its key, and the subprotocols it would speak."""

    key: str
    protocols: tuple[str, ...]


class RequestHead(msgspec.Struct, frozen=True):
    """A request's head after judgement. `headers` are those that go on to the core, host not among them.

    `content_length` is None for a chunked body and 0 for none; `key` is the idempotency key, None if the
    client gave none (or one that nobody could look up). `navigation`: a person waits before an empty tab for
    it; `gzip`: the answer may be compressed; `accept_language` is what the pages' own switch says, else the
    client's header; `respond_async`: the client takes a promise for an answer (RFC 7240); `forwarded`: it says that
    it comes from elsewhere than its connection does, `forwarded_for` and `forwarded_proto` in which words;
    `own_page`: a browser says that a page of this very origin sends it.
    """

    method: str
    target: bytes
    path: bytes
    host: bytes
    headers: tuple[Header, ...]
    content_length: int | None
    key: bytes | None
    navigation: bool
    gzip: bool
    expects_continue: bool
    keep_alive: bool
    http10: bool
    accept_language: str
    cookie: bytes
    handshake: Handshake | None = None
    respond_async: bool = False
    forwarded: bool = False
    forwarded_for: bytes = b""
    forwarded_proto: bytes = b""
    authorization: bytes = b""
    own_page: bool = False

    @property
    def safe(self) -> bool:
        """Whether sending it twice does no more than sending it once."""
        return self.method in SAFE_METHODS

    @property
    def key_hash(self) -> str | None:
        """First 16 bytes of SHA-256 of the key, in hex: the name a suspect goes by."""
        return None if self.key is None else hashlib.sha256(self.key).digest()[:16].hex()


class RequestDigest:
    """The name of one request in a look-up: SHA-256 of method, path and body, as they go to the core."""

    __slots__ = ("_hash",)

    def __init__(self, head: RequestHead) -> None:
        self._hash = hashlib.sha256(b"%b %b\n" % (head.method.encode(), head.path))

    def add(self, data: bytes) -> None:
        """Take in a piece of the body."""
        self._hash.update(data)

    def hex(self) -> str:
        """The digest of what was taken in."""
        return self._hash.hexdigest()


class _Facts(msgspec.Struct):
    """What one pass over the header lines has found."""

    hosts: int = 0
    host: bytes = b""
    length: int = 0
    chunked: bool = False
    keys: int = 0
    key: bytes = b""
    accept: bytes = b""
    accept_encoding: bytes = b""
    accept_language: bytes = b""
    cookie: bytes = b""
    prefer: bytes = b""
    expect: bytes = b""
    origin: bytes = b""
    fetch_site: bytes = b""
    fetch_mode: bytes = b""
    fetch_dest: bytes = b""
    upgrade: bytes = b""
    ws_key: tuple[bytes, ...] = ()
    ws_version: tuple[bytes, ...] = ()
    ws_protocols: tuple[bytes, ...] = ()
    forwarded: bool = False
    forwarded_for: bytes = b""
    forwarded_proto: bytes = b""
    authorization: bytes = b""
    named_by_connection: frozenset[bytes] = frozenset()


def _tokens(value: bytes) -> frozenset[bytes]:
    return frozenset(token.strip().lower() for token in value.split(b","))


def _gather(lines: Iterable[Header]) -> tuple[_Facts, list[tuple[bytes, bytes, bytes]]] | Problem:
    facts = _Facts()
    kept: list[tuple[bytes, bytes, bytes]] = []
    for name, value in lines:
        low = name.lower()
        match low:
            case b"host":
                facts.hosts, facts.host = facts.hosts + 1, value.strip()
            case b"connection":
                facts.named_by_connection |= _tokens(value)
            case b"content-length":
                facts.length = int(value)  # digits only: the parser has refused everything else
            case b"transfer-encoding":
                if facts.chunked or value.strip().lower() != b"chunked":
                    return Problem.BAD_REQUEST
                facts.chunked = True
            case b"expect":
                facts.expect = value.strip().lower()
            case b"idempotency-key":
                facts.keys, facts.key = facts.keys + 1, value.strip()
            case b"prefer":
                facts.prefer += b"," + value
            case b"accept":
                facts.accept = value.lower()
            case b"accept-encoding":
                facts.accept_encoding = value.lower()
            case b"accept-language":
                facts.accept_language = value
            case b"cookie":
                facts.cookie = value
            case b"origin":
                facts.origin = value.strip().lower()
            case b"upgrade":
                facts.upgrade = value.strip().lower()
            case b"sec-websocket-key":
                facts.ws_key += (value.strip(),)
            case b"sec-websocket-version":
                facts.ws_version += (value.strip(),)
            case b"sec-websocket-protocol":
                facts.ws_protocols += tuple(value.split(b","))
            case b"forwarded" | b"via" | b"x-real-ip":
                facts.forwarded = True
            case b"x-forwarded-for":
                facts.forwarded, facts.forwarded_for = True, facts.forwarded_for + b"," + value
            case b"x-forwarded-proto":
                facts.forwarded, facts.forwarded_proto = True, value
            case b"authorization":
                facts.authorization = value.strip()
            case b"sec-fetch-site":
                facts.fetch_site = value.strip().lower()
            case b"sec-fetch-mode":
                facts.fetch_mode = value.strip().lower()
            case b"sec-fetch-dest":
                facts.fetch_dest = value.strip().lower()
            case _:
                facts.forwarded = facts.forwarded or low.startswith(b"x-forwarded-")
        if low not in _NOT_TO_CORE and not low.startswith(_NOT_TO_CORE_PREFIXES):
            kept.append((low, name, value))
    return facts, kept


def _usable_key(facts: _Facts) -> bytes | None:
    """The key that the ledger will file the request under, if we can be sure that it will."""
    if facts.keys != 1 or b"idempotency-key" in facts.named_by_connection:
        return None
    key = facts.key
    visible = all(0x21 <= byte <= 0x7E for byte in key)
    return key if key and visible and len(key) <= KEY_BYTES_MAX else None


def read_request(
    method: str,
    target: bytes,
    version: str,
    lines: Collection[Header],
    hosts: Collection[str],
    *,
    keep_alive: bool,
    upgrade: bool,
) -> RequestHead | Problem:
    """Judge a parsed head. `hosts` are the names this server answers to, in lower case without a port."""
    if method not in METHODS:
        return Problem.METHOD_NOT_ALLOWED
    if version not in {"1.0", "1.1"} or not target.startswith(b"/"):
        return Problem.BAD_REQUEST
    if len(lines) > HEADERS_MAX:
        return Problem.HEAD_TOO_LARGE
    gathered = _gather(lines)
    if isinstance(gathered, Problem):
        return gathered
    facts, kept = gathered
    if facts.hosts != 1 or facts.keys > 1 or (facts.chunked and version == "1.0"):
        return Problem.BAD_REQUEST
    # The parser takes what follows an upgrade for another protocol, a body included.
    if upgrade and (facts.chunked or facts.length):
        return Problem.BAD_REQUEST
    if host_name(facts.host) not in hosts:
        return Problem.WRONG_HOST
    socket = upgrade and facts.upgrade == b"websocket"
    # No browser keeps a page of another origin from opening a WebSocket here: only we can.
    if (socket or method not in SAFE_METHODS) and _from_a_foreign_page(facts):
        return Problem.FOREIGN_PAGE
    handshake = _handshake(method, target, version, facts) if socket else None
    if isinstance(handshake, Problem):
        return handshake
    if facts.expect not in {b"", b"100-continue"}:
        return Problem.EXPECTATION_FAILED
    navigation = _is_navigation(method, facts)
    dropped = facts.named_by_connection | (_NOT_OF_A_PAGE if navigation else frozenset())
    return RequestHead(
        method=method,
        target=target,
        path=target.split(b"?", 1)[0],
        host=facts.host,
        headers=tuple((name, value) for low, name, value in kept if low not in dropped),
        content_length=None if facts.chunked else facts.length,
        key=_usable_key(facts),
        navigation=navigation,
        gzip=_takes_gzip(facts.accept_encoding),
        expects_continue=bool(facts.expect) and version == "1.1",
        keep_alive=keep_alive and not upgrade,
        http10=version == "1.0",
        accept_language=_tongue(facts).decode("latin-1"),
        cookie=facts.cookie,
        handshake=handshake,
        respond_async=bool(facts.prefer) and b"respond-async" in _tokens(facts.prefer),
        forwarded=facts.forwarded,
        forwarded_for=facts.forwarded_for,
        forwarded_proto=facts.forwarded_proto,
        authorization=facts.authorization,
        own_page=_is_from_an_own_page(facts),
    )


def with_target(head: RequestHead, target: bytes) -> RequestHead | None:
    """The judgement of the same lines for another target; None: it depends on the target too."""
    if head.target == target:
        return head
    if head.handshake is not None or not target.startswith(b"/"):
        return None
    return structs.replace(head, target=target, path=target.split(b"?", 1)[0])


def _handshake(method: str, target: bytes, version: str, facts: _Facts) -> Handshake | Problem:
    """What a client asks for that wants a WebSocket, if it asks as it should (RFC 6455 4.2.1)."""
    if method != "GET" or version != "1.1" or not target.isascii() or facts.ws_version != (b"13",):
        return Problem.BAD_REQUEST
    names = tuple(name.strip().decode("latin-1") for name in facts.ws_protocols)
    if len(facts.ws_key) != 1 or not all(map(_TOKEN.fullmatch, names)):
        return Problem.BAD_REQUEST
    key = facts.ws_key[0]
    try:
        whole = len(base64.b64decode(key, validate=True)) == 16
    except binascii.Error:
        whole = False
    return Handshake(key.decode("ascii"), names) if whole else Problem.BAD_REQUEST


def _is_navigation(method: str, facts: _Facts) -> bool:
    """Whether a tab waits for a page: a browser says so itself; whoever is silent may ask for text/html."""
    if method not in {"GET", "POST"}:
        return False
    if facts.fetch_mode or facts.fetch_dest or facts.fetch_site:
        return facts.fetch_mode == b"navigate" and facts.fetch_dest in {b"", b"document"}
    return b"text/html" in facts.accept


def _takes_gzip(accept_encoding: bytes) -> bool:
    """Whether gzip is named and not ruled out."""
    for part in accept_encoding.split(b","):
        name, _, weight = part.partition(b";")
        if name.strip() == b"gzip":
            return weight.replace(b" ", b"").rstrip(b"0") not in {b"q=", b"q=0."}
    return False


def _tongue(facts: _Facts) -> bytes:
    """What the reader has chosen on a page of ours, else what the browser says in general."""
    chosen = cookie_value(facts.cookie, b"lang")
    return chosen if chosen in _TONGUES else facts.accept_language


def _from_a_foreign_page(facts: _Facts) -> bool:
    """Whether a browser says that a page of another origin makes this request.

    Without a password, being asked from this machine is all that protects the ledger: a page anywhere on the
    web could otherwise have the browser post to it. A program sends neither header and is let through.
    """
    if facts.fetch_site not in {b"", b"same-origin", b"none"}:
        return True
    _scheme, _, authority = facts.origin.partition(b"://")
    return bool(facts.origin) and authority != facts.host.lower()


def _is_from_an_own_page(facts: _Facts) -> bool:
    """Whether a browser says in so many words that it is ours: what a cookie opens, silence must not use."""
    if facts.fetch_site:
        return facts.fetch_site == b"same-origin"
    _scheme, _, authority = facts.origin.partition(b"://")
    return bool(facts.origin) and authority == facts.host.lower()


def host_name(host: bytes) -> str:
    """The name in a Host value, in lower case, without a port; "" if the port is none."""
    text = host.decode("latin-1").lower()
    if ":" not in text or text.endswith("]"):
        return text
    name, _, port = text.rpartition(":")
    return name if port.isascii() and port.isdecimal() else ""


def request_bytes(head: RequestHead, *, length: int | None, own: Sequence[Header] = ()) -> bytes:
    """The head as it goes to the core; `length` None announces a chunked body; `own` are lines of the gateway's."""
    parts = [f"{head.method} ".encode(), head.target, b" HTTP/1.1\r\nHost: ", head.host, b"\r\n"]
    for name, value in head.headers:
        parts += (name, b": ", value, b"\r\n")
    for name, value in own:
        parts += (name, b": ", value, b"\r\n")
    if length is None:
        parts.append(b"Transfer-Encoding: chunked\r\n")
    elif length or not head.safe:
        parts.append(b"Content-Length: %d\r\n" % length)
    parts.append(b"\r\n")
    return b"".join(parts)


class Commit(msgspec.Struct, frozen=True):
    """A commit that an answer stands for: its sequence, and the event's hash in hex."""

    seq: int
    hash: str


class AnswerHead(msgspec.Struct, frozen=True):
    """An answer's head. `headers` go on to the client; `length` None: not known (chunked).

    `epoch` is the core that answered, None if the answer does not say; `draining`: the core says that it
    is leaving and did not run the request; `commit` is what it claims to have committed for this answer; `rule` is the
    rule of the quarantine by which it refused.
    """

    status: int
    reason: bytes
    headers: tuple[Header, ...]
    length: int | None
    epoch: int | None = None
    draining: bool = False
    framed: bool = True
    commit: Commit | None = None
    rule: str | None = None

    @property
    def bodiless(self) -> bool:
        """Whether the status alone rules a body out."""
        return self.status in {204, 304}

    @property
    def live(self) -> bool:
        """Whether its parts have to leave as they come (an event stream has no end to wait for)."""
        return any(
            name.lower() == b"content-type" and value.lower().startswith(b"text/event-stream")
            for name, value in self.headers
        )


def read_answer(status: int, reason: bytes, lines: Iterable[Header]) -> AnswerHead:
    """Take a parsed answer head apart: what the client gets, and what only we needed to know."""
    kept: list[tuple[bytes, bytes, bytes]] = []
    named: frozenset[bytes] = frozenset()
    length, epoch, draining, chunked, commit, rule = None, None, False, False, None, None
    for name, value in lines:
        low = name.lower()
        if low == b"connection":
            named |= _tokens(value)
        elif low == b"content-length":
            length = int(value)  # digits only: the parser has refused everything else
        elif low == b"transfer-encoding":
            chunked = True
        elif low == b"x-core-epoch":
            epoch = int(value) if value.isdigit() else None
        elif low == b"x-core-draining":
            draining = value.strip() == b"1"
        elif low == b"x-core-commit":
            commit = _commit(value.strip())
        elif low == b"x-core-rule" and _RULE.fullmatch(value.strip()):
            rule = value.strip().decode()
        if low not in _NOT_TO_CLIENT and not low.startswith(b"x-core-"):
            kept.append((low, name, value))
    headers = tuple((name, value) for low, name, value in kept if low not in named)
    framed = chunked or length is not None or status in {204, 304}
    return AnswerHead(status, reason, headers, length, epoch, draining, framed, commit, rule)


def _commit(value: bytes) -> Commit | None:
    found = _COMMIT.fullmatch(value)
    return Commit(int(found[1]), found[2].decode()) if found is not None else None


def answer_bytes(head: AnswerHead, *, length: int | None, chunked: bool, close: bool, http10: bool) -> bytes:
    """The head as it goes to the client, with the length (or chunking) and connection we decided on."""
    parts = [b"HTTP/1.1 %d " % head.status, head.reason, b"\r\n"]
    for name, value in head.headers:
        parts += (name, b": ", value, b"\r\n")
    if chunked:
        parts.append(b"Transfer-Encoding: chunked\r\n")
    elif length is not None:
        parts.append(b"Content-Length: %d\r\n" % length)
    if close:
        parts.append(b"Connection: close\r\n")
    elif http10:
        parts.append(b"Connection: keep-alive\r\n")
    parts.append(b"\r\n")
    return b"".join(parts)


def cookie_value(cookie: bytes, wanted: bytes) -> bytes | None:
    """The first value of a cookie in a Cookie header; None if it is not there or empty."""
    for pair in cookie.split(b";"):
        name, _, value = pair.strip().partition(b"=")
        if name == wanted and value:
            return value
    return None


def browser_of(cookie: bytes) -> bytes | None:
    """The value of the gateway's own cookie, which tells browsers apart; None for whoever has none."""
    return cookie_value(cookie, b"__hc")
