"""How each peer is set up: its files, its command, and what is known of how it notices a hang.

Every setting was chosen for speed, within what the peer's own manual offers; where a peer can hold the listening
socket, it does. A peer that is not installed is left out and named. Nothing here is installed by itself: `make peers`
puts what PyPI and npm have under ./var/peers and says which Debian packages are missing.
"""

import json
import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
HOME = ROOT / "var" / "peers"
GUEST = "bench.peers.guest:app"


@dataclass(frozen=True, slots=True)
class Ground:
    """Where one peer runs: a folder of its own, the port its guest is to be asked at, and the guest's environment."""

    folder: Path
    port: int
    environment: dict[str, str]

    def write(self, name: str, text: str, *, mode: int = 0o600) -> Path:
        """Write a file of the peer's."""
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, "utf-8")
        path.chmod(mode)
        return path


@dataclass(frozen=True, slots=True)
class Recipe:
    """One peer. `prepare` writes its files and returns its command; `workers`: how many guests it runs at once.

    `watches`: it looks at more than the guest's death. `rest_s`: how long it has to be left alone between two blows (one
    gives the whole server up at two deaths within some seconds). `program` must be installed.
    """

    name: str
    program: str
    prepare: Callable[[Ground], list[str]]
    workers: int = 1
    watches: bool = False
    rest_s: float = 1.5

    def installed(self) -> bool:
        """Whether it can take part."""
        return found(self.program) is not None


def found(program: str) -> str | None:
    """Return where a program is, looked for under ./var/peers first."""
    places = [HOME / "venv" / "bin", HOME / "node" / "node_modules" / ".bin"]
    path = os.pathsep.join([*map(str, places), os.environ.get("PATH", ""), "/usr/sbin", "/usr/bin"])
    return shutil.which(program, path=path)


def _program(name: str) -> str:
    place = found(name)
    assert place is not None, f"{name} was looked for before"
    return place


def _python() -> str:
    return str(HOME / "venv" / "bin" / "python")


def _bare(ground: Ground) -> list[str]:
    """Return the guest's own command, for peers that start a command and know nothing of sockets."""
    return [
        _python(), "-m", "uvicorn", GUEST, "--host", "127.0.0.1", "--port", str(ground.port),
        "--loop", "uvloop", "--http", "httptools", "--ws", "none", "--lifespan", "off",
        "--no-access-log", "--log-level", "error",
    ]  # fmt: skip


def _on_socket(descriptor: str) -> list[str]:
    return [
        _python(), "-m", "uvicorn", GUEST, "--fd", descriptor, "--loop", "uvloop", "--http", "httptools",
        "--ws", "none", "--lifespan", "off", "--no-access-log", "--log-level", "error",
    ]  # fmt: skip


def _line(command: list[str]) -> str:
    return " ".join(command)


def _loop(ground: Ground) -> list[str]:
    script = ground.write("run", f"#!/bin/sh\nwhile :; do {_line(_bare(ground))}; done\n", mode=0o700)
    return [str(script)]


def _supervisord(ground: Ground) -> list[str]:
    url = f"http://127.0.0.1:{ground.port}/api/ledger/accounts/assets:bank"
    text = f"""[supervisord]
nodaemon=true
logfile={ground.folder}/supervisord.log
pidfile={ground.folder}/supervisord.pid
[unix_http_server]
file={ground.folder}/s.sock
[rpcinterface:supervisor]
supervisor.rpcinterface_factory = supervisor.rpcinterface:make_main_rpcinterface
[supervisorctl]
serverurl=unix://{ground.folder}/s.sock
[program:guest]
command={_line(_bare(ground))}
autorestart=true
startsecs=0
startretries=1000
stopasgroup=true
killasgroup=true
stopwaitsecs=1
stdout_logfile=NONE
stderr_logfile=NONE
[eventlistener:httpok]
command={_program("httpok")} -p guest -t 1 {url}
events=TICK_5
"""
    return [_program("supervisord"), "-c", str(ground.write("supervisord.conf", text))]


def _circus(ground: Ground) -> list[str]:
    text = f"""[circus]
check_delay = 0.2
endpoint = ipc://{ground.folder}/endpoint
pubsub_endpoint = ipc://{ground.folder}/pubsub
[watcher:guest]
cmd = {_line(_on_socket("$(circus.sockets.web)"))}
use_sockets = True
numprocesses = 1
copy_env = True
warmup_delay = 0
[socket:web]
host = 127.0.0.1
port = {ground.port}
"""
    return [_program("circusd"), str(ground.write("circus.ini", text))]


