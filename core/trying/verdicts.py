"""What became of a case, as a value, and what a core's end says about the case it had.

Only what can have come from inside says anything: a fatal signal of its own, an exit that nobody asked for, silence, growth.
A signal that somebody else sends, and an end at which the core itself blames its store, leave the case untried. Pure.
"""

import signal
from enum import StrEnum
from typing import Any, Final, assert_never

import msgspec

from core.departure import ExitCode
from core.trying.watch import Ending, How

WHY_CHARACTERS_MAX: Final = 400
ACCOUNTS_MAX: Final = 500
_OWN_SIGNALS: Final = frozenset(
    {
        signal.SIGSEGV,
        signal.SIGABRT,
        signal.SIGBUS,
        signal.SIGFPE,
        signal.SIGILL,
        signal.SIGSYS,
        signal.SIGTRAP,
    }
)
# With these a core says what its store or its disk did to it; `BUG` is its own.
_NOT_THE_CASE: Final = frozenset(ExitCode) - {ExitCode.ASKED, ExitCode.BUG}


class Ordeal(StrEnum):
    """What became of a case."""

    DIED = "died"
    HUNG = "hung"
    GREW = "grew"
    SURVIVED = "survived"
    COMMITTED = "committed"
    UNTRIED = "untried"


CONVICTS: Final = frozenset({Ordeal.DIED, Ordeal.HUNG, Ordeal.GREW})


class Exit(msgspec.Struct, frozen=True):
    """How its process ended, where it did by itself."""

    code: int | None = None
    signal: int | None = None


class Verdict(msgspec.Struct, frozen=True, tag_field="type", tag="tried"):
    """What is said of a case (`docs/wires.md` section 12)."""

    name: str
    ordeal: Ordeal
    fingerprint: str | None = None
    kind: str = ""
    account_ids: tuple[str, ...] = ()
    transaction_id: str = ""
    exit: Exit = Exit()
    ms: int = 0
    status: int | None = None
    answer: Any = None
    frame: str = ""
    seq: int | None = None
    why: str = ""


def untried(name: str, why: str) -> Verdict:
    """Return that nobody could try it."""
    return Verdict(name, Ordeal.UNTRIED, why=why[:WHY_CHARACTERS_MAX])


def ended(name: str, ending: Ending) -> Verdict:
    """Return what the end of a core says of the case that it had."""
    match ending.how:
        case How.HUNG:
            return Verdict(name, Ordeal.HUNG, frame=ending.frame)
        case How.GREW:
            return Verdict(name, Ordeal.GREW, frame=ending.frame)
        case How.SLOW:
            return untried(name, ending.why)
        case How.DIED:
            return _died(name, ending)
        case _:
            assert_never(ending.how)


def _died(name: str, ending: Ending) -> Verdict:
    how = Exit(ending.code, ending.signal)
    if ending.signal is not None and ending.signal not in _OWN_SIGNALS:
        return msgspec.structs.replace(untried(name, f"signal {ending.signal} came from outside"), exit=how)
    if ending.code in _NOT_THE_CASE:
        why = f"the throw-away core's store failed (exit {ending.code})"
        return msgspec.structs.replace(untried(name, why), exit=how)
    return Verdict(name, Ordeal.DIED, exit=how, frame=ending.frame)


def whose_of(told: dict[str, Any]) -> dict[str, Any]:
    """Return the members of a verdict that a core has told of a command before it did it."""
    if "fingerprint" not in told:
        return {}
    return {
        "fingerprint": str(told["fingerprint"]),
        "kind": str(told["kind"]),
        "account_ids": tuple(map(str, told["account_ids"][:ACCOUNTS_MAX])),
        "transaction_id": str(told["transaction_id"]),
    }
