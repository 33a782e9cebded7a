"""How often somebody may try a password: a bucket for each address, and one for all. Pure.

An address that guesses waits; everybody else does not. An account is never locked: whoever can lock the owner out by
guessing wrong has a weapon. The bucket of all bounds what many addresses together may try. Whoever has one address of
IPv6 has the 2^64 beside it too, so those count as one.
"""

from ipaddress import IPv6Address, IPv6Network, ip_address
from typing import Final

import msgspec

ADDRESSES_MAX: Final = 4_096
#: How many buckets' worth all addresses together may try.
_ALL: Final = 10
_EVERYBODY: Final = ""


class _Bucket(msgspec.Struct):
    left: float
    at_ns: int


class Attempts:
    """`most` at once from one address, and one more each `every_ns`."""

    def __init__(self, most: int, every_ns: int) -> None:
        self._most = most
        self._every_ns = every_ns
        self._buckets: dict[str, _Bucket] = {}

    def wait_ns(self, address: str, now_ns: int) -> int:
        """Take one try; 0: it may be made now, else in how long. A try that has to wait is not counted."""
        mine = self._filled(_whose(address), self._most, self._every_ns, now_ns)
        of_all = self._filled(_EVERYBODY, self._most * _ALL, max(1, self._every_ns // _ALL), now_ns)
        if mine.left < 1:
            return int((1 - mine.left) * self._every_ns)
        if of_all.left < 1:
            return int((1 - of_all.left) * self._every_ns // _ALL)
        mine.left -= 1
        of_all.left -= 1
        return 0

    def forgive(self, address: str) -> None:
        """Somebody there knew the password: what was tried before was a slip."""
        self._buckets.pop(_whose(address), None)

    def _filled(self, address: str, most: int, every_ns: int, now_ns: int) -> _Bucket:
        bucket = self._buckets.get(address)
        if bucket is None:
            if len(self._buckets) >= ADDRESSES_MAX:
                self._forget(now_ns)
            bucket = self._buckets[address] = _Bucket(most, now_ns)
        bucket.left = min(most, bucket.left + (now_ns - bucket.at_ns) / every_ns)
        bucket.at_ns = now_ns
        return bucket

    def _forget(self, now_ns: int) -> None:
        """Let go of those who have waited long enough; of the oldest, if nobody has."""
        full = [
            name for name, one in self._buckets.items() if now_ns - one.at_ns >= self._most * self._every_ns
        ]
        for name in full or list(self._buckets)[: ADDRESSES_MAX // 4]:
            if name != _EVERYBODY:
                del self._buckets[name]


def _whose(address: str) -> str:
    """The name that an address is counted under."""
    try:
        found = ip_address(address.removeprefix("[").removesuffix("]"))
    except ValueError:
        return address
    if not isinstance(found, IPv6Address):
        return address
    if found.ipv4_mapped is not None:
        return str(found.ipv4_mapped)
    return str(IPv6Network((found.packed[:8] + bytes(8), 64)))
