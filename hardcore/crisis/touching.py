"""Whether a request names one of some accounts: in its path or its body, as far as that can be seen from outside. Pure.

It decides about a wait of seconds and about nothing else, so it may err to both sides: an account is named by a whole
segment of the path, a whole string of JSON as most programs write it, or a whole field of a form. Reading the wish as
the core does was not chosen: the gateway does not know the ledger's commands.
"""

import json
from collections.abc import Collection
from urllib.parse import parse_qsl, unquote_to_bytes

from hardcore.crisis.receipts_form import FIELDS_MAX, FORM_TYPE

_CONTENT_TYPE = b"content-type"


def names_one_of(
    accounts: Collection[str], path: bytes, headers: Collection[tuple[bytes, bytes]], body: bytes
) -> bool:
    """Whether one of the accounts is named."""
    wanted = {one.encode() for one in accounts}
    if not wanted.isdisjoint(unquote_to_bytes(part) for part in path.split(b"/")):
        return True
    if not body:
        return False
    kind = next((value for name, value in headers if name.lower() == _CONTENT_TYPE), b"")
    if kind.decode("latin-1").partition(";")[0].strip().lower() == FORM_TYPE:
        return _in_form(accounts, body)
    spelled = {json.dumps(one, ensure_ascii=plain).encode() for one in accounts for plain in (True, False)}
    return any(one in body for one in spelled)


def _in_form(accounts: Collection[str], body: bytes) -> bool:
    try:
        pairs = parse_qsl(body.decode("utf-8", "replace"), max_num_fields=FIELDS_MAX)
    except ValueError:
        return False
    return any(value in accounts for _, value in pairs)
