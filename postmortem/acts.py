"""What a person may do with letters, groups and proposals (`views.Acts`), each with its line in the audit log.

One desk for the dashboard, the command line and programs, so that all of them can do the same and none can do it without
a trace. What is refused is written down too.
"""

from collections.abc import Sequence
from datetime import datetime
from typing import Any, Final

import msgspec
from sqlalchemy import select

from postmortem import placing
from postmortem.bulks import LETTERS_MAX, VERBS, Lane
from postmortem.dead_letters.life import UNDO_S, Trigger
from postmortem.dead_letters.masking import MASK
from postmortem.dead_letters.ordeals import was_refused
from postmortem.dead_letters.spool import new_id
from postmortem.deciding import Decider
from postmortem.diary import SPEAKER, Diary, shown
from postmortem.incident_acts import IncidentDesk
from postmortem.records import letters, log, stories
from postmortem.records.opening import Records
from postmortem.records.reads import Archive, letters_where
from postmortem.records.tables import LETTERS
from postmortem.retrying import Retrier
from postmortem.views import (
    Bulk,
    Filter,
    Group,
    Letter,
    LetterState,
    Proposal,
    Refusal,
)
from postmortem.wording import cleaned, cleaned_lines, is_said

REASON_MAX: Final = 500
NOTE_MAX: Final = 2_000
VERSION_MAX: Final = 64

#: Which letters a verb is for, where a filter names no state.
_MEANT: Final = {
    "dry-run": (LetterState.QUARANTINED, LetterState.HELD),
    "retry": (LetterState.QUARANTINED,),
    "requeue": (LetterState.QUARANTINED,),
    "hold": (LetterState.QUARANTINED,),
    "discard": (LetterState.QUARANTINED, LetterState.HELD),
}


