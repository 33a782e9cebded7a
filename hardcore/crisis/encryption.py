"""TLS on our own listener: a certificate and its key, read again when they were renewed.

Whoever renews certificates does it beside us and tells nobody; so the files are looked at now and then, and who connects
afterwards gets the new one. A renewal that can't be read changes nothing: what was read last goes on.
"""

import logging
import ssl
from pathlib import Path
from typing import Final

from hardcore.access.doorway import Doorway

_LOG = logging.getLogger(__name__)
#: Looks at the files, in units of the gateway's upkeep.
_LOOK_EVERY: Final = 50


class Certificate:
    """The pair that is shown to who connects. Raises OSError (`ssl.SSLError` among them) if it can't be read."""

    def __init__(self, cert: Path, key: Path) -> None:
        self._cert, self._key = cert, key
        self.context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        self.context.minimum_version = ssl.TLSVersion.TLSv1_2
        self.context.load_cert_chain(cert, key)
        self._stamp = self._written()
        self._looks = 0

    def upkeep(self) -> None:
        """Now and then: take a renewed pair."""
        self._looks += 1
        if self._looks % _LOOK_EVERY:
            return
        try:
            stamp = self._written()
            if stamp != self._stamp:
                self.context.load_cert_chain(self._cert, self._key)
                self._stamp = stamp
                _LOG.info("the renewed certificate is shown from now on")
        except OSError as error:  # half of a pair may be there already: the next look has both
            _LOG.warning("the renewed certificate can't be read yet: %s", error)

    def _written(self) -> tuple[int, int]:
        return self._cert.stat().st_mtime_ns, self._key.stat().st_mtime_ns


def certificate(doorway: Doorway) -> Certificate | None:
    """The certificate that `up` was given; None: the listener does not encrypt."""
    if not doorway.tls_cert:
        return None
    return Certificate(Path(doorway.tls_cert), Path(doorway.tls_key))
