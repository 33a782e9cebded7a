"""What the investigators' pages, the command line and the archive say to each other, as values.

`records` (the archive, the only room that opens `hardcore.db`) fills these; the pages and the printers read nothing
else. A page that asked the database for what it shows was not chosen: the same list is shown on a page, in a terminal
and as JSON, and has to be the same list. Times are RFC 3339 texts in UTC.
"""

from collections.abc import Mapping, Sequence
from enum import StrEnum
from typing import Any, Protocol

import msgspec

Texts = Mapping[str, str]  # by language: ko, en


class Standing(StrEnum):
    """What is known of a group of equal deaths."""

    NEW = "new"
    KNOWN = "known"
    FIXED = "fixed"  # a person said so
    BACK = "back"  # it came again after that


class LetterState(StrEnum):
    """Where a dead letter is; `dead_letters/life.py` lists every way from one to the next."""

    QUARANTINED = "QUARANTINED"
    HELD = "HELD"
    RETRYING = "RETRYING"
    RESOLVED = "RESOLVED"
    DISCARDED = "DISCARDED"


class ProposalState(StrEnum):
    """Where a proposal is."""

    OPEN = "open"
    ACCEPTED = "accepted"  # enforced, and counted
    DECLINED = "declined"
    DONE = "done"  # a person did what no machine can
    REVOKED = "revoked"


class IncidentLine(msgspec.Struct, frozen=True):
    """One incident in a list."""

    id: str
    opened_at: str
    closed_at: str | None
    diagnosis: str
    grade: str
    summary: Texts
    outcome: str
    outage_ms: float | None
    detected_ms: float | None
    fingerprint: str
    account_ids: tuple[str, ...]
    planned: bool
    drill: str | None
    note: str = ""  # a person's


class Group(msgspec.Struct, frozen=True):
    """Equal deaths. `why`: what they have in common, as facts; `merged`: the fingerprints that a person put into it."""

    fingerprint: str
    title: Texts
    diagnosis: str
    standing: Standing
    count: int
    first_at: str
    last_at: str
    median_outage_ms: float | None
    account_ids: tuple[str, ...]
    fixed_in: str | None
    why: tuple[str, ...]
    newest: str  # the id of its last incident
    merged: tuple[str, ...] = ()


class Attempt(msgspec.Struct, frozen=True):
    """One death or retry of a letter's request."""

    at: str
    what: str  # "death" | "trial" | "dry-run" | "retry"
    outcome: str
    incident: str | None
    detail: str


class DryRun(msgspec.Struct, frozen=True):
    """What a letter's request did in a throw-away core. `ordeal` is the wire's word."""

    at: str
    ordeal: str
    status: int | None
    took_ms: int
    answer: Any
    why: str


class Letter(msgspec.Struct, frozen=True):
    """One dead letter. `sum_text`: the amounts it moves, one text for each currency, empty if it moves none."""

    id: str
    state: LetterState
    reason: str
    name: str
    command_id: str
    idempotency_key: str | None
    kind: str
    source: str
    account_ids: tuple[str, ...]
    transaction_id: str
    fingerprint: str | None
    incident_ids: tuple[str, ...]
    deaths: int
    attempts: tuple[Attempt, ...]
    quarantined_at: str
    method: str
    path: str
    payload: Any  # decoded JSON, or the text, or None where nobody has it
    row: Mapping[str, Any] | None
    seq: int | None
    dry_run: DryRun | None
    note: str
    discarded_because: str | None
    sums: tuple[str, ...] = ()
    corrected_by: str = ""  # the key of the request that a person sent instead


class Filter(msgspec.Struct, frozen=True):
    """What a list is narrowed to; an empty field narrows nothing. `since`, `until`: RFC 3339."""

    state: str = ""
    reason: str = ""
    diagnosis: str = ""
    outcome: str = ""
    account: str = ""
    fingerprint: str = ""
    since: str = ""
    until: str = ""
    drills: bool = True


class Page(msgspec.Struct, frozen=True):
    """A piece of a list, newest first; `more`: the cursor of the next piece."""

    items: tuple[Any, ...]
    total: int
    more: str | None


class Proposal(msgspec.Struct, frozen=True):
    """Something that would have prevented an incident. `rule`: the wire's object, for those a machine enforces."""

    id: str
    incident: str
    kind: str  # "fingerprint" | "limit" | "deadline" | "person"
    text: Texts
    state: ProposalState
    rule: Mapping[str, Any] | None
    tested: str | None  # what its dry run said, in one English sentence
    hits: int
    last_hit_at: str | None
    owner: str
    note: str


class Bulk(msgspec.Struct, frozen=True):
    """Many letters at once, one at a time. `ended`: "done", "cancelled", "stopped" (the service went down), "" while it runs."""

    id: str
    verb: str
    total: int
    done: int
    failed: int
    ended: str
    current: str | None


