"""Reads the archive: every list and every detail, by its own index, in bounded time.

A list's cursor is the place of its last line (`at|id`), so that what arrives meanwhile neither repeats nor skips one.
Pages of an offset were not chosen: the tenth would read the nine before it.
"""

import json
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from statistics import median
from typing import Any, Final

from msgspec import structs
from sqlalchemy import Column, ColumnElement, Connection, RowMapping, Select, Table, func, select, tuple_

from postmortem.records import rows
from postmortem.records.opening import Records
from postmortem.records.tables import (
    ALIASES,
    ATTEMPTS,
    AUDIT,
    BULK_ITEMS,
    BULKS,
    DRILLS,
    GROUPS,
    INCIDENT_ACCOUNTS,
    INCIDENTS,
    LETTER_ACCOUNTS,
    LETTERS,
    MERGES,
    PROPOSALS,
)
from postmortem.views import Bulk, Drill, Filter, Group, IncidentLine, Letter, LetterState, Page, Proposal

#: One piece of a list.
PAGE_MAX: Final = 500
#: What one detail shows of what may be many.
ATTEMPTS_MAX: Final = 200
PROPOSALS_MAX: Final = 500
#: Attempts of all letters of one page.
LISTED_MAX: Final = 5_000
WEEKS_MAX: Final = 60
#: Letters that wait for somebody.
WAITING: Final = (LetterState.QUARANTINED, LetterState.HELD, LetterState.RETRYING)
_HITS_BYTES_MAX: Final = 1 << 20
#: What is on record of less than this says nothing of how long it lasts between two incidents.
_COUNTED_MIN: Final = timedelta(days=1)


