"""Does the same to many letters: one at a time, slowly, and nothing is lost whenever it ends.

Which letters are meant is written down before the first is touched, and each one's end after it; so a bulk goes on where it
stood after the death of this process, and a cancel leaves every letter where it is. A retry is tried in a throw-away core
first, each letter by itself, just before it is run. The lane stops by itself as soon as the service goes down or another
core serves: what kills a core must not meet the next one.
"""

import asyncio
import logging
from collections.abc import Awaitable, Callable
from typing import Final

import msgspec
from sqlalchemy import RowMapping

from postmortem.dead_letters.ordeals import went_well
from postmortem.diary import SPEAKER
from postmortem.guard_line import GuardLine
from postmortem.records import log
from postmortem.records.opening import Records
from postmortem.views import Letter, LetterState, Refusal

#: Letters of one bulk.
LETTERS_MAX: Final = 500
#: Pause between two letters that are run.
PACE_S: Final = 1.0
VERBS: Final = frozenset({"dry-run", "retry", "requeue", "hold", "discard"})
#: Verbs that a core has to answer, so that a bulk of them stops with the service.
_RUN: Final = frozenset({"retry", "requeue"})
#: What became of an item if its letter is where the verb would have it already.
_THERE: Final = frozenset({"letter_resolved", "letter_held", "letter_discarded"})
_STOPS: Final = frozenset({"ledger_away", "guard_away", "outcome_unknown"})

_LOG: Final = logging.getLogger("postmortem.bulks")

Do = Callable[[str, str, str], Awaitable[Letter | Refusal]]  # verb, letter, reason


class Lane(msgspec.Struct):
    """The one lane of all bulks. `do`: does one letter; `woken`: there may be something to do."""

    records: Records
    guard: GuardLine
    do: Do
    pace_s: float = PACE_S
    woken: asyncio.Event = msgspec.field(default_factory=asyncio.Event)
    busy: bool = False

    async def run(self) -> None:
        """Do what waits, and wait for more, for ever."""
        while True:
            self.woken.clear()
            with self.records.writing() as connection:
                found = log.next_of_bulks(connection)
            self.busy = found is not None
            if found is None:
                await self.woken.wait()
                continue
            bulk, place, letter_id = found
            ended = await self._do_one(bulk, place, letter_id)
            if ended:
                with self.records.writing() as connection:
                    log.end_bulk(connection, bulk["id"], ended)
            elif bulk["verb"] in _RUN or bulk["verb"] == "dry-run":
                await asyncio.sleep(self.pace_s)

    async def _do_one(self, bulk: RowMapping, place: int, letter_id: str) -> str:
        """Do one letter of a bulk and write down its end; return why the bulk stops, or nothing."""
        verb = bulk["verb"]
        before = await self.guard.service() if verb in _RUN else None
        if verb in _RUN and (before is None or not before.serving):
            return "stopped"
        SPEAKER.set(bulk["who"])
        found = await self.do(verb, letter_id, bulk["reason"])
        outcome = "done"
        if isinstance(found, Refusal):
            outcome = "done" if found.code in _THERE else found.code
        elif verb in _RUN and found.state is not LetterState.RESOLVED:
            outcome = "not_resolved"
        elif verb == "dry-run" and not (found.dry_run and went_well(found.dry_run)):
            outcome = "dry_run_failed"
        with self.records.writing() as connection:
            log.put_item(connection, bulk["id"], place, outcome)
        if isinstance(found, Refusal) and found.code in _STOPS:
            return "stopped"
        if before is not None:
            after = await self.guard.service()
            if after is None or not after.serving or after.epoch != before.epoch:
                _LOG.warning("bulk %s stopped: the service went down at letter %s", bulk["id"], letter_id)
                return "stopped"
        return ""
