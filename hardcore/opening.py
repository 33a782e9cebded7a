"""How wide `hardcore up` opens the door: checked before anything starts, each refusal with its next step.

This machine alone needs nothing. Beyond it there must be a password, and what it travels in must be closed: by our own TLS,
by a proxy in front of us, or because the owner says that this network is trusted.
"""

import ipaddress
import socket
from pathlib import Path

import msgspec

from frontend.catalogue_access import access_text
from hardcore.access.doorway import Doorway, is_network
from hardcore.access.files import Unreadable
from hardcore.access.people import People


class Opening(msgspec.Struct, frozen=True):
    """What the command line says of it."""

    host: str = "127.0.0.1"
    tls_cert: Path | None = None
    tls_key: Path | None = None
    proxies: tuple[str, ...] = ()
    insecure_lan: bool = False
    names: tuple[str, ...] = ()

    @property
    def words(self) -> list[str]:
        """The same as words of a command line."""
        words = [] if self.host == "127.0.0.1" else ["--host", self.host]
        if self.tls_cert is not None and self.tls_key is not None:
            words += ["--tls-cert", str(self.tls_cert.absolute()), "--tls-key", str(self.tls_key.absolute())]
        for name, values in (("--trusted-proxy", self.proxies), ("--hostname", self.names)):
            words += [word for value in values for word in (name, value)]
        return [*words, "--insecure-lan"] if self.insecure_lan else words

    @property
    def given(self) -> bool:
        """Whether anything but the usual is asked for."""
        return self != Opening(host=self.host) or not is_loopback(self.host)


def address_of(host: str) -> str | None:
    """An address in the one form that browsers use, or None if it is none."""
    if host == "localhost":
        return host
    try:
        return None if "%" in host else str(ipaddress.ip_address(host))
    except ValueError:
        return None


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches it."""
    address = address_of(host)
    return address == "localhost" or (address is not None and ipaddress.ip_address(address).is_loopback)


def doorway_for(asked: Opening, people: People | Unreadable, lang: str, command: str) -> Doorway | str:
    """What the gateway is told, or why the door can't be opened so."""
    if address_of(asked.host) is None:
        return access_text("host_bad", lang, host=asked.host)
    if (asked.tls_cert is None) is not (asked.tls_key is None):
        return access_text("tls_pair", lang)
    wrong = next((one for one in asked.proxies if not is_network(one)), None)
    if wrong is not None:
        return access_text("proxy_bad", lang, given=wrong)
    beyond = not is_loopback(asked.host)
    closed = isinstance(people, People) and people.closed
    if (beyond or asked.proxies) and not closed:
        key = "open_password" if beyond else "proxy_password"
        return access_text(key, lang, host=asked.host, command=command)
    made = Doorway(
        open=beyond or bool(asked.proxies),
        tls_cert=str(asked.tls_cert.absolute()) if asked.tls_cert is not None else "",
        tls_key=str(asked.tls_key.absolute()) if asked.tls_key is not None else "",
        proxies=asked.proxies,
        insecure_lan=asked.insecure_lan,
        names=(*asked.names, *(_own_names() if beyond else ())),
    )
    if beyond and not made.safe:
        return access_text("open_plain", lang, host=asked.host)
    fault = _fault(made) if made.encrypted else None
    return made if fault is None else access_text("tls_bad", lang, why=fault)


def warning_for(doorway: Doorway, lang: str) -> str:
    """What the owner should know of this door; empty: nothing."""
    return access_text("insecure", lang) if doorway.insecure_lan and not doorway.encrypted else ""


def shown_url(url: str, doorway: Doorway, host: str) -> str:
    """The address as people type it: with the name and the encryption that it has."""
    if not doorway.open and not doorway.encrypted:
        return url
    port = url.rpartition(":")[2]
    name = doorway.names[0] if doorway.names else "localhost"
    if is_loopback(host) and not doorway.encrypted:
        return url  # a proxy stands before it, and has an address of its own
    named = host if address_of(host) not in {"0.0.0.0", "::", "localhost"} and not doorway.names else name  # noqa: S104
    shown = f"[{named}]" if ":" in named else named
    return f"{'https' if doorway.encrypted else 'http'}://{shown}:{port}"


def _own_names() -> tuple[str, ...]:
    """What other devices call this machine."""
    name = socket.gethostname().lower()
    return (name, f"{name}.local") if name and "." not in name else (name,)


def _fault(doorway: Doorway) -> str | None:
    import ssl  # most doors have no need of it, and it is large

    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(doorway.tls_cert, doorway.tls_key)
    except OSError as error:
        return error.strerror or str(error)
    return None
