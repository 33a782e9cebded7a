"""Runs a dead letter's request once more, and sees to it that its end is known whoever dies on the way.

The order is the safety: RETRYING is written, then the guard takes the rule away, then the request is sent under its own
key, then its end is written; whatever did not end in the ledger is refused again. Each step that a death may leave undone is
found by `mend`: a letter that is RETRYING and in nobody's hands is looked up by its key, a rule that is not known to be back
is put back. Because the key is the client's own, a request that is sent twice is done once.

A letter that has no key is never run: its sender was told that nobody knows. A row of a file has a key of its import's,
which asks for it once; its rule is taken away, and a person imports the file again, where all that is booked is passed
over. An event of the ledger is booked already: with its rule it comes back into the balances.
"""

import asyncio
import json
import logging
from collections.abc import Mapping
from datetime import datetime
from typing import Any, Final

import msgspec
from sqlalchemy import RowMapping

from postmortem import placing
from postmortem.courts import Court
from postmortem.dead_letters.life import DRY_RUN_S, Trigger
from postmortem.dead_letters.payload import corrected, decoded
from postmortem.dead_letters.sending import Ledger, Lost, Sent
from postmortem.dead_letters.spool import new_id
from postmortem.guard_line import GuardLine
from postmortem.records import letters
from postmortem.records.opening import Records
from postmortem.records.reads import letter_row
from postmortem.views import Attempt, LetterState, Refusal

#: A gateway that has not read the new rules yet refuses under the old one: so often it is asked again, and when.
STALE_TRIES_MAX: Final = 20
STALE_PAUSE_S: Final = 0.1
#: What a dry run has to say before a letter is run again.
_FIT: Final = frozenset({"survived", "committed"})
_TAKEN_BACK: Final = "released for a new import of its file"
_CORRECTED: Final = "corrected: sent as another request"

_LOG: Final = logging.getLogger("postmortem.retrying")


class _End(msgspec.Struct, frozen=True):
    """How a retry ended: what that does to the letter, one word for its attempt, and why."""

    trigger: Trigger
    outcome: str
    detail: str = ""
    rule: str | None = None