def _gunicorn(workers: int, *, preload: bool) -> Callable[[Ground], list[str]]:
    def prepare(ground: Ground) -> list[str]:
        command = [
            _program("gunicorn"), GUEST, "-k", "uvicorn_worker.UvicornWorker", "-w", str(workers),
            "-b", f"127.0.0.1:{ground.port}", "--timeout", "1", "--graceful-timeout", "1",
            "--log-level", "critical",
        ]  # fmt: skip
        return [*command, "--preload"] if preload else command

    return prepare


def _uvicorn(ground: Ground) -> list[str]:
    return [*_bare(ground), "--workers", "2", "--timeout-worker-healthcheck", "1"]


def _granian(workers: int) -> Callable[[Ground], list[str]]:
    def prepare(ground: Ground) -> list[str]:
        return [
            _program("granian"), "--interface", "asgi", "--host", "127.0.0.1", "--port", str(ground.port),
            "--workers", str(workers), "--respawn-failed-workers", "--respawn-interval", "0", "--no-ws",
            "--no-log", GUEST,
        ]  # fmt: skip

    return prepare


def _pm2(ground: Ground) -> list[str]:
    apps = {
        "name": "guest",
        "script": _python(),
        "args": _bare(ground)[1:],
        "interpreter": "none",
        "restart_delay": 0,
        "max_restarts": 100_000,
        "cwd": str(ROOT),
        "env": ground.environment,
    }
    text = json.dumps({"apps": [apps]})
    return [_program("pm2-runtime"), "start", str(ground.write("pm2.config.json", text))]


def _monit(ground: Ground) -> list[str]:
    settings = " ".join(f"{name}={value}" for name, value in ground.environment.items())
    # The shell around the guest stays and reaps it: where nobody does, monit takes a zombie for a living process.
    start = ground.write(
        "start",
        f"#!/bin/sh\ncd {ROOT}\n(env -i {settings} setsid {_line(_bare(ground))} >/dev/null 2>&1 &\n"
        f"echo $! >{ground.folder}/guest.pid; wait) >/dev/null 2>&1 &\n",
        mode=0o700,
    )
    stop = ground.write("stop", f"#!/bin/sh\nkill -9 $(cat {ground.folder}/guest.pid)\n", mode=0o700)
    text = f"""set daemon 1
set pidfile {ground.folder}/monit.pid
set idfile {ground.folder}/monit.id
set statefile {ground.folder}/monit.state
check process guest with pidfile {ground.folder}/guest.pid
  start program = "{start}" with timeout 1 seconds
  stop program = "{stop}" with timeout 1 seconds
  if failed host 127.0.0.1 port {ground.port} protocol http
     request "/api/ledger/accounts/assets:bank" with timeout 1 seconds then restart
"""
    return [_program("monit"), "-I", "-c", str(ground.write("monitrc", text))]


def _runit(ground: Ground) -> list[str]:
    ground.write("guest/run", f"#!/bin/sh\nexec {_line(_bare(ground))}\n", mode=0o700)
    return [_program("runsv"), str(ground.folder / "guest")]


def _s6(ground: Ground) -> list[str]:
    ground.write("guest/run", f"#!/bin/sh\nexec {_line(_bare(ground))}\n", mode=0o700)
    return [_program("s6-supervise"), str(ground.folder / "guest")]


PEERS: tuple[Recipe, ...] = (
    Recipe("sh `while` loop (control)", "sh", _loop),
    Recipe("supervisord + httpok", "supervisord", _supervisord, watches=True),
    Recipe("circus, its own socket", "circusd", _circus),
    Recipe("pm2", "pm2-runtime", _pm2),
    Recipe("monit, 1 s cycle, http check", "monit", _monit, watches=True),
    Recipe("runit", "runsv", _runit),
    Recipe("s6", "s6-supervise", _s6),
    Recipe("gunicorn --preload -w 1", "gunicorn", _gunicorn(1, preload=True), watches=True),
    Recipe("gunicorn -w 1", "gunicorn", _gunicorn(1, preload=False), watches=True),
    Recipe("gunicorn --preload -w 2", "gunicorn", _gunicorn(2, preload=True), workers=2, watches=True),
    Recipe("uvicorn --workers 2", "uvicorn", _uvicorn, workers=2, watches=True),
    Recipe("granian --workers 1", "granian", _granian(1), rest_s=7.0),
    Recipe("granian --workers 2", "granian", _granian(2), workers=2, rest_s=7.0),
)
