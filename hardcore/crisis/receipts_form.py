"""A page's form as a wish that can be kept: its key, the hidden fields that carry it, and reading them again. Pure.

The gateway may have died between the page that offers to keep a wish and the press of its button, so the page alone
carries everything. What comes back is read as strictly as any request: it names a path of the ledger's, a key that
the ledger takes, and a form's body. Keeping the wish in memory and giving the page a ticket was not chosen for that.
"""

import base64
import binascii
import hashlib
import html
import re
from collections.abc import Iterable, Sequence
from typing import Final
from urllib.parse import parse_qsl, urlencode

import msgspec

from hardcore.crisis.heads import KEY_BYTES_MAX, Header, RequestDigest, RequestHead
from hardcore.crisis.receipts import Wish
from hardcore.crisis.routing import OWN_PAGES, OWN_PREFIX, is_admin

KEY_FIELD: Final = "_idempotency_key"
#: The kind of form whose key can be read. One with a file in it is not kept: it is sent again by whoever has the file.
FORM_TYPE: Final = "application/x-www-form-urlencoded"
FIELDS_MAX: Final = 1000
_KEY: Final = re.compile(rf"[\x21-\x7e]{{1,{KEY_BYTES_MAX}}}")
#: A path of this origin: "//elsewhere" and "/\\elsewhere" would leave it.
_PATH: Final = re.compile(r"/(?![/\\])[\x21-\x7e]*")
#: What a kept form says of its sender besides the form itself.
_OF_THE_SENDER: Final = frozenset({b"origin", b"user-agent"})
#: What opens doors is never written to the disk: a promise is run without it. The language is said anew, because the
#: cookie may have said it.
_NEVER_KEPT: Final = frozenset({b"accept-language", b"authorization", b"cookie", b"proxy-authorization"})
_KEPT_FIELDS: Final = ("key", "path", "type", "body", "from")


class KeptForm(msgspec.Struct, frozen=True):
    """A form's wish. `path` is as it was posted to, with its query; `back` is the page of ours that it came from."""

    key: str
    path: str
    type: str
    body: bytes
    back: str


def is_key(text: str) -> bool:
    """Whether the ledger takes this text for a key."""
    return _KEY.fullmatch(text) is not None


def is_own_path(text: str) -> bool:
    """Whether this is a path of this origin."""
    return _PATH.fullmatch(text) is not None


def form_in(head: RequestHead, body: bytes, back: str) -> KeptForm | None:
    """The form that a tab has posted, if its wish could be kept."""
    if head.method != "POST" or not head.navigation:
        return None
    kind = _kind_of(head)
    return _checked(_key_in(kind, body), head.target.decode("latin-1"), kind, body, back)


def hidden_fields(form: KeptForm) -> bytes:
    """What a page carries of it."""
    values = (form.key, form.path, form.type, base64.urlsafe_b64encode(form.body).decode(), form.back)
    return "".join(
        f'<input type="hidden" name="{name}" value="{html.escape(value)}">'
        for name, value in zip(_KEPT_FIELDS, values, strict=True)
    ).encode()


def posted_bytes(form: KeptForm) -> int:
    """How long the body is that the page's button sends."""
    values = (form.key, form.path, form.type, base64.urlsafe_b64encode(form.body), form.back)
    return len(urlencode(tuple(zip(_KEPT_FIELDS, values, strict=True))))


def read_kept(head: RequestHead, body: bytes) -> KeptForm | None:
    """The wish that the page's button has sent; None if it is none that can be kept."""
    if _kind_of(head).partition(";")[0].strip().lower() != FORM_TYPE:
        return None
    try:
        pairs = parse_qsl(body.decode("ascii"), keep_blank_values=True, max_num_fields=len(_KEPT_FIELDS))
    except ValueError:  # UnicodeDecodeError is one too
        return None
    fields = dict(pairs)
    if len(pairs) != len(_KEPT_FIELDS) or fields.keys() != set(_KEPT_FIELDS):
        return None
    try:
        wish = base64.b64decode(fields["body"], altchars=b"-_", validate=True)
    except (binascii.Error, ValueError):
        return None
    kind = fields["type"]
    key = fields["key"]
    # The key is told twice, and a form that says another one itself would be booked under that.
    return _checked(key, fields["path"], kind, wish, fields["from"]) if _key_in(kind, wish) == key else None


