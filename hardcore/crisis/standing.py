"""What the gateway knows about the core at this moment, and the one thing that follows: its posture.

The feed's face alone does not decide. A request is forwarded only to a core that the feed has named *and*
released, and that has not just hung up on us; so a sentinel that is dead, late or out of order can make
the gateway wait but never make it send a request into an old core. Each fact is folded in by a function
that returns a new value. Asking the core whether it is well was not chosen as the rule (a frozen core's
kernel still accepts): the gateway asks only to end a doubt of its own.
"""

from collections.abc import Collection
from typing import assert_never

import msgspec
from msgspec import structs

from hardcore.crisis.feed import (
    AlertedHeard,
    Heard,
    PhaseHeard,
    QuarantineHeard,
    ReleaseHeard,
    ServingHeard,
    StandingHeard,
    SuspectsHeard,
    VerdictHeard,
    VerifiedHeard,
)
from hardcore.model.phases import Face, HAState

#: Suspects remembered; the oldest are forgotten first. One death names at most as many as a core has slots.
SUSPECTS_MAX = 4096
#: Accounts remembered that suspects would have touched.
ACCOUNTS_MAX = 4096

#: States in which traffic may be sent here.
_READY = frozenset({HAState.OPERATIONAL, HAState.DEGRADED, HAState.SAFE_MODE})


class Serving(msgspec.Struct, frozen=True):
    """Where the serving core listens, and its epoch."""

    socket: str
    epoch: int


class Standing(msgspec.Struct, frozen=True):
    """Everything the gateway knows about the guarded process.

    `suspects`: those that are open, by their names; `account_ids`: what they would have touched.
    `heard_ns` 0: the feed was never heard. `since_ns`: when the phase began, 0 if that was not said.
    `safe`: why the core serves reads only. `sound`: what the proof of the whole ledger said of the serving epoch, None while it runs. `unanswered`: a core
    in doubt was asked for its health since, and did not answer well. `alerted`: what was said last of whether somebody
    was told of an incident.
    """

    generation: int = 0
    phase: str = ""
    state: str = ""
    face: Face = Face.HOLD
    incident: str | None = None
    stage: int | None = None
    since_ns: int = 0
    planned: bool = False
    safe: str | None = None
    serving: Serving | None = None
    sound: bool | None = None
    released: int | None = None
    suspects: tuple[str, ...] = ()
    account_ids: tuple[str, ...] = ()
    doubted: bool = False
    unanswered: bool = False
    heard_ns: int = 0
    alerted: AlertedHeard | None = None


def hear(standing: Standing, message: Heard, now_ns: int) -> Standing | None:
    """Fold a message in; None if it comes from an older sentinel and must not count."""
    if message.generation < standing.generation:
        return None
    known = structs.replace(standing, generation=message.generation, heard_ns=now_ns)
    match message:
        case PhaseHeard(face=face, incident=incident):
            # Whoever stops forwarding takes his release back: the next one may be of another core.
            released = known.released if face is Face.FORWARD else None
            named = incident or (known.incident if face is not Face.FORWARD else None)
            return structs.replace(
                known,
                phase=message.phase,
                state=message.state,
                face=face,
                incident=named,
                stage=message.stage,
                since_ns=message.since_ns,
                planned=message.planned,
                safe=message.safe,
                released=released,
            )
        case ServingHeard(socket=socket, epoch=epoch):
            serving = Serving(socket, epoch)
            if serving == known.serving:
                return known
            return structs.replace(
                known, serving=serving, released=None, doubted=False, unanswered=False, sound=None
            )
        case SuspectsHeard(keys=keys, account_ids=account_ids):
            merged = dict.fromkeys((*known.suspects, *keys))
            accounts = dict.fromkeys((*known.account_ids, *account_ids))
            return structs.replace(
                known,
                suspects=tuple(merged)[-SUSPECTS_MAX:],
                account_ids=tuple(accounts)[-ACCOUNTS_MAX:],
            )
        case VerdictHeard(name=name):
            return unsuspected(known, (name,))
        case AlertedHeard():
            return structs.replace(known, alerted=message)
        case QuarantineHeard() | StandingHeard():
            return known
        case ReleaseHeard(epoch=epoch, incident=incident):
            named = incident or known.incident
            return structs.replace(known, released=epoch, incident=named, doubted=False, unanswered=False)
        case VerifiedHeard(epoch=epoch, ok=ok):
            return structs.replace(known, sound=ok) if _serves(known, epoch) else known
        case _:
            assert_never(message)


def unsuspected(standing: Standing, names: Collection[str]) -> Standing:
    """These are suspects no longer. With the last of them goes what was known of their accounts."""
    left = tuple(one for one in standing.suspects if one not in names)
    return structs.replace(standing, suspects=left, account_ids=standing.account_ids if left else ())


def _serves(standing: Standing, epoch: int) -> bool:
    return standing.serving is not None and standing.serving.epoch == epoch


def doubt(standing: Standing) -> Standing:
    """The core hung up on a request or refused us: hold, whatever the feed says, until somebody knows."""
    return structs.replace(standing, doubted=True)


def trust(standing: Standing) -> Standing:
    """The core answered: the doubt is over."""
    return structs.replace(standing, doubted=False, unanswered=False)


def confirm(standing: Standing) -> Standing:
    """The core was asked and did not answer well: a doubt is more than a doubt now."""
    return structs.replace(standing, unanswered=standing.doubted)


def leaving(standing: Standing) -> Standing:
    """The core says that it is leaving: nothing goes to it any more, unless it is released again."""
    return structs.replace(standing, released=None)


def posture(standing: Standing) -> Face:
    """What the gateway does with a request now."""
    if standing.face is not Face.FORWARD:
        return standing.face
    serving = standing.serving
    if standing.doubted or serving is None or standing.released != serving.epoch:
        return Face.HOLD
    return Face.FORWARD


def alive(standing: Standing, now_ns: int, silence_ms: int) -> bool:
    """Whether the sentinel was heard within `silence_ms`."""
    return bool(standing.heard_ns) and now_ns - standing.heard_ns <= silence_ms * 1_000_000


def ready(standing: Standing) -> bool:
    """Whether a request sent now has a core to go to."""
    return standing.state in _READY and not standing.doubted
