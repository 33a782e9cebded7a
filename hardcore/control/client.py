"""Asks the sentinel something over its control socket: one line there, one line back."""

import json
import socket
from collections.abc import Mapping
from pathlib import Path

from hardcore.control.protocol import LINE_BYTES_MAX, write_line

FDS_MAX = 4


class Unreachable(Exception):  # noqa: N818  # it is a state of the other side, not an error of ours
    """Nobody answers at the control socket: the sentinel is not running, or it hangs."""


def ask(path: Path, request: Mapping[str, object], timeout_s: float = 5.0) -> dict[str, object]:
    """Return the sentinel's answer. Raises Unreachable."""
    answer, fds = ask_with_fds(path, request, timeout_s)
    for fd in fds:
        socket.close(fd)
    return answer


def ask_with_fds(
    path: Path, request: Mapping[str, object], timeout_s: float = 5.0
) -> tuple[dict[str, object], list[int]]:
    """As `ask`, with the descriptors that came along; they are the caller's to close."""
    received: list[int] = []
    with socket.socket(socket.AF_UNIX) as connection:
        connection.settimeout(timeout_s)
        try:
            connection.connect(str(path))
            connection.sendall(write_line(request))
            line = b""
            while not line.endswith(b"\n") and len(line) < LINE_BYTES_MAX:
                data, fds, _flags, _address = socket.recv_fds(connection, 65536, FDS_MAX)
                received += fds
                if not data:
                    break
                line += data
            answer = json.loads(line)
        except (OSError, ValueError) as error:
            for fd in received:
                socket.close(fd)
            raise Unreachable(str(error)) from error
    if not isinstance(answer, dict):
        raise Unreachable("the answer is not an object")
    return answer, received
