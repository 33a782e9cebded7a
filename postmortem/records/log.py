"""Writes the audit log, drills, bulks and decisions, and forgets what is too old.

What is kept: incidents 400 days and 10,000; acts and changes of the state 10,000 each; drills 2,000; bulks that have ended 200; letters that are resolved a
year, and of those and the discarded ones 10,000. A letter that waits for somebody is never forgotten, however old it is,
and a discard stays to be seen as long as its rule can refuse: the guard bounds how many of them there can be.
"""

from collections.abc import Sequence
from datetime import datetime, timedelta
from typing import Any, Final

from msgspec import structs
from sqlalchemy import Connection, RowMapping, delete, func, insert, or_, select, update

from postmortem.dead_letters.slip import DrillSlip, StateSlip
from postmortem.records import stories
from postmortem.records.tables import (
    AUDIT,
    BULK_ITEMS,
    BULKS,
    DRILLS,
    INCIDENTS,
    LETTERS,
    PROPOSALS,
    STATES,
    WORDS,
)
from postmortem.views import Act, LetterState, ProposalState, Refusal

INCIDENTS_MAX: Final = 10_000
INCIDENT_DAYS: Final = 400
ACTS_MAX: Final = 10_000
STATES_MAX: Final = 10_000
DRILLS_MAX: Final = 2_000
BULKS_MAX: Final = 200
SETTLED_DAYS: Final = 365
SETTLED_MAX: Final = 10_000
#: Removed in one transaction, so that nobody waits long for it.
FORGOTTEN_AT_ONCE_MAX: Final = 500

_DECISIONS: Final[dict[tuple[ProposalState, str], ProposalState]] = {
    (ProposalState.OPEN, "accept"): ProposalState.ACCEPTED,
    (ProposalState.OPEN, "decline"): ProposalState.DECLINED,
    (ProposalState.OPEN, "done"): ProposalState.DONE,
    (ProposalState.DECLINED, "accept"): ProposalState.ACCEPTED,
    (ProposalState.DECLINED, "done"): ProposalState.DONE,
    (ProposalState.REVOKED, "accept"): ProposalState.ACCEPTED,
    (ProposalState.REVOKED, "decline"): ProposalState.DECLINED,
    (ProposalState.ACCEPTED, "revoke"): ProposalState.REVOKED,
    (ProposalState.DONE, "revoke"): ProposalState.OPEN,
}


def secret(connection: Connection, made: str) -> str:
    """The word that every form of ours carries; `made` becomes it where there is none yet."""
    found = connection.execute(select(WORDS.c.value).where(WORDS.c.name == "secret")).scalar()
    if found is None:
        connection.execute(insert(WORDS).values(name="secret", value=made))
    return made if found is None else found


def add_act(connection: Connection, act: Act) -> None:
    """Write one line of the audit log."""
    key = connection.execute(insert(AUDIT).values(**structs.asdict(act))).inserted_primary_key
    assert key is not None
    connection.execute(delete(AUDIT).where(AUDIT.c.number <= key[0] - ACTS_MAX))


def add_drill(connection: Connection, message: str, slip: DrillSlip) -> None:
    """Write one drill."""
    connection.execute(insert(DRILLS).values(id=message, **structs.asdict(slip)))
    kept = select(DRILLS.c.id).order_by(DRILLS.c.at.desc(), DRILLS.c.id.desc()).limit(DRILLS_MAX)
    connection.execute(delete(DRILLS).where(DRILLS.c.id.not_in(kept)))


def add_state(connection: Connection, slip: StateSlip) -> None:
    """Write one change of the state."""
    key = connection.execute(insert(STATES).values(**structs.asdict(slip))).inserted_primary_key
    assert key is not None
    connection.execute(delete(STATES).where(STATES.c.number <= key[0] - STATES_MAX))


def decided(
    connection: Connection, proposal_id: str, verb: str
) -> tuple[RowMapping, ProposalState] | Refusal:
    """A proposal and where a person's word would put it, or why that word does not fit."""
    row = connection.execute(select(PROPOSALS).where(PROPOSALS.c.id == proposal_id)).mappings().first()
    if row is None:
        return Refusal("proposal_unknown", {})
    state = _DECISIONS.get((ProposalState(row["state"]), verb))
    if state is None:
        return Refusal("proposal_not_so", {"state": row["state"], "verb": verb})
    if (verb == "accept") != (row["rule"] is not None) and verb in ("accept", "done"):
        return Refusal("proposal_for_a_person" if verb == "accept" else "proposal_for_a_machine", {})
    return row, state


def put_decision(connection: Connection, proposal_id: str, **columns: Any) -> None:
    """Write what was decided of a proposal."""
    connection.execute(update(PROPOSALS).where(PROPOSALS.c.id == proposal_id).values(**columns))


