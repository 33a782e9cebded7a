"""Asks a core for its health over its own socket, as the gateway would: the third kind of evidence.

Beats say that a loop turns, this says that it answers. Plain asyncio on the loop that decides, one short line out
and a bounded answer in; whatever goes wrong on the other side is no answer.
"""

import asyncio
import json
from pathlib import Path

import msgspec

from hardcore.model.verdicts import Diagnosis

ANSWER_BYTES_MAX = 4096
_ASKED = b"GET /healthz HTTP/1.1\r\nHost: core\r\nConnection: close\r\n\r\n"


class Health(msgspec.Struct, frozen=True):
    """What a core says of itself: the epoch it serves, its head, and whether it takes writes (None: not said).

    `safe`: why it serves reads only.
    """

    epoch: int | None
    seq: int | None
    writes: bool | None = None
    safe: Diagnosis | None = None


async def ask_health(socket: Path, within_s: float) -> Health | None:
    """Return what the core answers, None if it has not answered well after `within_s` seconds."""
    try:
        return _read(await asyncio.wait_for(_ask(socket), within_s))
    except (OSError, TimeoutError):
        return None


async def _ask(socket: Path) -> bytes:
    reader, writer = await asyncio.open_unix_connection(str(socket), limit=ANSWER_BYTES_MAX)
    try:
        writer.write(_ASKED)
        answer = b""
        while len(answer) < ANSWER_BYTES_MAX and (part := await reader.read(ANSWER_BYTES_MAX)):
            answer += part
        return answer
    finally:
        writer.transport.abort()  # nothing of ours is unsent, and a stuck core must not keep the descriptor


def _read(answer: bytes) -> Health | None:
    head, _, body = answer.partition(b"\r\n\r\n")
    if head.split(b" ", 2)[1:2] != [b"200"]:
        return None
    try:
        told = json.loads(body)
    except (ValueError, RecursionError):
        told = {}
    told = told if isinstance(told, dict) else {}
    safe = told.get("safe", "")
    reason = next((one for one in Diagnosis if one == safe), None)
    writes = True if safe is None else None if reason is None else False
    return Health(_whole(told.get("epoch")), _whole(told.get("seq")), writes, reason)


def _whole(value: object) -> int | None:
    return value if isinstance(value, int) and not isinstance(value, bool) else None
