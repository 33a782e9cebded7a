"""What a person may do with incidents and their groups (`views.IncidentActs`), each with its line in the audit log.

Groups are put together and taken apart by a word that is kept beside the fingerprints, never by changing them: what the
reports found stays as it is, and the word can be taken back. The evidence of an incident can be removed, for it may hold
what nobody wants to keep; that there was an incident can't.
"""

import asyncio
from pathlib import Path
from typing import Final

import msgspec

from postmortem import bundle, keeping
from postmortem.diary import Diary, shown
from postmortem.records import stories
from postmortem.records.opening import Records
from postmortem.records.reads import Archive
from postmortem.views import Group, IncidentLine, Refusal
from postmortem.wording import cleaned_lines

NOTE_MAX: Final = 2_000


class IncidentDesk(msgspec.Struct, frozen=True):
    """The desk for incidents. `folder`: where their evidence lies."""

    records: Records
    archive: Archive
    diary: Diary
    folder: Path

    async def merge(self, fingerprint: str, into: str) -> Group | Refusal:
        """Put a group into another one, its later deaths too."""
        with self.records.writing() as connection:
            refused = stories.merge(connection, fingerprint, into)
        return self._told("merge", f"group {shown(fingerprint)}", shown(into), refused, into)

    async def split(self, fingerprint: str, incident_id: str = "") -> Group | Refusal:
        """Take a group apart into those it was put together of, or one incident out of it."""
        with self.records.writing() as connection:
            if incident_id:
                refused = stories.take_apart(connection, fingerprint, incident_id)
            else:
                refused = stories.split(connection, fingerprint)
        left = stories.apart_of(incident_id) if incident_id else fingerprint
        reason = shown(incident_id) if incident_id else ""
        return self._told("split", f"group {shown(fingerprint)}", reason, refused, left)

    async def note(self, incident_id: str, text: str) -> IncidentLine | Refusal:
        """Write a note beside an incident; it replaces the one before."""
        with self.records.writing() as connection:
            known = stories.put_note(connection, incident_id, cleaned_lines(text.strip(), NOTE_MAX))
        outcome = "done" if known else "incident_unknown"
        self.diary.write("note", f"incident {shown(incident_id)}", "", outcome)
        return self.archive.incident(incident_id) or Refusal("incident_unknown", {})

    async def remove_evidence(self, incident_id: str) -> IncidentLine | Refusal:
        """Remove the folder of an incident that is over."""
        line = self.archive.incident(incident_id)
        if line is None or not bundle.is_incident_id(incident_id):
            refused: Refusal | None = Refusal("incident_unknown", {})
        else:
            refused = await asyncio.to_thread(self._removed, incident_id)
        outcome = "removed" if refused is None else refused.code
        self.diary.write("remove-evidence", f"incident {shown(incident_id)}", "", outcome)
        return refused or line or Refusal("incident_unknown", {})

    def _removed(self, incident_id: str) -> Refusal | None:
        path = self.folder / incident_id
        if not bundle.is_there(path):
            return Refusal("evidence_absent", {})
        if not bundle.is_there(path / bundle.FACTS):
            return Refusal("evidence_in_use", {})  # it is open, or its guard died: the report comes first
        return None if keeping.remove(path) else Refusal("evidence_in_use", {})

    def _told(
        self, verb: str, what: str, reason: str, refused: Refusal | None, fingerprint: str
    ) -> Group | Refusal:
        found = refused or self.archive.group(fingerprint) or Refusal("group_unknown", {})
        self.diary.write(verb, what, reason, found.code if isinstance(found, Refusal) else "done")
        return found
