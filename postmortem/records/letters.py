"""Writes dead letters into the archive: where each is, and everything that became of it.

Every move goes through the table of `dead_letters/life.py` inside one write transaction, so of two who want the same
letter one gets it and the other is told why not.
"""

import json
from collections.abc import Sequence
from typing import Any, Final

from msgspec import structs
from sqlalchemy import Connection, RowMapping, delete, func, insert, select, update

from postmortem.dead_letters import slip as slips
from postmortem.dead_letters.life import Trigger, after
from postmortem.dead_letters.ordeals import answered, was_refused
from postmortem.dead_letters.slip import LetterSlip
from postmortem.records.reads import letter_row
from postmortem.records.tables import ALIASES, ATTEMPTS, LETTER_ACCOUNTS, LETTERS, TAKEN
from postmortem.views import Attempt, DryRun, LetterState, Refusal

#: What became of one letter: beyond, the oldest is forgotten.
ATTEMPTS_MAX: Final = 200
INCIDENTS_MAX: Final = 64
NOTE_MAX: Final = 2_000
#: Spool messages that are remembered as taken in.
TAKEN_MAX: Final = 20_000


def is_taken(connection: Connection, message: str) -> bool:
    """Tell whether a message of the spool is in the archive, and note that it is from now on."""
    if connection.execute(select(TAKEN.c.number).where(TAKEN.c.message == message)).first() is not None:
        return True
    number = connection.execute(insert(TAKEN).values(message=message)).inserted_primary_key
    assert number is not None
    connection.execute(delete(TAKEN).where(TAKEN.c.number <= number[0] - TAKEN_MAX))
    return False


def take(connection: Connection, slip: LetterSlip) -> str:
    """Write a letter of the guard's, or the next attempt of one with its name; return the letter's id."""
    columns = LETTERS.c
    before = connection.execute(select(LETTERS).where(columns.name == slip.name)).mappings().first()
    identity: str = slip.id if before is None else before["id"]
    if before is None:
        connection.execute(insert(LETTERS).values(**_row(slip), id=identity, **_begun(slip)))
        _name_accounts(connection, identity, slip.account_ids)
    else:
        _come_back(connection, before, slip)
    known = connection.execute(select(ALIASES.c.letter).where(ALIASES.c.id == slip.id)).first()
    if known is None:
        connection.execute(insert(ALIASES).values(id=slip.id, letter=identity))
    incident = slip.incident_ids[-1] if slip.incident_ids else None
    ordeal, detail = slips.trial_words(slip.trial)
    add_attempt(
        connection, identity, Attempt(slip.quarantined_at, "trial", ordeal or "untried", incident, detail)
    )
    return identity


def take_unknown(connection: Connection, slip: LetterSlip) -> bool:
    """Write a letter that nobody here knows by its number or its name; False: somebody does."""
    by_name = select(LETTERS.c.id).where(LETTERS.c.name == slip.name)
    by_number = select(ALIASES.c.id).where(ALIASES.c.id == slip.id)
    if any(connection.execute(asked).first() is not None for asked in (by_name, by_number)):
        return False
    take(connection, slip)
    return True


def _begun(slip: LetterSlip) -> dict[str, Any]:
    state = LetterState.HELD if slip.held else LetterState.QUARANTINED
    return {"state": state, "note": "", "quarantined_at": slip.quarantined_at}


def _row(slip: LetterSlip) -> dict[str, Any]:
    return {
        "rule": slip.id,
        "rule_absent": False,
        "reason": slip.reason,
        "name": slip.name,
        "command_id": slip.command_id,
        "idempotency_key": slip.idempotency_key,
        "kind": slip.kind,
        "source": slip.source,
        "account_ids": json.dumps(slip.account_ids),
        "transaction_id": slip.transaction_id,
        "fingerprint": slip.fingerprint,
        "digest": slip.digest,
        "incident_ids": json.dumps(slip.incident_ids[:INCIDENTS_MAX]),
        "deaths": slip.deaths,
        "method": slip.method,
        "path": slip.path,
        "case": json.dumps(slip.case) if slip.case is not None else None,
        "seq": slip.seq,
        "sums": json.dumps(slip.sums),
    }