class Act(msgspec.Struct, frozen=True):
    """One line of the audit log."""

    at: str
    who: str
    verb: str
    what: str
    reason: str
    outcome: str


class Refusal(msgspec.Struct, frozen=True):
    """Something asked of a letter, a proposal or a group can't be done. `code` has its sentence in the catalogue."""

    code: str
    values: Mapping[str, Any]


class Drill(msgspec.Struct, frozen=True):
    """One drill that was run."""

    at: str
    fault: str
    ok: bool
    outage_ms: float | None
    incident: str | None
    scheduled: bool


class Reads(Protocol):
    """What may be asked of the archive. Every call answers from the database alone, in bounded time."""

    def incidents(self, wanted: Filter, limit: int, cursor: str = "") -> Page:
        """Incidents, newest first."""
        ...

    def groups(self, wanted: Filter, limit: int, cursor: str = "") -> Page:
        """Groups of equal deaths; the filter's `state` is a standing."""
        ...

    def group(self, fingerprint: str) -> Group | None:
        """One group, or None."""
        ...

    def incident(self, incident_id: str) -> IncidentLine | None:
        """One incident, or None."""
        ...

    def proposals(self, incident_id: str = "") -> Sequence[Proposal]:
        """The proposals of one incident, or the newest of all."""
        ...

    def letters(self, wanted: Filter, limit: int, cursor: str = "") -> Page:
        """Letters, newest first, each with the newest of its attempts."""
        ...

    def letter(self, letter_id: str) -> Letter | None:
        """One letter by any of its numbers, or None."""
        ...

    def counts(self) -> Mapping[str, int]:
        """Letters that wait, by their reasons."""
        ...

    def bulk(self, bulk_id: str) -> Bulk | None:
        """How far a bulk is, or None."""
        ...

    def audit(self, limit: int, cursor: str = "") -> Page:
        """The audit log, newest first."""
        ...

    def drills(self, limit: int) -> Sequence[Drill]:
        """The newest drills."""
        ...

    def trends(self, weeks: int) -> Mapping[str, Any]:
        """Numbers of the last `weeks` weeks; `records.reads.trends_of` says which."""
        ...


class IncidentActs(Protocol):
    """What may be done with incidents and their groups, with a line in the audit log as all `Acts`."""

    async def merge(self, fingerprint: str, into: str) -> Group | Refusal:
        """Put a group into another one, its later deaths too; what is then the group."""
        ...

    async def split(self, fingerprint: str, incident_id: str = "") -> Group | Refusal:
        """Take a group apart into those it was put together of, or one incident out of it; what is left, or the new one."""
        ...

    async def note(self, incident_id: str, text: str) -> IncidentLine | Refusal:
        """Write a note beside an incident; it replaces the one before."""
        ...

    async def remove_evidence(self, incident_id: str) -> IncidentLine | Refusal:
        """Remove the folder of an incident that is over; its line, its group and its proposals stay."""
        ...


class Acts(Protocol):
    """What may be done. Each writes a line of the audit log, and answers with what is now or why not."""

    @property
    def incidents(self) -> IncidentActs:
        """What may be done with incidents and their groups."""
        ...

    async def dry_run(self, letter_id: str) -> Letter | Refusal:
        """Try it in a throw-away core; the letter has what that said."""
        ...

    async def retry(self, letter_id: str, *, anyway: bool = False) -> Letter | Refusal:
        """Run it under its own key; `anyway`: without a dry run that survived."""
        ...

    async def requeue(self, letter_id: str) -> Letter | Refusal:
        """Try and run it after those that wait already."""
        ...

    async def hold(self, letter_id: str) -> Letter | Refusal:
        """Leave it out of every bulk until somebody decides."""
        ...

    async def discard(self, letter_id: str, reason: str) -> Letter | Refusal:
        """Mark it as not to be run; `reason` must not be empty."""
        ...

    async def undo_discard(self, letter_id: str) -> Letter | Refusal:
        """Take a discard back within its time."""
        ...

    async def correct(self, letter_id: str, body: str) -> Letter | Refusal:
        """Send the changed contents, JSON, as a new request under a key of its own; this one is discarded with the link."""
        ...

    async def bulk(self, verb: str, wanted: Filter | Sequence[str], reason: str = "") -> Bulk | Refusal:
        """Do one of `bulks.VERBS` to many, one at a time."""
        ...

    async def cancel_bulk(self, bulk_id: str) -> Bulk | Refusal:
        """End a bulk; what it has not begun stays where it is."""
        ...

    async def decide(self, proposal_id: str, verb: str, owner: str, note: str) -> Proposal | Refusal:
        """`verb`: accept, decline, done, revoke."""
        ...

    async def mark_fixed(self, fingerprint: str, version: str) -> Group | Refusal:
        """Call a group fixed in `version`; another death of it is then `back`."""
        ...

    async def note(self, letter_id: str, text: str) -> Letter | Refusal:
        """Write a note beside a letter; it replaces the one before."""
        ...
