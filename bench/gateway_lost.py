"""How long a gateway's loss takes: until a client on the same address is answered by another one.

The gateway is killed, or stopped, and a client that dials in that very moment waits in the listener's own line, as a
browser does. What a stop costs above a kill is the guard's patience (`confirm_hang_ms`) and the evidence it takes. The
core is held against being the same one afterwards: nothing of this may reach it.
"""

import signal
import time
from pathlib import Path
from typing import Any

from bench.figures import Figure, Target
from bench.instance import ONE_ACCOUNT, Watched, fill
from examples.line import Line
from hardcore.host.processes import Identity, find, start_of

NS_PER_MS = 1e6
LOST_MS_MAX = 500
WAIT_S = 60.0
LOOK_S = 0.01


def measure(folder: Path, *, kills: int, freezes: int) -> list[Figure]:
    """Kill the gateway so many times, freeze it so many times, and return what it took."""
    data = folder / "gateway-lost"
    # Twenty losses in a minute would be answered with growing pauses; here each is to be the first.
    policy = {"spare": False, "backoff_initial_ms": 1, "backoff_max_ms": 1}
    with Watched(data, policy) as instance:
        fill(instance, 1)
        killed = [_out_of_service_ms(instance, signal.SIGKILL) for _ in range(kills)]
        frozen = [_out_of_service_ms(instance, signal.SIGSTOP) for _ in range(freezes)]
    return [
        Figure("gateway kill -9 -> serving again", "ms", tuple(killed), target=Target(LOST_MS_MAX)),
        Figure("gateway kill -STOP -> serving again", "ms", tuple(frozen)),
    ]


def _out_of_service_ms(instance: Watched, number: signal.Signals) -> float:
    before = _settled(instance, lost=None)
    core, pid = before["core"]["pid"], before["gateway"]["pid"]
    start = start_of(pid)
    gateway = find(Identity(pid, start)) if start is not None else None
    assert gateway is not None, "the guard has just named it"
    hit_ns = time.monotonic_ns()
    gateway.signal(number)
    gateway.close()
    with Line(instance.address) as line:  # dialled now: it waits where every browser does
        answer = line.get(ONE_ACCOUNT)
    assert answer.good, f"a waiting client was told: {answer}"
    after = _settled(instance, lost=pid)
    assert after["core"]["pid"] == core, "the core has to be the same one"
    return (answer.told_ns - hit_ns) / NS_PER_MS


def _settled(instance: Watched, lost: int | None) -> dict[str, Any]:
    """Wait until another gateway than the lost one runs and its story is told; return the status."""
    give_up_at = time.monotonic() + WAIT_S
    while time.monotonic() < give_up_at:
        told = instance.status()
        gateway = told["gateway"]
        if gateway["pid"] not in {None, lost} and gateway["incident"] is None and told["phase"] == "RUNNING":
            return told
        time.sleep(LOOK_S)
    raise TimeoutError("no other gateway came")
