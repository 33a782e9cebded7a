"""Under what the door stands open beyond this machine, and what a request that came in by it may say of itself. Pure.

Beyond loopback the words of a password must not travel in the open: the gateway speaks TLS itself, or a proxy in front of
it does, or the owner has said in so many words that this network is trusted. A proxy is known by its address, and only
what it says of the client is believed.
"""

import hashlib
from collections.abc import Collection, Iterable, Iterator
from ipaddress import IPv4Network, IPv6Network, ip_address, ip_network
from typing import Final

import msgspec

#: More than this is not read of a list of proxies.
_HOPS_MAX: Final = 16


class Doorway(msgspec.Struct, frozen=True):
    """What `hardcore up` was told. `names`: what the server is called besides its addresses; `open`: it listens beyond
    this machine.
    """

    open: bool = False
    tls_cert: str = ""
    tls_key: str = ""
    proxies: tuple[str, ...] = ()
    insecure_lan: bool = False
    names: tuple[str, ...] = ()

    @property
    def mark(self) -> str:
        """A name for all of it."""
        return hashlib.sha256(msgspec.json.encode(self)).hexdigest()[:16]

    @property
    def encrypted(self) -> bool:
        """Whether the listener itself speaks TLS."""
        return bool(self.tls_cert and self.tls_key)

    @property
    def safe(self) -> bool:
        """Whether it may listen beyond this machine, once there is a password."""
        return self.encrypted or bool(self.proxies) or self.insecure_lan


class Client(msgspec.Struct, frozen=True):
    """Where a request comes from. `https`: it came encrypted; `refused`: it came around the proxy, in the open."""

    address: str
    https: bool
    refused: bool = False


def is_network(text: str) -> bool:
    """Whether this names the addresses of a proxy: 10.0.0.0/8, or one address."""
    try:
        ip_network(text, strict=False)
    except ValueError:
        return False
    return True


def is_address(host: str) -> bool:
    """Whether a host is an address and no name. No page elsewhere can make a browser take one for its own."""
    try:
        ip_address(host.removeprefix("[").removesuffix("]"))
    except ValueError:
        return False
    return True


class Names(Collection[str]):
    """The names that a server answers to. With the door open any address will do: only names can be made to lie."""

    def __init__(self, names: Iterable[str], *, addresses: bool) -> None:
        self._names = frozenset(name.lower() for name in names)
        self._addresses = addresses

    def __contains__(self, host: object) -> bool:
        """Whether this is one of them."""
        return host in self._names or (self._addresses and isinstance(host, str) and is_address(host))

    def __iter__(self) -> Iterator[str]:
        """Those that were given."""
        return iter(self._names)

    def __len__(self) -> int:
        """How many were given."""
        return len(self._names)


class Proxies:
    """The proxies that are believed."""

    def __init__(self, networks: Iterable[str]) -> None:
        self._networks: tuple[IPv4Network | IPv6Network, ...] = tuple(
            ip_network(one, strict=False) for one in networks
        )

    def __bool__(self) -> bool:
        """Whether there is any."""
        return bool(self._networks)

    def trusts(self, address: str) -> bool:
        """Whether one sits at this address."""
        try:
            found = ip_address(address.removeprefix("::ffff:"))
        except ValueError:
            return False
        return any(found in network for network in self._networks)

    def client(self, address: str, forwarded_for: bytes, forwarded_proto: bytes) -> Client | None:
        """Who is behind the proxy at `address`; None: no proxy sits there. The last address that is none of ours counts:
        what stands before it, the client may have written itself.
        """
        if not self.trusts(address):
            return None
        hops = [hop.strip() for hop in forwarded_for.decode("latin-1").split(",")][-_HOPS_MAX:]
        https = forwarded_proto.decode("latin-1").split(",")[-1].strip().lower() == "https"
        theirs = [hop for hop in hops if is_address(hop) and not self.trusts(hop)]
        return Client(theirs[-1] if theirs else address, https)
