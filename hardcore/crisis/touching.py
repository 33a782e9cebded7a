"""Whether a request names one of some accounts: in its path or its body, as far as that can be seen from outside. Pure.

It decides about a wait of seconds and about nothing else, so it may err to both sides: an account is named by a whole
segment of the path, a whole string of JSON as most programs write it, or a whole field of a form. Reading the wish as
the core does was not chosen: the gateway does not know the ledger's commands. A body is cut once at its quotes and the
pieces are compared with all accounts at a time; searching it for each account stopped the gateway's only thread.
"""

import json
from collections.abc import Collection
from urllib.parse import parse_qsl, unquote_to_bytes

from hardcore.crisis.receipts_form import FIELDS_MAX, FORM_TYPE

_CONTENT_TYPE = b"content-type"


class Accounts:
    """Some accounts, spelled once in all the ways in which a request may name them."""

    __slots__ = ("_plain", "_spelled", "names")

    def __init__(self, names: Collection[str] = ()) -> None:
        self.names = frozenset(names)
        self._plain = frozenset(one.encode() for one in self.names)
        escaped = (json.dumps(one).encode()[1:-1] for one in self.names)
        self._spelled = self._plain.union(escaped)

    def named_in(self, path: bytes, headers: Collection[tuple[bytes, bytes]], body: bytes) -> bool:
        """Whether one of them is named."""
        if not self._plain.isdisjoint(unquote_to_bytes(part) for part in path.split(b"/")):
            return True
        if not body:
            return False
        kind = next((value for name, value in headers if name.lower() == _CONTENT_TYPE), b"")
        if kind.decode("latin-1").partition(";")[0].strip().lower() == FORM_TYPE:
            return self._in_form(body)
        return not self._spelled.isdisjoint(body.split(b'"'))

    def _in_form(self, body: bytes) -> bool:
        try:
            pairs = parse_qsl(body.decode("utf-8", "replace"), max_num_fields=FIELDS_MAX)
        except ValueError:
            return False
        return any(value in self.names for _, value in pairs)
