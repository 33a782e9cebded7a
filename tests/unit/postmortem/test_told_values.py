from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from postmortem import intake
from postmortem.bundle import Found
from postmortem.records.reads import trends_of


def test_trends_count_weeks_and_say_how_long() -> None:
    since = datetime(2026, 11, 1, tzinfo=UTC)
    found = [((since + timedelta(days=day)).isoformat(), "CRASHED", 100.0 * day) for day in range(10)]
    told = trends_of([*found, ("no time", "CRASHED", None)], 2, since, since.isoformat())
    assert [week["incidents"] for week in told["weeks"]] == [7, 3]
    assert told["causes"][0]["p50_ms"] == 450.0
    assert told["causes"][0]["p90_ms"] == 900.0


@pytest.mark.parametrize(
    ("first", "hours"),
    [
        (timedelta(weeks=-5), 33.6),
        (timedelta(days=4), 24.0),
        (timedelta(weeks=2, minutes=-10), None),
        (None, None),
    ],
)
def test_the_time_between_incidents_is_counted_from_the_first_one_on_record_or_not_told(
    first: timedelta | None, hours: float | None
) -> None:
    since = datetime(2026, 11, 1, tzinfo=UTC)
    found = [((since + timedelta(days=13)).isoformat(), "CRASHED", 1.0)] * 10
    told = trends_of(found, 2, since, None if first is None else (since + first).isoformat())
    assert told["mtbf_hours"] == hours


def test_a_proposal_says_what_the_trial_of_its_wish_found(tmp_path: Path) -> None:
    wish = "f" * 64
    told = {
        "trials": [{"fingerprint": wish, "ordeal": "survived", "took_ms": 12.4}, {"ordeal": "died"}, 3],
        "proposals": [
            {
                "kind": "fingerprint",
                "text": {"en": "x"},
                "rule": {"type": "fingerprint", "fingerprint": wish},
            },
            {"kind": "person", "text": {"en": "y"}},
        ],
    }
    found = intake.story_of(Found("i1", tmp_path, partial=False), told).proposals
    assert [one.tested for one in found] == [
        "In a throw-away core on a copy of the ledger it was carried out after 12 ms.",
        None,
    ]
