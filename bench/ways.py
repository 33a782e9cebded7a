"""The ways to one core that are compared: straight to its socket, through the gateway, through one nginx worker.

All of them stand at once, before the same process, and are measured in turn: so a busy minute of the machine hits
each. The gateway gets its core from a feed of our own that says what a sentinel says, because a whole guard beside
them would weigh on all three. nginx is the machine's own; where there is none, the figures beside it are left out.
"""

import asyncio
import contextlib
import json
import os
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path

from bench.instance import ACCOUNTS, ONE_ACCOUNT
from bench.pusher import connect

START_S = 20.0
LOOK_EVERY_S = 0.02
#: Where Debian puts it, which is not on everybody's PATH.
_SBIN = "/usr/sbin"
_NGINX = """
{user} daemon off; worker_processes 1; pid {folder}/nginx.pid; error_log stderr crit;
events {{ worker_connections 4096; }}
http {{
  access_log off; keepalive_requests 100000000; client_body_temp_path {folder}/bodies;
  proxy_temp_path {folder}/answers; fastcgi_temp_path {folder}/f; uwsgi_temp_path {folder}/u; scgi_temp_path {folder}/s;
  upstream core {{ server unix:{core}; keepalive 64; keepalive_requests 100000000; }}
  server {{
    listen 127.0.0.1:{port};
    location / {{ proxy_pass http://core; proxy_http_version 1.1; proxy_set_header Connection ""; proxy_set_header Host $host; }}
  }}
}}
"""


def nginx() -> str | None:
    """The machine's nginx, or None."""
    return shutil.which("nginx", path=f"{os.environ['PATH']}:{_SBIN}")


@contextmanager
def process(argv: list[str], **more: object) -> Iterator[subprocess.Popen[bytes]]:
    """A process that is gone afterwards."""
    child = subprocess.Popen(argv, start_new_session=True, stderr=subprocess.DEVNULL, **more)  # type: ignore[call-overload]
    try:
        yield child
    finally:
        child.terminate()
        try:
            child.wait(5)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()


def answers(address: str) -> None:
    """Wait until something answers there."""
    give_up_at = time.monotonic() + START_S
    while True:
        with contextlib.suppress(OSError), connect(address) as plug:
            plug.settimeout(START_S)
            plug.sendall(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n")
            if plug.recv(4096).startswith(b"HTTP/1.1 200"):
                return
        assert time.monotonic() < give_up_at, f"nothing answers at {address}"
        time.sleep(LOOK_EVERY_S)


@contextmanager
def smallest(folder: Path) -> Iterator[tuple[Path, int, str]]:
    """The smallest core; its socket, its epoch and what to ask it for."""
    path = folder / "small.sock"
    with process([sys.executable, "-m", "bench.smallest_core", str(path)]):
        answers(str(path))
        yield path, 1, ONE_ACCOUNT


@contextmanager
def ledger(folder: Path) -> Iterator[tuple[Path, int, str]]:
    """The real ledger alone with one account; its socket, its epoch and what to ask it for."""
    path = folder / "ledger.sock"
    environment = {**os.environ, "HARDCORE_DATA": str(folder), "HARDCORE_SOCKET": str(path)}
    with process([sys.executable, "-m", "core", "serve"], env=environment):
        answers(str(path))
        body = json.dumps({"id": ACCOUNTS[0], "name": "bank", "type": "asset", "currency": "KRW"}).encode()
        head = "POST /api/ledger/accounts HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
        with connect(str(path)) as plug:
            plug.sendall(f"{head}Idempotency-Key: k\r\nContent-Length: {len(body)}\r\n\r\n".encode() + body)
            said = plug.recv(65536)
        assert said.startswith(b"HTTP/1.1 201"), said
        epoch = next(
            line for line in said.lower().split(b"\r\n") if line.startswith(b"x-core-epoch:")
        ).partition(b":")[2]
        yield path, int(epoch), ONE_ACCOUNT


@contextmanager
def worker(folder: Path, core: Path) -> Iterator[int]:
    """One nginx worker before the core; its port."""
    program = nginx()
    assert program is not None, "whoever asks has looked"
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = int(free.getsockname()[1])
    config = folder / f"nginx-{core.stem}.conf"
    user = "user root;" if os.geteuid() == 0 else ""  # its worker has to reach a socket that is ours alone
    config.write_text(_NGINX.format(user=user, folder=folder, core=core, port=port))
    with process([program, "-p", str(folder), "-c", str(config)]):
        answers(f"127.0.0.1:{port}")
        yield port


@asynccontextmanager
async def gateway(folder: Path, core: Path, epoch: int, **limits: int) -> AsyncIterator[int]:
    """The gateway before the core, with limits that differ from its own; its port."""
    control = folder / f"control-{core.stem}.sock"
    served = asyncio.Event()
    lines = [
        {"type": "serving", "generation": 1, "socket": str(core), "epoch": epoch},
        {"type": "release", "generation": 1, "epoch": epoch, "incident": None},
        {"type": "phase", "generation": 1, "phase": "RUNNING", "state": "OPERATIONAL", "face": "FORWARD"},
    ]

    over = asyncio.Event()
    over.set()

    async def greet(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        over.clear()
        writer.write(b"".join(json.dumps(line).encode() + b"\n" for line in lines))
        async for line in reader:
            if json.loads(line).get("type") == "served":
                served.set()
        writer.close()
        over.set()

    server = await asyncio.start_unix_server(greet, str(control))
    listener = socket.create_server(("127.0.0.1", 0), backlog=512)
    fd = listener.fileno()
    argv = [sys.executable, "-m", "hardcore.crisis", "--listen-fd", str(fd), "--control", str(control)]
    environment = {**os.environ, "HARDCORE_LIMITS": json.dumps(limits)}
    try:
        with process(argv, pass_fds=(fd,), env=environment):
            await asyncio.wait_for(served.wait(), START_S)
            yield int(listener.getsockname()[1])
    finally:
        server.close()
        listener.close()
        await over.wait()  # the gateway is gone, so its line is at its end
