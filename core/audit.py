"""Proof B behind the serving: one core tells its guard once whether the whole ledger is whole.

The proof before READY covers the end of the ledger, so that a core serves at once however old the ledger is.
This one replays all of it while requests are answered: it begins after a rest, rests between its slices, and
gives way when the core leaves. A ledger that is not whole is told and nothing else: the bytes would be the same
in the next core, and what to do about them is a person's decision. Not chosen: a niced thread, which may be
put to sleep while it holds the interpreter's lock and stop the loop with it.
"""

import asyncio
import logging
from typing import Final

from core import departure
from core.guarded.beacon import Beacon
from core.journal.store import StoreError, StoreFault
from core.journal.verify import GivenUp, Verdict
from core.service import Service

logger = logging.getLogger("core")

#: A proof that raises as often as this is no accident of the moment: the ledger is not proven, and that is said.
RAISED_MAX: Final = 2


async def audit_behind(service: Service, beacon: Beacon) -> None:
    """Prove the whole ledger and tell the guard; a store that can't be read now is tried again later."""
    await asyncio.sleep(service.settings.verify_after_ms / 1000)
    raised = 0
    while True:
        try:
            outcome = await service.auditor.verify_behind()
        except Exception as error:
            # Whatever it is: nobody waits for this task, so its end would be silence, and silence reads as "being proven".
            logger.exception("The proof of the whole ledger has failed.")
            raised += 1
            if raised == RAISED_MAX:
                _say(departure.unproven(f"{type(error).__name__}: {error}").sentence, beacon)
                return
            await asyncio.sleep(service.settings.verify_again_ms / 1000)
            continue
        if isinstance(outcome, GivenUp) or _told(outcome, beacon):
            return
        await asyncio.sleep(service.settings.verify_again_ms / 1000)


def _told(outcome: Verdict | StoreError, beacon: Beacon) -> bool:
    """Say what came of it; return False if nothing is known."""
    match outcome:
        case Verdict(ok=True):
            beacon.verified(outcome.events)
            logger.info("The whole ledger is proven, up to event %d.", outcome.events)
            if outcome.parked:
                left_out = ", ".join(map(str, outcome.parked))
                logger.warning("Events that are set aside were left out of that proof: %s.", left_out)
        case Verdict():
            _say_unsound(outcome.reason or "", beacon)
        case StoreError(fault=StoreFault.DAMAGED):
            _say_unsound(f"it can't be read ({outcome.text})", beacon)
        case StoreError():
            logger.warning("The whole ledger can't be proven now (%s); it is tried again.", outcome.text)
            return False
    return True


def _say_unsound(place: str, beacon: Beacon) -> None:
    _say(departure.corrupt(place).sentence, beacon)


def _say(sentence: str, beacon: Beacon) -> None:
    beacon.unsound(sentence)
    logger.error("%s", sentence)
