"""The smallest core that answers: always the same bytes, so that what stands before it is all that is measured.

`python -m bench.smallest_core SOCKET`. The real ledger takes ten times as long for an answer and would hide what a
gateway costs by itself.
"""

import asyncio
import sys
from typing import cast

import httptools
import uvloop

EPOCH = 1
_BODY = b'{"posted": "12000", "ok":1}'
ANSWER = (
    b"HTTP/1.1 200 OK\r\nContent-Type: application/json\r\nContent-Length: %d\r\nX-Core-Epoch: %d\r\n\r\n%b"
    % (len(_BODY), EPOCH, _BODY)
)


class SmallestCore(asyncio.Protocol):
    """Answers every request with the same bytes."""

    def __init__(self) -> None:
        self._parser = httptools.HttpRequestParser(self)
        self._transport: asyncio.WriteTransport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Keep the transport."""
        self._transport = cast("asyncio.WriteTransport", transport)

    def data_received(self, data: bytes) -> None:
        """Parse."""
        self._parser.feed_data(data)

    def on_message_complete(self) -> None:
        """Answer."""
        assert self._transport is not None
        self._transport.write(ANSWER)


async def serve(path: str) -> None:
    """Serve until killed."""
    server = await asyncio.get_running_loop().create_unix_server(SmallestCore, path)
    await server.serve_forever()


if __name__ == "__main__":
    with asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner:
        runner.run(serve(sys.argv[1]))