def unsure_decisions(connection: Connection) -> list[RowMapping]:
    """Proposals of which it is not sure that the guard enforces what they say."""
    return list(connection.execute(select(PROPOSALS).where(PROPOSALS.c.unsure)).mappings())


def find_accepted(connection: Connection, enforced: Sequence[str]) -> None:
    """Call the open ones of these proposals accepted: the guard enforces them, and who said so is forgotten."""
    meant = (PROPOSALS.c.state == ProposalState.OPEN) & ~PROPOSALS.c.unsure
    for one in enforced:
        found = update(PROPOSALS).where(PROPOSALS.c.id == one, meant)
        connection.execute(found.values(state=ProposalState.ACCEPTED, rule_id=stories.rule_id(one)))


def begin_bulk(
    connection: Connection, bulk_id: str, verb: str, who: str, letter_ids: Sequence[str], reason: str
) -> None:
    """Write down which letters are to be done, before the first of them is."""
    connection.execute(insert(BULKS).values(id=bulk_id, verb=verb, reason=reason, who=who, ended=""))
    items = [{"bulk": bulk_id, "place": place, "letter": one} for place, one in enumerate(letter_ids)]
    if items:
        connection.execute(insert(BULK_ITEMS), items)
    kept = select(BULKS.c.id).order_by(BULKS.c.id.desc()).limit(BULKS_MAX)
    connection.execute(delete(BULKS).where(BULKS.c.id.not_in(kept), BULKS.c.ended != ""))


def next_of_bulks(connection: Connection) -> tuple[RowMapping, int, str] | None:
    """The next letter of the oldest bulk that runs: its bulk, its place, its id. A bulk without one is done."""
    running = select(BULKS).where(BULKS.c.ended == "").order_by(BULKS.c.id)
    for bulk in connection.execute(running).mappings().all():
        left = BULK_ITEMS.c.bulk == bulk["id"], BULK_ITEMS.c.outcome.is_(None)
        item = connection.execute(select(BULK_ITEMS).where(*left).order_by(BULK_ITEMS.c.place)).first()
        if item is not None:
            connection.execute(update(BULKS).where(BULKS.c.id == bulk["id"]).values(current=item.letter))
            return bulk, item.place, item.letter
        end_bulk(connection, bulk["id"], "done")
    return None


def put_item(connection: Connection, bulk_id: str, place: int, outcome: str) -> None:
    """Write what became of one letter of a bulk."""
    item = BULK_ITEMS.c.bulk == bulk_id, BULK_ITEMS.c.place == place
    connection.execute(update(BULK_ITEMS).where(*item).values(outcome=outcome))


def end_bulk(connection: Connection, bulk_id: str, how: str) -> bool:
    """End a bulk that runs; what it has not begun stays in the queue. False: it does not run."""
    running = BULKS.c.id == bulk_id, BULKS.c.ended == ""
    return connection.execute(update(BULKS).where(*running).values(ended=how, current=None)).rowcount == 1


def forget_old(connection: Connection, now: datetime) -> int:
    """Remove what is too old or too much, a bounded number of rows at a time; return how many."""
    return _forget_incidents(connection, now) + _forget_letters(connection, now)


def _forget_incidents(connection: Connection, now: datetime) -> int:
    columns = INCIDENTS.c
    newest = select(columns.id).order_by(columns.opened_at.desc(), columns.id.desc()).limit(INCIDENTS_MAX)
    total = connection.execute(select(func.count()).select_from(INCIDENTS)).scalar_one()
    old = columns.opened_at < (now - timedelta(days=INCIDENT_DAYS)).isoformat()
    too_many = or_(old, columns.id.not_in(newest)) if total > INCIDENTS_MAX else old
    asked = select(columns.id).where(too_many).order_by(columns.opened_at).limit(FORGOTTEN_AT_ONCE_MAX)
    gone = list(connection.execute(asked).scalars())
    if gone:
        stories.forget(connection, gone)
    return len(gone)


def _forget_letters(connection: Connection, now: datetime) -> int:
    columns = LETTERS.c
    settled = columns.state.in_((LetterState.RESOLVED, LetterState.DISCARDED))
    newest = select(columns.id).where(settled).order_by(columns.settled_at.desc()).limit(SETTLED_MAX)
    is_past = columns.settled_at < (now - timedelta(days=SETTLED_DAYS)).isoformat()
    old = is_past & (columns.state == LetterState.RESOLVED)
    asked = select(columns.id).where(settled, or_(old, columns.id.not_in(newest)))
    gone = list(connection.execute(asked.limit(FORGOTTEN_AT_ONCE_MAX)).scalars())
    if gone:
        connection.execute(delete(LETTERS).where(columns.id.in_(gone)))
    return len(gone)
