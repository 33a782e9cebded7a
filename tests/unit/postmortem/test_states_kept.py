"""Changes of the state, told by the guard, kept in the archive."""

from pathlib import Path

from sqlalchemy import select

from postmortem.dead_letters import spool
from postmortem.intake import Intake
from postmortem.records.opening import Records, open_records
from postmortem.records.reads import Archive
from postmortem.records.tables import STATES


def test_a_change_of_the_state_is_taken_in_once_and_is_no_act_of_anybody(tmp_path: Path) -> None:
    records = open_records(tmp_path / "hardcore.db")
    assert isinstance(records, Records)
    taken = Intake(records, tmp_path / "spool", tmp_path / "incidents")
    taken.spool.mkdir()
    change = {
        "at": "2026-11-22T10:00:00Z",
        "before": "OPERATIONAL",
        "after": "SAFE_MODE",
        "phase": "RUNNING",
        "reason": "the operator asked for it",
    }
    spool.write(taken.spool, "state", change)
    assert taken.take_spool() == 1
    assert list(taken.spool.iterdir()) == []
    with records.reading() as connection:
        (row,) = connection.execute(select(STATES)).mappings().all()
    assert {name: row[name] for name in change} == change
    assert not Archive(records, tmp_path / "rule_hits.json").audit(50).items
    records.close()
