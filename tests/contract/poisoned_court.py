"""A court whose cores meet poisons: the program itself, in which deciding does what a description asks for.

Only the one function that decides is replaced, before anything is forked; the court, its cores and the way of a command
through them are what they always are.
"""

import os
import signal
import threading
from collections.abc import Callable
from typing import Any

import core.journal.batch
from core.ledger.commands import PostTransaction
from core.ledger.decider import decide
from core.ledger.entries import RecordEntry
from core.main import cli

_damage: list[str] = []


def _eat() -> None:
    eaten = [bytes(1 << 20) + b"x" for _ in range(600)]
    threading.Event().wait(len(eaten))


def _wait() -> None:
    lock = threading.Lock()
    with lock:
        lock.acquire()


POISONS: dict[str, Callable[[], object]] = {
    "exit": lambda: os._exit(3),
    "abort": os.abort,
    "wait": _wait,
    "eat": _eat,
    "spoil": lambda: _damage.append("done"),
    "killed from outside": lambda: os.kill(os.getpid(), signal.SIGKILL),
    "stopped from outside": lambda: os.kill(os.getpid(), signal.SIGSTOP),
}


def poisoned(command: Any, *parts: Any, **named: Any) -> Any:
    if _damage:
        os.abort()
    said = command.description if isinstance(command, PostTransaction) else ""
    if isinstance(command, RecordEntry):
        said = command.details.description.split("-")[0]
    POISONS.get(said, lambda: None)()
    return decide(command, *parts, **named)


if __name__ == "__main__":
    setattr(core.journal.batch, "decide", poisoned)  # noqa: B010  no module says that it lends this name
    cli()