class Retrier(msgspec.Struct):
    """Everything a retry needs. `in_hand`: letters that are being retried by this process."""

    records: Records
    guard: GuardLine
    court: Court
    in_hand: set[str] = msgspec.field(default_factory=set)

    async def dry_run(self, letter_id: str) -> Refusal | None:
        """Try a letter in a throw-away core and note what that said. None: it is noted."""
        row = self._row(letter_id)
        if row is None:
            return Refusal("letter_unknown", {})
        if row["case"] is None:
            return Refusal("letter_without_request", {})
        if row["state"] == LetterState.RETRYING:
            return Refusal("letter_busy", {})
        found = await self.court.try_case(json.loads(row["case"]), row["name"])
        with self.records.writing() as connection:
            letters.put_dry_run(connection, row["id"], found)
        return None

    async def retry(self, letter_id: str, *, anyway: bool) -> Refusal | None:
        """Run a letter once more. None: it was run, and the letter says how that ended."""
        row = self._row(letter_id)
        if row is None:
            return Refusal("letter_unknown", {})
        if (refused := _unfit(row, anyway=anyway)) is not None:
            return refused
        service = await self.guard.service()
        if service is None or not service.serving:
            return Refusal("ledger_away", {})
        with self.records.writing() as connection:
            moved = letters.move(connection, row["id"], Trigger.RETRY, placing.now(), rule_absent=True)
        if isinstance(moved, Refusal):
            return moved
        self.in_hand.add(row["id"])
        try:
            return await self._run(row, Ledger(service.url, service.door))
        finally:
            self.in_hand.discard(row["id"])

    async def _run(self, row: RowMapping, ledger: Ledger) -> Refusal | None:
        told = await self.guard.ask({"verb": "rule-remove", "id": row["rule"], "reason": "retry"})
        if told is None or told.get("ok") is not True:
            self._settle(row, _End(Trigger.UNCERTAIN, "not run", "the guard did not take its rule away"))
            return Refusal("guard_away", {})
        case = json.loads(row["case"])
        if "request" not in case:
            self._settle(row, _end_without_request(case))
            return None
        end = await self._send(row, case, ledger)
        if end is None:
            return Refusal("outcome_unknown", {})  # it stays RETRYING, and `mend` looks it up
        self._settle(row, end)
        await self._put_rules_back()
        return None

    async def correct(self, letter_id: str, body: str) -> Refusal | None:
        """Send other contents as a request of its own. None: it was answered, and the letter says how.

        Its key is made once and written down before it is sent: a death in between leaves a letter whose correction is
        looked up. The letter's own rule stays in force all the time.
        """
        row = self._row(letter_id)
        if row is None:
            return Refusal("letter_unknown", {})
        case = json.loads(row["case"]) if row["case"] else {}
        if "request" not in case:
            return Refusal("letter_without_request", {})
        changed = corrected(case, body)
        if changed is None or decoded(changed) == decoded(case):
            return Refusal("correction_unreadable" if changed is None else "correction_same", {})
        service = await self.guard.service()
        if service is None or not service.serving:
            return Refusal("ledger_away", {})
        key = new_id()
        with self.records.writing() as connection:
            moved = letters.move(connection, row["id"], Trigger.RETRY, placing.now(), correction=key)
        if isinstance(moved, Refusal):
            return moved
        self.in_hand.add(row["id"])
        try:
            return await self._correct(row, changed, key, Ledger(service.url, service.door))
        finally:
            self.in_hand.discard(row["id"])

    async def _correct(
        self, row: RowMapping, changed: Mapping[str, Any], key: str, ledger: Ledger
    ) -> Refusal | None:
        old = row["idempotency_key"]
        is_done = await asyncio.to_thread(ledger.is_done, old) if old else False
        if is_done is not False:
            refused = Refusal("letter_resolved" if is_done else "ledger_away", {})
            trigger = Trigger.CONFIRMED if is_done else Trigger.UNCERTAIN
            self._settle(
                row, _End(trigger, "done" if is_done else "not run", "its own key was looked up first")
            )
            return refused
        end = await self._send(row, changed, ledger, key)
        if end is None:
            return Refusal("outcome_unknown", {})
        self._settle(row, end, key)
        return None

    async def _send(
        self, row: RowMapping, case: Mapping[str, Any], ledger: Ledger, other_key: str = ""
    ) -> _End | None:
        key: str = other_key or row["idempotency_key"]
        answer: Sent | Lost = Lost("it was not sent")
        for _ in range(1 if other_key else STALE_TRIES_MAX):
            answer = await asyncio.to_thread(ledger.send, case, key)
            if not (
                isinstance(answer, Sent) and answer.problem == "set-aside" and answer.letter == row["rule"]
            ):
                break
            await asyncio.sleep(STALE_PAUSE_S)
        end = _end_of(answer)
        if end is not None:
            return end
        return _looked_up(answer, done=await asyncio.to_thread(ledger.is_done, key))

    def _settle(self, row: RowMapping, end: _End, corrected_by: str = "") -> None:
        """Write how a retry, or the request that was sent instead, ended; the letter leaves the queue here or not at all."""
        what, changed = "retry", dict[str, Any](correction=None)
        if corrected_by:
            what, end = "correction", _of_correction(end)
            if end.trigger is Trigger.CORRECTED:
                changed |= {"corrected_by": corrected_by, "discarded_because": _CORRECTED}
        if end.rule is not None:
            changed |= {"rule": end.rule, "rule_absent": False}
        if end.trigger in (Trigger.CONFIRMED, Trigger.RELEASED):
            changed["rule_absent"] = False
        if end.trigger is Trigger.RELEASED:
            changed["discarded_because"] = _TAKEN_BACK
        at = placing.now()
        with self.records.writing() as connection:
            moved = letters.move(connection, row["id"], end.trigger, at, **changed)
            assert not isinstance(moved, Refusal), moved
            letters.add_attempt(connection, row["id"], Attempt(at, what, end.outcome, None, end.detail))

    async def mend(self) -> bool:
        """Finish what a death or a silence left undone; return whether something is left."""
        with self.records.reading() as connection:
            lost = [
                row
                for row in letters.in_state(connection, LetterState.RETRYING)
                if row["id"] not in self.in_hand
            ]
            absent = letters.without_rule(connection)
        if not lost and not absent:
            return False
        service = await self.guard.service()
        if lost and service is not None and service.serving:
            for row in lost:
                await self._look_up(row, Ledger(service.url, service.door))
        if service is not None:
            await self._put_rules_back()
        return True

    async def _look_up(self, row: RowMapping, ledger: Ledger) -> None:
        key = row["correction"] or row["idempotency_key"]
        done = await asyncio.to_thread(ledger.is_done, key) if key else False
        end = _looked_up(Lost("the investigator ended while it was run"), done=done)
        if end is not None and row["id"] not in self.in_hand:
            self._settle(row, end, row["correction"] or "")

    async def _put_rules_back(self) -> None:
        """Have the guard refuse again what was to run once and did not."""
        with self.records.reading() as connection:
            absent = letters.without_rule(connection)
        for row in absent:
            if row["state"] == LetterState.RESOLVED:
                put_back = True
            else:
                told = await self.guard.ask({"verb": "rule-add", "rule": rule_of(row)})
                put_back = told is not None and told.get("ok") is True
                if not put_back:
                    _LOG.warning("the rule of letter %s is not in force yet: %s", row["id"], told)
            if put_back:
                with self.records.writing() as connection:
                    letters.put(connection, row["id"], rule_absent=False)

    def _row(self, letter_id: str) -> RowMapping | None:
        with self.records.reading() as connection:
            return letter_row(connection, letter_id)