class Desk(msgspec.Struct):
    """The desk: everything that may be done."""

    records: Records
    archive: Archive
    retrier: Retrier
    decider: Decider
    lane: Lane
    diary: Diary
    incidents: IncidentDesk

    async def dry_run(self, letter_id: str) -> Letter | Refusal:
        """Try a letter in a throw-away core."""
        refused = await self.retrier.dry_run(letter_id)
        return self._told("dry-run", letter_id, refused)

    async def retry(self, letter_id: str, *, anyway: bool = False) -> Letter | Refusal:
        """Run a letter once more, under its own key."""
        refused = await self.retrier.retry(letter_id, anyway=anyway)
        return self._told("retry", letter_id, refused, "anyway" if anyway else "")

    async def correct(self, letter_id: str, body: str) -> Letter | Refusal:
        """Send a letter's contents, changed, as a new request; it is discarded with the link once a core has that."""
        # What was shown hidden would be booked as that; who corrects a secret asks to see it first.
        hidden = Refusal("correction_masked", {}) if MASK in body else None
        refused = hidden or await self.retrier.correct(letter_id, body)
        return self._told("correct", letter_id, refused)

    async def requeue(self, letter_id: str) -> Letter | Refusal:
        """Try and run a letter after those that wait in the lane already."""
        letter = self.archive.letter(letter_id)
        if letter is None or letter.state in (LetterState.RESOLVED, LetterState.DISCARDED):
            code = "letter_unknown" if letter is None else f"letter_{letter.state.lower()}"
            return self._told("requeue", letter_id, Refusal(code, {}))
        begun = await self.bulk("requeue", [letter.id])
        return begun if isinstance(begun, Refusal) else letter

    async def hold(self, letter_id: str) -> Letter | Refusal:
        """Leave a letter out of every bulk until somebody decides."""
        return self._moved("hold", letter_id, Trigger.HOLD)

    async def discard(self, letter_id: str, reason: str) -> Letter | Refusal:
        """Mark a letter as not to be run."""
        said, reason = is_said(reason), cleaned(reason, REASON_MAX)
        if not said:
            return self._told("discard", letter_id, Refusal("reason_needed", {}))
        return self._moved("discard", letter_id, Trigger.DISCARD, reason, discarded_because=reason)

    async def undo_discard(self, letter_id: str) -> Letter | Refusal:
        """Take a discard back, within its time."""
        letter = self.archive.letter(letter_id)
        if letter is not None and letter.state is LetterState.DISCARDED and self._is_over(letter.id):
            return self._told("undo-discard", letter_id, Refusal("too_late", {"seconds": UNDO_S}))
        if letter is not None and letter.corrected_by:
            return self._told("undo-discard", letter_id, Refusal("letter_corrected", {}))
        # A row that was released has no rule any more; to put back one that is there changes nothing.
        return self._moved("undo-discard", letter_id, Trigger.UNDO, discarded_because=None, rule_absent=True)

    async def note(self, letter_id: str, text: str) -> Letter | Refusal:
        """Write a note beside a letter; it replaces the one before."""
        letter = self.archive.letter(letter_id)
        if letter is not None:
            with self.records.writing() as connection:
                letters.put(connection, letter.id, note=cleaned_lines(text, NOTE_MAX))
        return self._told("note", letter_id, None if letter is not None else Refusal("letter_unknown", {}))

    async def bulk(self, verb: str, wanted: Filter | Sequence[str], reason: str = "") -> Bulk | Refusal:
        """Do one of `bulks.VERBS` to many letters, one at a time."""
        refused = self._bulk_refused(verb, wanted, reason)
        reason = cleaned(reason, REASON_MAX)
        if refused is not None:
            self.diary.write(verb, "many letters", reason, refused.code)
            return refused
        meant = self._meant(verb, wanted)
        if not meant:
            self.diary.write(verb, "many letters", reason, "nothing_matches")
            return Refusal("nothing_matches", {})
        bulk_id = new_id()
        with self.records.writing() as connection:
            log.begin_bulk(connection, bulk_id, verb, SPEAKER.get(), meant, reason)
        self.diary.write(verb, f"bulk {bulk_id}: {len(meant)}", reason, "begun")
        self.lane.woken.set()
        return self._bulk(bulk_id)

    async def cancel_bulk(self, bulk_id: str) -> Bulk | Refusal:
        """End a bulk; the letter that is in work is finished, the others stay where they are."""
        with self.records.writing() as connection:
            ended = log.end_bulk(connection, bulk_id, "cancelled")
        if self.archive.bulk(bulk_id) is None:
            return Refusal("bulk_unknown", {})
        self.diary.write("cancel", f"bulk {bulk_id}", "", "ended" if ended else "was over")
        return self._bulk(bulk_id)

    async def decide(self, proposal_id: str, verb: str, owner: str, note: str) -> Proposal | Refusal:
        """Accept, decline, call done or revoke a proposal; what a machine enforces is in force when this returns."""
        return await self.decider.decide(proposal_id, verb, owner, note)

    async def mark_fixed(self, fingerprint: str, version: str) -> Group | Refusal:
        """Call a group fixed in a version."""
        version = cleaned(version, VERSION_MAX)
        with self.records.writing() as connection:
            found = stories.mark_fixed(connection, fingerprint, version, placing.now())
        self.diary.write(
            "fixed", f"group {shown(fingerprint)}", version, "done" if found else "group_unknown"
        )
        return self.archive.group(fingerprint) or Refusal("group_unknown", {})

    def _moved(
        self, verb: str, letter_id: str, trigger: Trigger, reason: str = "", **columns: Any
    ) -> Letter | Refusal:
        with self.records.writing() as connection:
            found = letters.move(connection, letter_id, trigger, placing.now(), **columns)
        return self._told(verb, letter_id, found if isinstance(found, Refusal) else None, reason)

    def _told(self, verb: str, letter_id: str, refused: Refusal | None, reason: str = "") -> Letter | Refusal:
        """Write an act down and give back what is now."""
        letter = self.archive.letter(letter_id)
        found = refused or letter or Refusal("letter_unknown", {})
        outcome = found.code if isinstance(found, Refusal) else str(found.state)
        if verb == "dry-run" and isinstance(found, Letter) and found.dry_run is not None:
            outcome = "refused" if was_refused(found.dry_run) else found.dry_run.ordeal
        self.diary.write(verb, f"letter {shown(letter_id)}", reason, outcome)
        return found

    def _is_over(self, letter_id: str) -> bool:
        with self.records.reading() as connection:
            asked = select(LETTERS.c.settled_at).where(LETTERS.c.id == letter_id)
            settled_at = connection.execute(asked).scalar_one()
        gone = datetime.fromisoformat(placing.now()) - datetime.fromisoformat(settled_at)
        return gone.total_seconds() > UNDO_S

    def _bulk_refused(self, verb: str, wanted: Filter | Sequence[str], reason: str) -> Refusal | None:
        if verb not in VERBS:
            return Refusal("verb_unknown", {"verb": shown(verb)})
        if verb == "discard" and not is_said(reason):
            return Refusal("reason_needed", {})
        if not isinstance(wanted, Filter) and len(wanted) > LETTERS_MAX:
            return Refusal("too_many", {"count": len(wanted), "max": LETTERS_MAX})
        return None

    def _meant(self, verb: str, wanted: Filter | Sequence[str]) -> list[str]:
        """The letters that are meant, the oldest first, at most LETTERS_MAX."""
        if not isinstance(wanted, Filter):
            known = (self.archive.letter(one) for one in dict.fromkeys(wanted))
            return [letter.id for letter in known if letter is not None]
        where = letters_where(wanted)
        if not wanted.state:
            where.append(LETTERS.c.state.in_(_MEANT[verb]))
        order = LETTERS.c.quarantined_at, LETTERS.c.id
        with self.records.reading() as connection:
            asked = select(LETTERS.c.id).where(*where).order_by(*order).limit(LETTERS_MAX)
            return list(connection.execute(asked).scalars())

    def _bulk(self, bulk_id: str) -> Bulk:
        found = self.archive.bulk(bulk_id)
        assert found is not None, bulk_id
        return found


async def do_one(desk: Desk, verb: str, letter_id: str, reason: str) -> Letter | Refusal:
    """Do one letter of a bulk: what is run there is tried first."""
    match verb:
        case "dry-run":
            return await desk.dry_run(letter_id)
        case "retry" | "requeue":
            tried = await desk.dry_run(letter_id)
            return tried if isinstance(tried, Refusal) else await desk.retry(letter_id)
        case "hold":
            return await desk.hold(letter_id)
        case _:
            assert verb == "discard", verb
            return await desk.discard(letter_id, reason)
