"""Admission: whether the rules in force let a command into the writer's line.

Pure but for what it has counted: time is given. A command is refused by its name, by the bytes of its request, by its wish
under any key, or because its kind is limited. Nobody is refused what is done already; that is the service's to see, and
so is what happens on a marked account, which only the decided command shows. Not chosen: a window that begins anew
each minute; twice as much would pass around its edge.
"""

import math
from collections import deque
from hashlib import sha256
from typing import Final

import msgspec

from core.guarded.quarantine import Limit, Quarantine, Rules
from core.journal.answers import Limited, SetAside

WINDOW_NS: Final = 60_000_000_000
#: A rule that takes more in a minute than this takes as many as come.
COUNTED_MAX: Final = 100_000


class Wish(msgspec.Struct, frozen=True):
    """What is known of a command before it is asked for. `name`: what a guard calls it; `digest` of its request."""

    kind: str
    name: str
    digest: bytes
    fingerprint: bytes
    body_bytes: int


class Admission:
    """The door of one service. One thread."""

    def __init__(self, quarantine: Quarantine) -> None:
        """Go by these rules, as they stand at each moment."""
        self._quarantine = quarantine
        self._counted: dict[str, deque[int]] = {}
        self._counted_for: Rules = quarantine.rules

    def refusal(self, wish: Wish, now_ns: int) -> SetAside | Limited | None:
        """Return why a command may not be tried, or count it and return None. `now_ns` is monotonic."""
        rules = self._quarantine.rules
        if not rules.refuse:
            return None
        letter = rules.names.get(wish.name) or rules.digests.get(wish.digest.hex())
        if letter is None and rules.fingerprints:
            letter = rules.fingerprints.get(sha256(wish.fingerprint).hexdigest())
        if letter is not None:
            return SetAside(letter)
        limit = rules.limits.get(wish.kind)
        return None if limit is None else self._limited(limit, wish, now_ns, rules)

    def _limited(self, limit: Limit, wish: Wish, now_ns: int, rules: Rules) -> Limited | None:
        if limit.body_bytes_max is not None and wish.body_bytes > limit.body_bytes_max:
            return Limited(limit.rule, None)
        if limit.per_minute is None or limit.per_minute > COUNTED_MAX:
            return None
        if self._counted_for is not rules:
            self._counted_for = rules
            self._counted = {kind: at for kind, at in self._counted.items() if kind in rules.limits}
        at = self._counted.setdefault(wish.kind, deque())
        while at and at[0] <= now_ns - WINDOW_NS:
            at.popleft()
        if len(at) < limit.per_minute:
            at.append(now_ns)
            return None
        free_ns = (at[0] if at else now_ns) + WINDOW_NS
        return Limited(limit.rule, math.ceil((free_ns - now_ns) / 1_000_000_000))
