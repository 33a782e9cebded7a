"""Writes the audit log in the name of whoever speaks: a person at the dashboard, the command line, or a program.

Who that is stands in a variable of the request's own context, which the gate sets: so no act has to be told who asked
for it, and none can say that it was somebody else.
"""

import re
from contextvars import ContextVar
from typing import Final

import msgspec

from postmortem import placing
from postmortem.records import log
from postmortem.records.opening import Records
from postmortem.views import Act

#: Who speaks; the audit log says it.
SPEAKER: Final = ContextVar("speaker", default="dashboard")

_NUMBER = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")


class Diary(msgspec.Struct, frozen=True):
    """The audit log, for those who do something."""

    records: Records

    def write(self, verb: str, what: str, reason: str, outcome: str) -> None:
        """Write one line in the name of whoever speaks."""
        with self.records.writing() as connection:
            log.add_act(connection, Act(placing.now(), SPEAKER.get(), verb, what, reason, outcome))


def shown(identity: str) -> str:
    """An id as it may stand in the log: what is none is not repeated there."""
    return identity if _NUMBER.fullmatch(identity) else "(not an id)"
