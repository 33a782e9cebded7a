"""Writes incidents, their groups and their proposals into the archive.

An incident is written as often as its folder changes and counted once: its row is what the newest reading said. A group's
numbers are counted here, over its incidents, so that no page counts. `back`: an incident of a group that a person had
called fixed before it; the group and the incident both carry the mark.
"""

import json
from collections.abc import Mapping, Sequence
from statistics import median
from typing import Any, Final

import msgspec
from sqlalchemy import Connection, delete, func, insert, select, update

from postmortem import placing
from postmortem.records.tables import GROUPS, INCIDENT_ACCOUNTS, INCIDENTS, MERGES, PROPOSALS
from postmortem.views import IncidentLine, ProposalState, Refusal, Standing, Texts

ACCOUNTS_MAX: Final = 64
#: Incidents of a group that its median and its accounts are taken from, the newest ones.
COUNTED_MAX: Final = 1_000
WHY_MAX: Final = 32
PROPOSALS_MAX: Final = 16
#: Groups that people put into others.
MERGES_MAX: Final = 1_000
MANY: Final = 2
PROPOSAL_RULE: Final = "proposal-"
_COUNTED: Final = ("id", "opened_at", "outage_ms", "account_ids", "diagnosis", "summary")


class Proposed(msgspec.Struct, frozen=True):
    """A proposal as an incident's report makes it."""

    kind: str
    text: Texts
    rule: Mapping[str, Any] | None
    tested: str | None


class Story(msgspec.Struct, frozen=True):
    """One incident as its folder says it now. `title`, `why`: what its group is called, and what it is made of."""

    line: IncidentLine
    title: Texts
    why: tuple[str, ...]
    proposals: tuple[Proposed, ...]


def marks(connection: Connection) -> dict[str, str]:
    """What each incident's folder looked like when it was read last, by the incident's id."""
    return {row.id: row.mark for row in connection.execute(select(INCIDENTS.c.id, INCIDENTS.c.mark))}


def put(connection: Connection, story: Story, mark: str) -> bool:
    """Write an incident, read from a folder that looked like `mark`; False: it stands there just so."""
    digest = placing.digest(repr(story).encode())
    columns = INCIDENTS.c
    before = connection.execute(
        select(columns.digest, columns.fingerprint, columns.apart).where(columns.id == story.line.id)
    ).first()
    if before is not None and before.digest == digest:
        connection.execute(update(INCIDENTS).where(columns.id == story.line.id).values(mark=mark))
        return False
    base = apart_of(story.line.id) if before is not None and before.apart else story.line.fingerprint
    group = _group_of(connection, base)
    told = {**_row(story.line), "fingerprint": group, "base": base, "digest": digest, "mark": mark}
    if before is None:
        connection.execute(insert(INCIDENTS).values(**told, back=False))
    else:
        connection.execute(update(INCIDENTS).where(columns.id == story.line.id).values(**told))
    _put_accounts(connection, story.line)
    _put_proposals(connection, story)
    moved = before is None or before.fingerprint != group
    _count(connection, group, story if moved else None, story)
    if before is not None and moved:
        _count(connection, before.fingerprint, None, None)
    return True


def mark_fixed(connection: Connection, fingerprint: str, version: str, at: str) -> bool:
    """Note a person's word that a group is fixed; False: there is no such group."""
    fixed = update(GROUPS).where(GROUPS.c.fingerprint == fingerprint)
    done = connection.execute(fixed.values(standing=Standing.FIXED, fixed_in=version, fixed_at=at))
    return done.rowcount == 1


def apart_of(incident_id: str) -> str:
    """The group of an incident that a person took out of its own."""
    return f"apart-{incident_id}"


def _group_of(connection: Connection, base: str) -> str:
    into = connection.execute(select(MERGES.c.into).where(MERGES.c.fingerprint == base)).scalar()
    return base if into is None else str(into)


def merge(connection: Connection, fingerprint: str, into: str) -> Refusal | None:
    """Put a group into another one, with what was put into it before, and its later deaths."""
    known = GROUPS.c.fingerprint.in_((fingerprint, into))
    count = connection.execute(select(func.count()).select_from(GROUPS).where(known)).scalar_one()
    if count != len({fingerprint, into}):
        return Refusal("group_unknown", {})
    if fingerprint == into:
        return Refusal("group_itself", {})
    if connection.execute(select(func.count()).select_from(MERGES)).scalar_one() >= MERGES_MAX:
        return Refusal("merges_too_many", {"max": MERGES_MAX})
    connection.execute(update(MERGES).where(MERGES.c.into == fingerprint).values(into=into))
    connection.execute(delete(MERGES).where(MERGES.c.fingerprint == fingerprint))
    connection.execute(insert(MERGES).values(fingerprint=fingerprint, into=into))
    of_it = INCIDENTS.c.fingerprint == fingerprint
    connection.execute(update(INCIDENTS).where(of_it).values(fingerprint=into))
    for one in (into, fingerprint):
        _count(connection, one, None, None)
    return None


