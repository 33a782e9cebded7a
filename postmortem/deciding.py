"""A person's word on a proposal, and the guard's rule that follows from it: both, or neither, whoever dies between.

A proposal's rule has an id made of the proposal's, so the same wish twice is one rule, and a rule in force is known again
by an archive that was lost. Before the guard is asked, the row says that what the guard has is not sure; from then on
it is brought in line with the row (`mend`) until the guard has answered. To ask first and write afterwards was not
chosen: a death between left a rule in force that nobody could see or revoke.
"""

import asyncio
import json
from collections.abc import Mapping
from typing import Any, Final

import msgspec
from sqlalchemy import RowMapping

from postmortem.diary import Diary, shown
from postmortem.guard_line import GuardLine
from postmortem.records import log
from postmortem.records.opening import Records
from postmortem.records.reads import Archive
from postmortem.records.stories import rule_id
from postmortem.views import Proposal, ProposalState, Refusal
from postmortem.wording import cleaned, cleaned_lines

OWNER_MAX: Final = 500
NOTE_MAX: Final = 2_000
REASON_MAX: Final = 500


class Decider(msgspec.Struct, frozen=True):
    """Takes decisions, one after the other: two at once would ask the guard for two things."""

    records: Records
    archive: Archive
    guard: GuardLine
    diary: Diary
    _one: asyncio.Lock = msgspec.field(default_factory=asyncio.Lock)

    async def decide(self, proposal_id: str, verb: str, owner: str, note: str) -> Proposal | Refusal:
        """Accept, decline, call done or revoke a proposal; what a machine enforces is in force when this returns."""
        owner, note = cleaned(owner, OWNER_MAX), cleaned_lines(note.strip(), NOTE_MAX)
        async with self._one:
            with self.records.writing() as connection:
                meant = log.decided(connection, proposal_id, verb)
                if not isinstance(meant, Refusal) and _is_for_the_guard(meant[0], verb):
                    log.put_decision(connection, proposal_id, unsure=True)
            found = meant if isinstance(meant, Refusal) else await self._decide(*meant, verb, owner, note)
        outcome = found.code if isinstance(found, Refusal) else str(found.state)
        self.diary.write(verb, f"proposal {shown(proposal_id)}", note[:REASON_MAX], outcome)
        return found

    async def _decide(
        self, row: RowMapping, state: ProposalState, verb: str, owner: str, note: str
    ) -> Proposal | Refusal:
        told: dict[str, Any] = {"state": state, "owner": owner or row["owner"], "note": note or row["note"]}
        if _is_for_the_guard(row, verb):
            answer = await self.guard.ask(_order(row, state))
            if answer is None:
                return Refusal("guard_away", {})  # it may have heard us: `mend` sees to it
            if answer.get("ok") is not True:
                with self.records.writing() as connection:
                    log.put_decision(connection, row["id"], unsure=False)
                return Refusal("guard_refused", {"why": str(answer.get("error", ""))[:REASON_MAX]})
            told |= {"unsure": False, "rule_id": _rule_of(row, answer) if verb == "accept" else None}
        with self.records.writing() as connection:
            log.put_decision(connection, row["id"], **told)
        return next(one for one in self.archive.proposals(row["incident"]) if one.id == row["id"])

    async def mend(self) -> bool:
        """Have the guard enforce what the rows say, where that is not sure; return whether something is left."""
        async with self._one:
            with self.records.reading() as connection:
                unsure = log.unsure_decisions(connection)
            for row in unsure:
                answer = await self.guard.ask(_order(row, ProposalState(row["state"])))
                if answer is None:
                    return True
                if answer.get("ok") is True:
                    with self.records.writing() as connection:
                        log.put_decision(connection, row["id"], unsure=False)
        return False


def _is_for_the_guard(row: RowMapping, verb: str) -> bool:
    return verb == "accept" or (verb == "revoke" and row["rule_id"] is not None)


def _order(row: RowMapping, state: ProposalState) -> Mapping[str, Any]:
    """What the guard is asked for so that it enforces what this state says."""
    identity = row["rule_id"] or rule_id(row["id"])
    if state is ProposalState.ACCEPTED:
        return {"verb": "rule-add", "rule": {**json.loads(row["rule"]), "id": identity}}
    return {"verb": "rule-remove", "id": identity, "reason": "revoked"}


def _rule_of(row: RowMapping, answer: Mapping[str, Any]) -> str:
    given = answer.get("id")
    return given if isinstance(given, str) and given else rule_id(row["id"])