def rule_of(row: RowMapping) -> dict[str, Any]:
    """The rule of a letter, as it stood at the guard."""
    accounts = json.loads(row["account_ids"])
    if row["seq"] is not None:
        return {"id": row["rule"], "type": "parked", "seq": row["seq"], "account_ids": accounts}
    # A held one refuses by its name alone: nothing was reproduced.
    held = row["reason"] in ("UNPROVEN", "OPERATOR_HOLD")
    return {
        "id": row["rule"],
        "type": "letter",
        "name": row["name"],
        "digest": None if held else row["digest"],
        "fingerprint": None if held else row["fingerprint"],
        "reason": row["reason"],
        "account_ids": accounts,
    }


def _unfit(row: RowMapping, *, anyway: bool) -> Refusal | None:
    """Why a letter can't be run, if it can't, whatever its state."""
    if row["case"] is None:
        return Refusal("letter_without_request", {})
    if "request" in json.loads(row["case"]) and not row["idempotency_key"]:
        return Refusal("letter_without_key", {})
    if anyway or row["state"] in (LetterState.RETRYING, LetterState.RESOLVED, LetterState.DISCARDED):
        return None  # its life says what is wrong with the latter
    found = json.loads(row["dry_run"]) if row["dry_run"] else None
    if found is None or _age_s(found["at"]) > DRY_RUN_S:
        return Refusal("dry_run_needed", {"minutes": DRY_RUN_S // 60})
    if found["ordeal"] not in _FIT:
        return Refusal("dry_run_failed", {"ordeal": found["ordeal"]})
    return None


def _age_s(at: str) -> float:
    return (datetime.fromisoformat(placing.now()) - datetime.fromisoformat(at)).total_seconds()


def _end_without_request(case: Mapping[str, Any]) -> _End:
    if "row" in case:
        return _End(Trigger.RELEASED, "released", "import its file again: what is booked is passed over")
    return _End(Trigger.CONFIRMED, "taken back into the balances")


def _end_of(answer: Sent | Lost) -> _End | None:
    """How a retry ended by its answer; None: only a look-up can say it."""
    if isinstance(answer, Lost) or answer.status >= 500 or answer.outcome == "unknown":
        return None
    said = f"{answer.status} {answer.problem}: {answer.detail}" if answer.problem else f"{answer.status}"
    if answer.status < 300:
        return _End(Trigger.CONFIRMED, "already done" if answer.replayed else "done", said)
    if answer.status < 400:
        return None
    if answer.problem == "set-aside":
        return _End(Trigger.DECLINED, "set aside again", said, rule=answer.letter or None)
    if answer.status in (408, 425, 429):
        return _End(Trigger.UNCERTAIN, "not run", said)
    # Why it was set aside stays what it was: the ledger's no is that of this one try.
    return _End(Trigger.DECLINED, "refused", said)


def _of_correction(end: _End) -> _End:
    """How the request that was sent instead ended; what the ledger says of it says nothing of the letter's own."""
    trigger = Trigger.CORRECTED if end.trigger is Trigger.CONFIRMED else end.trigger
    return _End(trigger, end.outcome, end.detail)


def _looked_up(answer: Sent | Lost, *, done: bool | None) -> _End | None:
    """How a retry ended by what the ledger has under its key; None: nobody could say it."""
    why = answer.why if isinstance(answer, Lost) else f"{answer.status} {answer.problem}".strip()
    match done:
        case True:
            return _End(Trigger.CONFIRMED, "done", f"found in the ledger ({why})")
        case False:
            return _End(Trigger.UNCERTAIN, "not done", why)
        case None:
            return None
