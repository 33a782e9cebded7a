"""How much goes through: reads through the gateway beside reads straight from the core, and durable bookings.

The real ledger answers, over real sockets; two processes of plain sockets push. Both ways are measured in turn,
so that a busy minute of the machine hits both. A booking counts when its 201 is there, which is after the commit
has reached the disk.
"""

import json
import subprocess
import sys
from pathlib import Path

from bench.figures import Baseline, Figure
from bench.instance import Watched, fill

PUSHERS = 2
CONNECTIONS = 16
MARGIN_S = 30.0


def measure(folder: Path, *, rounds: int, seconds: float) -> list[Figure]:
    """Push in turn, for so many seconds each time."""
    through, straight, booked, straight_booked = [], [], [], []
    with Watched(folder / "rates") as instance:
        fill(instance, 0)
        instance.quiet()
        gateway, core = "{}:{}".format(*instance.address), str(instance.core_socket())
        for number in range(rounds):
            straight.append(rate("read", core, seconds, ""))
            through.append(rate("read", gateway, seconds, ""))
            straight_booked.append(rate("book", core, seconds, f"straight-{number}"))
            booked.append(rate("book", gateway, seconds, f"through-{number}"))
    beside = "straight to the core"
    return [
        Figure("reads through the gateway", "/s", tuple(through), Baseline(beside, tuple(straight))),
        Figure("durable bookings", "/s", tuple(booked), Baseline(beside, tuple(straight_booked))),
    ]


def rate(kind: str, address: str, seconds: float, name: str, connections: int = CONNECTIONS) -> float:
    """Return how many requests of a kind a second are answered well, over so many connections of each pusher."""
    argv = [sys.executable, "-m", "bench.pusher", kind, address, str(connections), str(seconds)]
    pushers = [
        subprocess.Popen([*argv, f"{name}-{number}"], stdout=subprocess.PIPE, start_new_session=True)
        for number in range(PUSHERS)
    ]
    try:
        counted = [json.loads(pusher.communicate(timeout=seconds + MARGIN_S)[0]) for pusher in pushers]
    finally:
        for pusher in pushers:
            pusher.kill()
            pusher.wait()
    bad = sum(each["bad"] for each in counted)
    assert not bad, f"{bad} answers were not good"
    return sum(float(each["good"] / each["seconds"]) for each in counted)
