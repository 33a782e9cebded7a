"""A small core without a ledger, as a process of its own: `python -m tests.unit.core_guarded.guest MODE`.

It takes its instruments as the real core does, prints `up`, and then does what MODE says.
"""

import asyncio
import ctypes
import os
import signal
import sys
import threading
from collections.abc import Callable

import uvloop

from core.guarded.control import CheckpointMade, RulesRead, Standing
from core.guarded.drills import AT_ONCE
from core.guarded.environment import GuardedEnvironment
from core.guarded.life import Instruments, guarded_life, take_instruments
from core.guarded.orders import ComponentOrder, DrainOrder, DrillOrder, PromoteOrder, SafeOrder


def say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def fail_in_thread() -> None:
    raise LookupError("a part of the core is gone")


def fail_in_main() -> None:
    raise ValueError("no more core")


class Bare:
    """Takes orders for a core that has neither book nor writer."""

    def standing(self) -> Standing:
        return Standing(epoch=7, seq=12)

    async def switch_safe(self, order: SafeOrder) -> str | None:
        return None if order.on else "It takes no write yet."

    def drill(self, order: DrillOrder) -> Callable[[], object] | str:
        return AT_ONCE.get(order.drill, "There is no writer.")

    def promote(self, _: PromoteOrder) -> Callable[[], object] | str:
        return "This core is no spare."

    async def drain(self, _: DrainOrder) -> int | str:
        return 12

    async def read_rules(self) -> RulesRead | str:
        return RulesRead(serial=3, rules=2)

    async def restart_component(self, _: ComponentOrder) -> str | None:
        return None

    async def checkpoint(self) -> CheckpointMade | str:
        return CheckpointMade("12-7.json", 12)


async def serve(environment: GuardedEnvironment, instruments: Instruments, mode: str) -> None:
    loop = asyncio.get_running_loop()
    term = loop.create_future()
    async with guarded_life(
        environment,
        instruments.recorder,
        instruments.beacon,
        guarded=Bare(),
        on_term=term.set_result,
    ):
        say("up")
        match mode:
            case "fail-in-thread":
                threading.Thread(target=fail_in_thread, name="journal").start()
            case "fail-in-loop":
                loop.call_soon(fail_in_thread)
            case "fail-in-main":
                fail_in_main()
            case "hold-the-interpreter":
                ctypes.PyDLL(None).sleep(3600)
            case _:
                pass
        sender = await term
    instruments.beacon.stopping()
    say(f"term {sender}")


def fork_and_look() -> None:
    if os.fork() == 0:
        say(f"blocked {signal.SIGTERM in signal.pthread_sigmask(signal.SIG_BLOCK, [])}")
        os._exit(0)
    os.wait()


def main(mode: str) -> None:
    if mode == "early-thread":
        threading.Thread(target=threading.Event().wait, daemon=True).start()
    environment = GuardedEnvironment.read(os.environ)
    assert isinstance(environment, GuardedEnvironment), environment
    instruments = take_instruments(environment)
    if not isinstance(instruments, Instruments):
        sys.exit(instruments.reason)
    run: Callable[..., None] = uvloop.run if mode.endswith("uvloop") else asyncio.run
    match mode:
        case "fork":
            fork_and_look()
        case "segv":
            say("up")
            ctypes.string_at(0)
        case _:
            run(serve(environment, instruments, mode))
    instruments.recorder.close()
    instruments.beacon.close()


if __name__ == "__main__":
    main(sys.argv[1])