def _come_back(connection: Connection, before: RowMapping, slip: LetterSlip) -> None:
    """The same request was set aside again: what is known of it grows, and nothing of it is forgotten."""
    state = after(LetterState(before["state"]), Trigger.CAME_BACK)
    assert isinstance(state, LetterState), state
    if slip.held and state is LetterState.QUARANTINED:
        state = LetterState.HELD
    incidents = dict.fromkeys([*json.loads(before["incident_ids"]), *slip.incident_ids])
    told = {name: value for name, value in _row(slip).items() if value not in (None, "", "[]")}
    told |= {
        "state": state,
        "settled_at": before["settled_at"] if state is LetterState.DISCARDED else None,
        "incident_ids": json.dumps(list(incidents)[-INCIDENTS_MAX:]),
        "deaths": max(before["deaths"], slip.deaths),
    }
    connection.execute(update(LETTERS).where(LETTERS.c.id == before["id"]).values(**told))
    _name_accounts(connection, before["id"], slip.account_ids)


def _name_accounts(connection: Connection, letter_id: str, account_ids: Sequence[str]) -> None:
    """Have a letter found by these accounts, too."""
    accounts = LETTER_ACCOUNTS.c
    known = set(connection.execute(select(accounts.account).where(accounts.letter == letter_id)).scalars())
    new = [{"account": one, "letter": letter_id} for one in dict.fromkeys(account_ids) if one not in known]
    if new:
        connection.execute(insert(LETTER_ACCOUNTS), new)


def move(
    connection: Connection, letter_id: str, trigger: Trigger, at: str, **columns: Any
) -> RowMapping | Refusal:
    """Move a letter as its life allows and set `columns` with it; return its row, or why it can't be."""
    row = letter_row(connection, letter_id)
    if row is None:
        return Refusal("letter_unknown", {})
    if trigger is Trigger.UNDO and row["was_held"]:
        trigger = Trigger.UNDO_HELD
    state = after(LetterState(row["state"]), trigger)
    if not isinstance(state, LetterState):
        return Refusal(state, {"state": row["state"]})
    settled = state in (LetterState.RESOLVED, LetterState.DISCARDED)
    told = {"state": state, "settled_at": (row["settled_at"] or at) if settled else None, **columns}
    if trigger is Trigger.DISCARD and row["state"] != LetterState.DISCARDED:
        told["was_held"] = row["state"] == LetterState.HELD
    connection.execute(update(LETTERS).where(LETTERS.c.id == row["id"]).values(**told))
    return row


def put(connection: Connection, letter_id: str, **columns: Any) -> None:
    """Set what is not a move: its note, or whether its rule is in force."""
    connection.execute(update(LETTERS).where(LETTERS.c.id == letter_id).values(**columns))


def put_dry_run(connection: Connection, letter_id: str, found: DryRun) -> None:
    """Note what a throw-away core said, as the letter's newest word and as one more attempt."""
    put(connection, letter_id, dry_run=json.dumps(structs.asdict(found)))
    detail = found.why or answered(found)
    outcome = "refused" if was_refused(found) else found.ordeal
    add_attempt(connection, letter_id, Attempt(found.at, "dry-run", outcome, None, detail))


def add_attempt(connection: Connection, letter_id: str, one: Attempt) -> None:
    """Note one more thing that became of a letter; the oldest are forgotten above ATTEMPTS_MAX."""
    connection.execute(insert(ATTEMPTS).values(letter=letter_id, **structs.asdict(one)))
    of_it = ATTEMPTS.c.letter == letter_id
    newest = select(ATTEMPTS.c.number).where(of_it).order_by(ATTEMPTS.c.number.desc()).limit(ATTEMPTS_MAX)
    connection.execute(delete(ATTEMPTS).where(of_it, ATTEMPTS.c.number.not_in(newest)))


def in_state(connection: Connection, state: LetterState) -> list[RowMapping]:
    """The letters in a state, as rows."""
    return list(connection.execute(select(LETTERS).where(LETTERS.c.state == state)).mappings())


def without_rule(connection: Connection) -> list[RowMapping]:
    """Letters that have to be refused, but whose rule is not known to be in force."""
    absent = select(LETTERS).where(LETTERS.c.rule_absent, LETTERS.c.state != LetterState.RETRYING)
    return list(connection.execute(absent).mappings())


def count(connection: Connection) -> int:
    """How many letters there are at all."""
    return connection.execute(select(func.count()).select_from(LETTERS)).scalar_one()
