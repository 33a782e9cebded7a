"""Gives an order to a core over its own control socket, and waits a bounded time for its answer."""

import asyncio
import json
from collections.abc import Mapping
from pathlib import Path

ANSWER_BYTES_MAX = 4096
WORDS_MAX = 200


async def give(control: Path, order: Mapping[str, object], within_s: float) -> str:
    """Have a core do something; return why it did not or may not have, empty when it says that it did."""
    try:
        line = await asyncio.wait_for(_ask(control, order), within_s)
        answer = json.loads(line) if line else None
    except TimeoutError:
        return f"the core did not answer within {within_s:g} s"
    except (OSError, ValueError, RecursionError) as error:
        return f"the core's control socket does not answer ({type(error).__name__})"
    if not isinstance(answer, dict):
        return "the core hung up"
    return "" if answer.get("ok") is True else str(answer.get("error", "it gave no reason"))[:WORDS_MAX]


async def _ask(control: Path, order: Mapping[str, object]) -> bytes:
    reader, writer = await asyncio.open_unix_connection(str(control), limit=ANSWER_BYTES_MAX)
    try:
        writer.write(json.dumps(order).encode() + b"\n")
        return await reader.readline()
    finally:
        writer.transport.abort()  # the order is one small packet, long sent; a stuck core must not keep the rest