class Archive:
    """What may be asked of the archive (`views.Reads`). `hits`: the gateway's count of what each rule refused."""

    def __init__(self, records: Records, hits: Path) -> None:
        self._records = records
        self._hits = hits

    def incidents(self, wanted: Filter, limit: int, cursor: str = "") -> Page:
        """Incidents, newest first."""
        where = [
            *_equal(INCIDENTS, wanted, "diagnosis", "outcome", "fingerprint"),
            *_between(INCIDENTS.c.opened_at, wanted),
        ]
        if wanted.account:
            named = select(INCIDENT_ACCOUNTS.c.incident).where(INCIDENT_ACCOUNTS.c.account == wanted.account)
            where.append(INCIDENTS.c.id.in_(named))
        if not wanted.drills:
            where.append(INCIDENTS.c.drill.is_(None))
        with self._records.reading() as connection:
            return _page(
                connection,
                INCIDENTS,
                (INCIDENTS.c.opened_at, INCIDENTS.c.id),
                where,
                limit,
                cursor,
                rows.incident,
            )

    def groups(self, wanted: Filter, limit: int, cursor: str = "") -> Page:
        """Groups of equal deaths, the one with the newest death first. `state` of the filter is a standing."""
        where = [*_equal(GROUPS, wanted, "diagnosis", "fingerprint"), *_between(GROUPS.c.last_at, wanted)]
        if wanted.state:
            where.append(GROUPS.c.standing == wanted.state)
        of_incidents = [*_equal(INCIDENTS, wanted, "outcome")]
        if wanted.account:
            named = select(INCIDENT_ACCOUNTS.c.incident).where(INCIDENT_ACCOUNTS.c.account == wanted.account)
            of_incidents.append(INCIDENTS.c.id.in_(named))
        if not wanted.drills:
            of_incidents.append(INCIDENTS.c.drill.is_(None))
        if of_incidents:
            where.append(GROUPS.c.fingerprint.in_(select(INCIDENTS.c.fingerprint).where(*of_incidents)))
        with self._records.reading() as connection:
            order = GROUPS.c.last_at, GROUPS.c.fingerprint
            page = _page(connection, GROUPS, order, where, limit, cursor, lambda row: row)
            merged = _merged(connection, [row["fingerprint"] for row in page.items])
        items = tuple(rows.group(row, merged.get(row["fingerprint"], ())) for row in page.items)
        return structs.replace(page, items=items)

    def group(self, fingerprint: str) -> Group | None:
        """One group, or None."""
        with self._records.reading() as connection:
            asked = select(GROUPS).where(GROUPS.c.fingerprint == fingerprint)
            row = connection.execute(asked).mappings().first()
            merged = _merged(connection, [fingerprint])
        return None if row is None else rows.group(row, merged.get(fingerprint, ()))

    def incident(self, incident_id: str) -> IncidentLine | None:
        """One incident, or None."""
        row = self._one(select(INCIDENTS).where(INCIDENTS.c.id == incident_id))
        return None if row is None else rows.incident(row)

    def proposals(self, incident_id: str = "") -> Sequence[Proposal]:
        """The proposals of one incident, or the newest of all."""
        asked = select(PROPOSALS).order_by(PROPOSALS.c.made_at.desc(), PROPOSALS.c.id).limit(PROPOSALS_MAX)
        if incident_id:
            asked = asked.where(PROPOSALS.c.incident == incident_id)
        hits = self._read_hits()
        with self._records.reading() as connection:
            found = connection.execute(asked).mappings().all()
        return [rows.proposal(row, *hits.get(row["rule_id"], (0, None))) for row in found]

    def letters(self, wanted: Filter, limit: int, cursor: str = "") -> Page:
        """Letters, newest first, each with the newest of what became of it."""
        where = letters_where(wanted)
        order = LETTERS.c.quarantined_at, LETTERS.c.id
        with self._records.reading() as connection:
            page = _page(connection, LETTERS, order, where, limit, cursor, lambda row: row)
            of_them = ATTEMPTS.c.letter.in_([row["id"] for row in page.items])
            asked = select(ATTEMPTS).where(of_them).order_by(ATTEMPTS.c.number.desc()).limit(LISTED_MAX)
            attempts: dict[str, list[RowMapping]] = {}
            for one in connection.execute(asked).mappings():
                attempts.setdefault(one["letter"], []).insert(0, one)
        items = tuple(rows.letter(row, attempts.get(row["id"], ())) for row in page.items)
        return structs.replace(page, items=items)

    def letter(self, letter_id: str) -> Letter | None:
        """One letter with all that became of it, by any of its numbers, or None."""
        with self._records.reading() as connection:
            row = letter_row(connection, letter_id)
            if row is None:
                return None
            attempts = (
                select(ATTEMPTS).where(ATTEMPTS.c.letter == row["id"]).order_by(ATTEMPTS.c.number.desc())
            )
            newest = connection.execute(attempts.limit(ATTEMPTS_MAX)).mappings().all()
        return rows.letter(row, newest[::-1])

    def counts(self) -> Mapping[str, int]:
        """How many letters wait, by their reasons."""
        asked = (
            select(LETTERS.c.reason, func.count())
            .where(LETTERS.c.state.in_(WAITING))
            .group_by(LETTERS.c.reason)
        )
        with self._records.reading() as connection:
            return {row[0]: row[1] for row in connection.execute(asked)}

    def bulk(self, bulk_id: str) -> Bulk | None:
        """How far many letters are, or None."""
        with self._records.reading() as connection:
            row = connection.execute(select(BULKS).where(BULKS.c.id == bulk_id)).mappings().first()
            if row is None:
                return None
            items = select(BULK_ITEMS.c.outcome).where(BULK_ITEMS.c.bulk == bulk_id)
            return rows.bulk(row, connection.execute(items).scalars().all())

    def audit(self, limit: int, cursor: str = "") -> Page:
        """The audit log, newest first."""
        limit = min(max(limit, 1), PAGE_MAX)
        asked = select(AUDIT).order_by(AUDIT.c.number.desc()).limit(limit + 1)
        if cursor.isascii() and cursor.isdecimal():
            asked = asked.where(AUDIT.c.number < int(cursor[:18]))
        with self._records.reading() as connection:
            found = connection.execute(asked).mappings().all()
            total = connection.execute(select(func.count()).select_from(AUDIT)).scalar_one()
        more = str(found[limit - 1]["number"]) if len(found) > limit else None
        return Page(tuple(map(rows.act, found[:limit])), total, more)

    def drills(self, limit: int) -> Sequence[Drill]:
        """The newest drills."""
        asked = select(DRILLS).order_by(DRILLS.c.at.desc(), DRILLS.c.id.desc()).limit(min(limit, PAGE_MAX))
        with self._records.reading() as connection:
            return [rows.drill(row) for row in connection.execute(asked).mappings()]

    def trends(self, weeks: int) -> Mapping[str, Any]:
        """Incidents a week, and how long they lasted by cause, over the last `weeks` weeks."""
        weeks = min(max(weeks, 1), WEEKS_MAX)
        since = datetime.now(UTC) - timedelta(weeks=weeks)
        asked = select(INCIDENTS.c.opened_at, INCIDENTS.c.diagnosis, INCIDENTS.c.outage_ms).where(
            INCIDENTS.c.opened_at >= since.isoformat(),
            INCIDENTS.c.planned.is_(False),
            INCIDENTS.c.drill.is_(None),
        )
        with self._records.reading() as connection:
            # Not `row.tuple()`: it warns, ten thousand times a page, that it will go.
            found = [(row[0], row[1], row[2]) for row in connection.execute(asked)]
            first = connection.execute(select(func.min(INCIDENTS.c.opened_at))).scalar_one()
        return trends_of(found, weeks, since, first)

    def _one(self, asked: Select[Any]) -> RowMapping | None:
        with self._records.reading() as connection:
            return connection.execute(asked).mappings().first()

    def _read_hits(self) -> Mapping[str, tuple[int, str | None]]:
        try:
            with self._hits.open("rb") as file:
                told = json.loads(file.read(_HITS_BYTES_MAX))
        except (OSError, ValueError, RecursionError):
            return {}
        hits = told.get("hits") if isinstance(told, dict) else None
        return {rule: _hit(hit) for rule, hit in (hits if isinstance(hits, dict) else {}).items()}