def split(connection: Connection, fingerprint: str) -> Refusal | None:
    """Take a group apart into those that it was put together of."""
    merged = (
        connection.execute(select(MERGES.c.fingerprint).where(MERGES.c.into == fingerprint)).scalars().all()
    )
    if not merged:
        known = connection.execute(select(GROUPS.c.count).where(GROUPS.c.fingerprint == fingerprint)).first()
        return Refusal("group_unknown" if known is None else "group_whole", {})
    connection.execute(delete(MERGES).where(MERGES.c.into == fingerprint))
    for one in merged:
        of_it = (INCIDENTS.c.fingerprint == fingerprint) & (INCIDENTS.c.base == one)
        # Read once more, they name the group again as their reports do.
        connection.execute(update(INCIDENTS).where(of_it).values(fingerprint=one, mark="", digest=""))
        _count(connection, one, None, None)
    _count(connection, fingerprint, None, None)
    return None


def take_apart(connection: Connection, fingerprint: str, incident_id: str) -> Refusal | None:
    """Take one incident out of a group of several; it is a group of its own from then on."""
    of_it = INCIDENTS.c.fingerprint == fingerprint
    ids = connection.execute(select(INCIDENTS.c.id).where(of_it, INCIDENTS.c.id == incident_id)).all()
    if not ids:
        return Refusal("incident_unknown", {})
    if connection.execute(select(func.count()).select_from(INCIDENTS).where(of_it)).scalar_one() < MANY:
        return Refusal("group_whole", {})
    own = apart_of(incident_id)
    told = {"fingerprint": own, "base": own, "apart": True, "mark": "", "digest": ""}
    connection.execute(delete(MERGES).where(MERGES.c.fingerprint == own))
    connection.execute(update(INCIDENTS).where(INCIDENTS.c.id == incident_id).values(**told))
    for one in (own, fingerprint):
        _count(connection, one, None, None)
    return None


def put_note(connection: Connection, incident_id: str, text: str) -> bool:
    """Write a person's note beside an incident; False: there is no such incident."""
    noted = update(INCIDENTS).where(INCIDENTS.c.id == incident_id).values(note=text)
    return connection.execute(noted).rowcount == 1


def forget(connection: Connection, incident_ids: Sequence[str]) -> None:
    """Remove incidents that are too old to be kept; a proposal stays as long as it is, or may be, enforced."""
    gone = INCIDENTS.c.id.in_(incident_ids)
    fingerprints = connection.execute(select(INCIDENTS.c.fingerprint).where(gone).distinct()).scalars().all()
    connection.execute(delete(INCIDENTS).where(gone))
    connection.execute(
        delete(PROPOSALS).where(
            PROPOSALS.c.incident.in_(incident_ids),
            PROPOSALS.c.state != ProposalState.ACCEPTED,
            ~PROPOSALS.c.unsure,
        )
    )
    for fingerprint in fingerprints:
        _count(connection, fingerprint, None, None)


def _row(line: IncidentLine) -> dict[str, Any]:
    return {
        "id": line.id,
        "opened_at": line.opened_at,
        "closed_at": line.closed_at,
        "diagnosis": line.diagnosis,
        "grade": line.grade,
        "summary": _json(dict(line.summary)),
        "outcome": line.outcome,
        "outage_ms": line.outage_ms,
        "detected_ms": line.detected_ms,
        "fingerprint": line.fingerprint,
        "account_ids": _json(line.account_ids[:ACCOUNTS_MAX]),
        "planned": line.planned,
        "drill": line.drill,
    }


def _put_accounts(connection: Connection, line: IncidentLine) -> None:
    connection.execute(delete(INCIDENT_ACCOUNTS).where(INCIDENT_ACCOUNTS.c.incident == line.id))
    accounts = dict.fromkeys(line.account_ids[:ACCOUNTS_MAX])
    if accounts:
        named = [{"account": account, "incident": line.id} for account in accounts]
        connection.execute(insert(INCIDENT_ACCOUNTS), named)


