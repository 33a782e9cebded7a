"""Asks whoever accepts on our listener whether it lives: over the same address as every client.

The connection waits in the listener's own line until somebody accepts it, so one question asked early is answered by
the first answer that there is; nothing is asked again and again. That a process exists, or says so itself, is no
proof that a browser gets an answer.
"""

import asyncio
import os
import socket
from contextlib import suppress
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import ssl

#: More than this is not read of an answer.
ANSWER_BYTES_MAX = 4096
_ASK = b"GET /livez HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"
_LIVES = b"HTTP/1.1 200 "
#: It accepts, and has heard nobody yet: whoever asks it for anything still waits.
_UNHEARD = b'"heard": false'
#: Where to dial what listens everywhere.
_HERE = {"0.0.0.0": "127.0.0.1", "::": "::1"}  # noqa: S104  # nothing is bound here


def address_of(listen_fd: int) -> tuple[str, int] | None:
    """Return where the listener can be dialled from this machine; None: it is no TCP socket that listens."""
    with socket.socket(fileno=os.dup(listen_fd)) as listener:
        if listener.family not in {socket.AF_INET, socket.AF_INET6}:
            return None
        host, port = listener.getsockname()[:2]
    return _HERE.get(host, host), port


async def is_answered(listen_fd: int, limit_s: float, *, encrypted: bool = False) -> bool:
    """Return whether the question was answered within `limit_s`. What hinders it is an answer: no."""
    try:
        address = address_of(listen_fd)
        return address is not None and await asyncio.wait_for(_ask(*address, encrypted=encrypted), limit_s)
    except (OSError, TimeoutError, ValueError):
        return False


async def _ask(host: str, port: int, *, encrypted: bool) -> bool:
    context = _whoever() if encrypted else None
    reader, writer = await asyncio.open_connection(host, port, limit=ANSWER_BYTES_MAX, ssl=context)
    try:
        writer.write(_ASK)
        told = b""
        while len(told) < ANSWER_BYTES_MAX and (more := await reader.read(ANSWER_BYTES_MAX)):
            told += more
        return told.startswith(_LIVES) and _UNHEARD not in told
    finally:
        writer.close()
        with suppress(OSError):
            await writer.wait_closed()


def _whoever() -> "ssl.SSLContext":
    """Encryption without a look at the certificate: it is our own listener, and no name of it is this machine's."""
    import ssl  # a guard whose gateway does not encrypt has no need of it, and it is large

    context = ssl.create_default_context()
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    return context
