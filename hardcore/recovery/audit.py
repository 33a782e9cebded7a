"""What the serving core said of the whole ledger, and which incident wants to know it.

The proof that lets a core serve covers the ledger's last events; the proof of all of it takes as long as the
ledger is old and runs behind the serving. Its word usually comes when the incident that made this core
necessary is closed, so the incident is remembered here and its facts are completed later. A ledger that is not
whole ends nobody: the core serves the same bytes after a restart, so it is a worry for a person to read.
"""

import msgspec

from hardcore.model.actions import Action, AddAudit
from hardcore.model.observations import LedgerAudited
from hardcore.recovery.story import Story


class Audit(msgspec.Struct):
    """Remembers the word of the present core. `heard` is None until it has come."""

    heard: LedgerAudited | None = None
    _incident: str | None = None

    def begin(self, incident: str | None) -> None:
        """Another core serves from now on; `incident` is the one it was started for."""
        self.heard, self._incident = None, incident

    def take(self, fact: LedgerAudited, story: Story | None) -> tuple[Action, ...]:
        """Take in the serving core's word; return what is to be done about it. `story`: the open incident."""
        self.heard = fact
        if story is not None and story.id == self._incident:
            story.audit = fact
            return ()
        return (AddAudit(self._incident, fact),) if self._incident is not None else ()

    @property
    def worries(self) -> bool:
        """Whether the ledger is known not to be whole."""
        return self.heard is not None and not self.heard.ok