def _put_proposals(connection: Connection, story: Story) -> None:
    """Make the proposals of a report what the archive says of its incident; what a person decided stays."""
    line = story.line
    named = {proposal_id(line.id, one): one for one in story.proposals[:PROPOSALS_MAX]}
    of_it = PROPOSALS.c.incident == line.id
    is_open = (PROPOSALS.c.state == ProposalState.OPEN) & ~PROPOSALS.c.unsure
    withdrawn = of_it & is_open & PROPOSALS.c.id.not_in(named)
    connection.execute(delete(PROPOSALS).where(withdrawn))
    known = set(connection.execute(select(PROPOSALS.c.id).where(of_it)).scalars())
    for identity, one in named.items():
        told = {"text": _json(dict(one.text)), "tested": one.tested}
        if identity in known:
            connection.execute(update(PROPOSALS).where(PROPOSALS.c.id == identity).values(**told))
            continue
        connection.execute(
            insert(PROPOSALS).values(
                id=identity,
                incident=line.id,
                kind=one.kind,
                state=ProposalState.OPEN,
                rule=_json(dict(one.rule)) if one.rule is not None else None,
                owner="",
                note="",
                made_at=line.opened_at,
                **told,
            )
        )


def proposal_id(incident: str, one: Proposed) -> str:
    """The id of a proposal: the same one whenever its report is read."""
    said = _json([incident, one.kind, one.rule, one.rule is None and one.text.get("en", "")])
    return placing.digest(said.encode())[:32]


def rule_id(proposal: str) -> str:
    """The id under which the guard enforces a proposal: the same one however often it is asked for."""
    return f"{PROPOSAL_RULE}{proposal}"


def _count(connection: Connection, fingerprint: str, arrived: Story | None, told: Story | None) -> None:
    """Count a group anew. `arrived`: an incident that was not of it before; `told`: who names the group now."""
    group = connection.execute(select(GROUPS).where(GROUPS.c.fingerprint == fingerprint)).mappings().first()
    of_it = INCIDENTS.c.fingerprint == fingerprint
    asked = select(func.count(), func.min(INCIDENTS.c.opened_at)).where(of_it)
    count, first_at = connection.execute(asked).one()
    if count == 0:
        connection.execute(delete(GROUPS).where(GROUPS.c.fingerprint == fingerprint))
        return
    newest_first = (
        select(*(INCIDENTS.c[name] for name in _COUNTED))
        .where(of_it)
        .order_by(INCIDENTS.c.opened_at.desc(), INCIDENTS.c.id.desc())
    )
    newest = connection.execute(newest_first.limit(COUNTED_MAX)).all()
    outages = [one.outage_ms for one in newest if one.outage_ms is not None]
    accounts = dict.fromkeys(account for one in newest for account in json.loads(one.account_ids))
    standing = Standing(group["standing"]) if group is not None else Standing.NEW
    if arrived is not None and group is not None:
        standing = _standing_after(connection, standing, group["fixed_at"], arrived.line)
    if standing is Standing.NEW and count > 1:
        standing = Standing.KNOWN
    counted = {
        "standing": standing,
        "count": count,
        "first_at": first_at,
        "last_at": newest[0].opened_at,
        "median_outage_ms": median(outages) if outages else None,
        "account_ids": _json(list(accounts)[:ACCOUNTS_MAX]),
        "newest": newest[0].id,
    }
    if told is not None and newest[0].id == told.line.id:
        counted |= {"diagnosis": told.line.diagnosis, "title": _json(dict(told.title))}
        counted |= {"why": _json(told.why[:WHY_MAX])}
    if group is not None:
        connection.execute(update(GROUPS).where(GROUPS.c.fingerprint == fingerprint).values(**counted))
        return
    if told is None:  # a person made it, out of incidents that are known
        named = {"diagnosis": newest[0].diagnosis, "title": newest[0].summary, "why": _json(())}
    else:
        named = {
            "diagnosis": told.line.diagnosis,
            "title": _json(dict(told.title)),
            "why": _json(told.why[:WHY_MAX]),
        }
    connection.execute(insert(GROUPS).values(fingerprint=fingerprint, **(named | counted)))


def _standing_after(
    connection: Connection, standing: Standing, fixed_at: str | None, line: IncidentLine
) -> Standing:
    """Where a group stands after one more of its kind: an older story that is read late breaks no promise."""
    if standing is not Standing.FIXED or fixed_at is None or line.opened_at <= fixed_at or line.planned:
        return standing
    connection.execute(update(INCIDENTS).where(INCIDENTS.c.id == line.id).values(back=True))
    return Standing.BACK


def _json(value: object) -> str:
    return json.dumps(value, sort_keys=True)