def _hit(told: object) -> tuple[int, str | None]:
    count, at = (told.get("count"), told.get("last_at")) if isinstance(told, dict) else (0, None)
    return count if isinstance(count, int) else 0, at if isinstance(at, str) else None


def _merged(connection: Connection, groups: Sequence[str]) -> Mapping[str, list[str]]:
    """What people put into some groups, by the group."""
    asked = select(MERGES).where(MERGES.c.into.in_(groups)).order_by(MERGES.c.fingerprint)
    found: dict[str, list[str]] = {}
    for row in connection.execute(asked).mappings():
        found.setdefault(row["into"], []).append(row["fingerprint"])
    return found


def letter_row(connection: Connection, letter_id: str) -> RowMapping | None:
    """The row of a letter by any of its numbers, or None."""
    named = select(ALIASES.c.letter).where(ALIASES.c.id == letter_id).scalar_subquery()
    return connection.execute(select(LETTERS).where(LETTERS.c.id == named)).mappings().first()


def letters_where(wanted: Filter) -> list[ColumnElement[bool]]:
    """What a filter says of letters."""
    where = [
        *_equal(LETTERS, wanted, "state", "reason", "fingerprint"),
        *_between(LETTERS.c.quarantined_at, wanted),
    ]
    if wanted.account:
        named = select(LETTER_ACCOUNTS.c.letter).where(LETTER_ACCOUNTS.c.account == wanted.account)
        where.append(LETTERS.c.id.in_(named))
    return where


def trends_of(
    found: Sequence[tuple[str, str, float | None]], weeks: int, since: datetime, first: str | None
) -> Mapping[str, Any]:
    """The trends of some incidents: (opened at, diagnosis, outage). An incident without a time is in no week.

    `first`: when the first one ever on record was opened; before that nobody counted.
    """
    begins = [(since + timedelta(weeks=week)).isoformat() for week in range(weeks + 1)]
    counts = [0] * (weeks + 2)
    by_cause: dict[str, list[float]] = {}
    for opened_at, diagnosis, outage_ms in found:
        # Texts of one form sort as the times they say; parsing ten thousand of them takes a tenth of a second.
        counts[bisect_right(begins, opened_at)] += 1
        if outage_ms is not None:
            by_cause.setdefault(diagnosis, []).append(outage_ms)
    return {
        "weeks": [
            {"from": begin[:10], "incidents": count}
            for begin, count in zip(begins, counts[1 : weeks + 1], strict=False)
        ],
        "incidents": len(found),
        "mtbf_hours": _apart_hours(len(found), since, since + timedelta(weeks=weeks), first),
        "causes": [
            {
                "diagnosis": diagnosis,
                "count": len(outages),
                "p50_ms": median(outages),
                "p90_ms": _p90(outages),
            }
            for diagnosis, outages in sorted(by_cause.items(), key=lambda item: -len(item[1]))
        ],
    }


def _apart_hours(count: int, since: datetime, now: datetime, first: str | None) -> float | None:
    """Hours between two incidents, over as much of the time as is on record; None: too little of it is."""
    if count < 2 or first is None:
        return None
    try:
        counted = now - max(since, datetime.fromisoformat(first))
    except (ValueError, TypeError):  # not a time, or one without a zone: somebody wrote into the records
        return None
    return round(counted / timedelta(hours=1) / count, 1) if counted >= _COUNTED_MIN else None


def _p90(outages: Sequence[float]) -> float:
    return sorted(outages)[min(len(outages) - 1, len(outages) * 9 // 10)]


def _equal(table: Table, wanted: Filter, *names: str) -> list[ColumnElement[bool]]:
    return [table.c[name] == value for name in names if (value := getattr(wanted, name))]


def _between(at: Column[Any], wanted: Filter) -> list[ColumnElement[bool]]:
    where: list[ColumnElement[bool]] = []
    if wanted.since:
        where.append(at >= wanted.since)
    if wanted.until:
        where.append(at <= wanted.until)
    return where


def _page(
    connection: Connection,
    table: Table,
    order: tuple[Column[Any], Column[Any]],
    where: Sequence[ColumnElement[bool]],
    limit: int,
    cursor: str,
    read: Any,
) -> Page:
    limit = min(max(limit, 1), PAGE_MAX)
    total = connection.execute(select(func.count()).select_from(table).where(*where)).scalar_one()
    asked = select(table).where(*where).order_by(*(column.desc() for column in order)).limit(limit + 1)
    at, bar, identity = cursor.partition("|")
    if bar:
        asked = asked.where(tuple_(*order) < tuple_(at, identity))
    found = connection.execute(asked).mappings().all()
    more = "|".join(str(found[limit - 1][column.name]) for column in order) if len(found) > limit else None
    return Page(tuple(map(read, found[:limit])), total, more)
