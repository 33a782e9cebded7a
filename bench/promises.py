"""What was promised of high availability, each promise with the number of this machine.

The promises are those that production-readiness plans make and seldom measure: a restart, a failover, the others
unaffected, somebody told, a recovery begun, a recovery that succeeds. Each is taken from outside: a client's clock, a
webhook's arrival, the incident's own timeline.
"""

import contextlib
import http.server
import json
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from bench import deaths
from bench.figures import Figure, Target
from bench.instance import ONE_ACCOUNT, Watched, fill
from examples.guarded import GuardError
from examples.line import Line
from hardcore.control import client

NS_PER_MS = 1e6
TRANSACTIONS = 200
RESTART_MS, FAILOVER_MS, UNAFFECTED_MS, ALERT_MS, BEGUN_MS, SUCCESS_SHARE = 5000, 5000, 100, 5000, 10_000, 95
TOLD_S = 20.0
ASK_EVERY_S = 0.005
SPARE_S = 30.0


class Ear(http.server.BaseHTTPRequestHandler):
    """Hears alerts as a webhook's receiver would."""

    def do_POST(self) -> None:
        """Take one alert in, with the time of its arrival."""
        said = self.rfile.read(int(self.headers.get("Content-Length", 0)))
        self.server.heard.append((time.monotonic_ns(), json.loads(said)))  # type: ignore[attr-defined]
        self.send_response(204)
        self.end_headers()

    def log_message(self, *_: object) -> None:
        """Say nothing: what is heard is what counts."""


@contextlib.contextmanager
def ear() -> Iterator[tuple[str, list[tuple[int, Any]]]]:
    """Listen for alerts; give the address and what was heard so far."""
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Ear)
    heard: list[tuple[int, Any]] = []
    server.heard = heard  # type: ignore[attr-defined]
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}/", heard
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


def measure(folder: Path, *, rounds: int) -> list[Figure]:
    """Measure each promise so many times."""
    with ear() as (url, heard):
        channel = {"kind": "webhook", "url": url, "min_interval_s": 0}
        with Watched(folder / "promises", {"alerts": [channel], "drills": True}) as instance:
            fill(instance, TRANSACTIONS)
            failovers, told, begun, well = _failovers(instance, heard, rounds)
            unaffected = [_while_a_part_is_restarted(instance) for _round in range(rounds)]
        with Watched(folder / "cold", deaths.COLD) as instance:
            fill(instance, TRANSACTIONS)
            restarts = [deaths.out_of_service_ms(instance, signal.SIGKILL) for _ in range(rounds)]
            instance.quiet()
    return [
        Figure("unexpected exit -> working again", "ms", tuple(restarts), target=Target(RESTART_MS)),
        Figure("failover to the standby", "ms", tuple(failovers), target=Target(FAILOVER_MS)),
        Figure("others, while one part is restarted", "ms", tuple(unaffected), target=Target(UNAFFECTED_MS)),
        Figure("fault -> somebody is told", "ms", tuple(told), target=Target(ALERT_MS)),
        Figure("fault -> recovery begun", "ms", tuple(begun), target=Target(BEGUN_MS)),
        Figure("recoveries that succeed", "%", (well,), target=Target(SUCCESS_SHARE, least=True)),
    ]


def _failovers(
    instance: Watched, heard: list[tuple[int, Any]], rounds: int
) -> tuple[list[float], list[float], list[float], float]:
    """Freeze and kill in turn; return how long each took, the alert, the first deed, and the share that succeeded."""
    took, told, begun, recovered = [], [], [], 0
    for number in range(rounds):
        instance.until(lambda s: bool((s["spare"] or {}).get("ready")), "a spare", SPARE_S)
        heard.clear()
        hit_ns = time.monotonic_ns()
        how = signal.SIGSTOP if number % 2 else signal.SIGKILL
        took.append(deaths.out_of_service_ms(instance, how))
        told.append((_first(heard) - hit_ns) / NS_PER_MS)
        instance.quiet()
        begun.append(instance.last_timeline().get("detected", 0.0))
        recovered += _outcome(instance) == "recovered"
    return took, told, begun, 100 * recovered / rounds


def _first(heard: list[tuple[int, Any]]) -> int:
    give_up_at = time.monotonic() + TOLD_S
    while not heard:
        if time.monotonic() > give_up_at:
            raise GuardError(f"Nobody was told within {TOLD_S:g} s.")
        time.sleep(ASK_EVERY_S)
    return heard[0][0]


def _outcome(instance: Watched) -> str:
    last = instance.folders.incidents / str(instance.status()["last_incident"]) / "incident.json"
    return str(json.loads(last.read_text("utf-8"))["outcome"])


def _while_a_part_is_restarted(instance: Watched) -> float:
    """Have the importer started anew and ask all the while; return the longest answer in ms."""
    longest = 0.0
    over = threading.Event()

    def restart() -> None:
        try:
            asked = {"verb": "restart", "component": "importer", "reason": "bench"}
            told = client.ask(instance.folders.control, asked)
            if told.get("ok") is not True:
                raise GuardError(f"The importer was not restarted: {told}")
        finally:
            over.set()

    thread = threading.Thread(target=restart)
    with Line(instance.address) as line:
        assert line.get(ONE_ACCOUNT).good, "asked before, so that the connection stands"
        thread.start()
        while not over.is_set():
            began_ns = time.monotonic_ns()
            answer = line.get(ONE_ACCOUNT)
            assert answer.good, f"a client was told: {answer}"
            longest = max(longest, (time.monotonic_ns() - began_ns) / NS_PER_MS)
            time.sleep(ASK_EVERY_S)
    thread.join()
    instance.quiet()
    return longest