def request_digest(head: RequestHead, body: Iterable[bytes]) -> str:
    """The name of a request in a look-up."""
    digest = RequestDigest(head)
    for piece in body:
        digest.add(piece)
    return digest.hex()


def wish_of_request(head: RequestHead, body: Sequence[bytes], browser: bytes | None, *, back: str) -> Wish:
    """A request that came with a key, as a wish."""
    key, key_hash = head.key, head.key_hash
    assert key is not None, "only a request with a key is promised"
    assert key_hash is not None
    headers = (
        *((name, value) for name, value in head.headers if name.lower() not in _NEVER_KEPT),
        *_language(head),
    )
    return Wish(
        key=key.decode("ascii"),
        key_hash=key_hash,
        digest=request_digest(head, body),
        browser=browser,
        method=head.method,
        target=head.target,
        host=head.host,
        headers=headers,
        size_bytes=sum(map(len, body)) + _size(head.target, headers),
        back=back if is_own_path(back) else "/",
    )


def wish_of_form(form: KeptForm, head: RequestHead, browser: bytes | None) -> Wish:
    """A kept form as the request that the page's own script would have sent: it is answered in JSON, under its key.
    `head` is that of the request that asked to keep it.
    """
    target, key = form.path.encode("ascii"), form.key.encode("ascii")
    own = tuple((name, value) for name, value in head.headers if name.lower() in _OF_THE_SENDER)
    headers = (
        (b"Accept", b"application/json"),
        (b"Content-Type", form.type.encode("ascii")),
        (b"Idempotency-Key", key),
        *own,
        *_language(head),
    )
    return Wish(
        key=form.key,
        key_hash=hashlib.sha256(key).digest()[:16].hex(),
        digest=hashlib.sha256(b"POST %b\n%b" % (target.split(b"?", 1)[0], form.body)).hexdigest(),
        browser=browser,
        method="POST",
        target=target,
        host=head.host,
        headers=headers,
        size_bytes=len(form.body) + _size(target, headers),
        back=form.back,
    )


def _language(head: RequestHead) -> tuple[Header, ...]:
    language = head.accept_language.encode("latin-1")
    return ((b"Accept-Language", language),) if language else ()


def _size(target: bytes, headers: Iterable[Header]) -> int:
    return len(target) + sum(len(name) + len(value) for name, value in headers)


def _kind_of(head: RequestHead) -> str:
    kind = next((value for name, value in head.headers if name.lower() == b"content-type"), b"")
    return kind.decode("latin-1")


def _checked(key: str | None, path: str, kind: str, body: bytes, back: str) -> KeptForm | None:
    own = path.split("?", 1)[0].encode("latin-1", "replace")
    ours = own in OWN_PAGES or own.startswith(OWN_PREFIX) or is_admin(own)
    if key is None or not is_key(key) or not is_own_path(path) or ours:
        return None
    return KeptForm(key, path, kind, body, back if is_own_path(back) else "/")


def _key_in(kind: str, body: bytes) -> str | None:
    """The key that a form's body says, if it says one once."""
    if kind.partition(";")[0].strip().lower() != FORM_TYPE or not kind.isascii() or not kind.isprintable():
        return None
    try:
        pairs = parse_qsl(
            body.decode("utf-8"), keep_blank_values=True, max_num_fields=FIELDS_MAX, errors="strict"
        )
    except ValueError:
        return None
    keys = [value.strip() for name, value in pairs if name == KEY_FIELD]
    return keys[0] if len(keys) == 1 else None
