from msgspec import structs

from hardcore.counters import BOUNDS_MS, Counts, Histogram, read_counts
from hardcore.model.actions import Incident
from hardcore.model.phases import HAState, Phase
from hardcore.model.verdicts import Diagnosis, Grade

MS = 1_000_000
FIRST, SECOND, THIRD = (101, 7), (102, 9), (101, 8)  # the third has the number of the first, and is another


def incident(
    *steps: tuple[str, int], outcome: str = "recovered", planned: bool = False, epoch: int | None = 2
) -> Incident:
    return Incident(
        id="i1",
        opened_ns=0,
        diagnosis=Diagnosis.CRASHED,
        grade=Grade.CERTAIN,
        evidence=(),
        planned=planned,
        drill=None,
        reason="",
        life=1,
        epoch=1,
        exit=None,
        last_words=None,
        in_flight=(),
        suspects=(),
        timeline=tuple((name, at_ms * MS) for name, at_ms in steps),
        deaths=(),
        requests=(),
        proof=None,
        witness=None,
        next_epoch=epoch,
        audit=None,
        outcome=outcome,
        waits_for=None,
        closed_ns=0,
    )


def test_a_restart_counts_only_when_a_new_process_has_served() -> None:
    counts = Counts()
    assert not counts.serve(FIRST, 1, None)  # a start, not a restart
    assert not counts.serve(FIRST, 1, Diagnosis.DISK_FULL)  # the same process answers again
    assert counts.serve(SECOND, 2, Diagnosis.CRASHED)
    assert not counts.serve(SECOND, 2, Diagnosis.CRASHED)  # one incident, one restart
    assert counts.serve(THIRD, 3, Diagnosis.FROZEN)
    assert counts.restarts == {"CRASHED": 1, "FROZEN": 1}


def test_a_core_that_was_adopted_is_no_new_one() -> None:
    counts = Counts()
    counts.adopt(FIRST)
    assert not counts.serve(FIRST, 1, Diagnosis.SENTINEL_LOST)
    counts.serve(SECOND, 2, None)
    counts.adopt(FIRST)  # too late: another has served since
    assert counts.serve(FIRST, 3, Diagnosis.CRASHED)


def test_a_first_answer_after_the_incidents_end_is_still_its_restart() -> None:
    counts = Counts()
    counts.serve(FIRST, 1, None)
    counts.close(incident(epoch=2))
    assert counts.serve(SECOND, 2, None)
    assert not counts.serve(THIRD, 3, None)
    assert counts.restarts == {"CRASHED": 1}


def test_an_incident_counts_once_with_its_outcome_and_its_times() -> None:
    counts = Counts()
    steps = (
        ("fault", 0),
        ("detected", 120),
        ("alerted", 130),
        ("killed", 140),
        ("fenced", 640),
        ("serving", 900),
    )
    counts.close(incident(*steps))
    counts.close(incident(("fault", 0), ("detected", 5), outcome="manual"))
    counts.close(incident(("fault", 0), ("serving", 5), planned=True))
    counts.close(incident(outcome="never heard of"))
    assert counts.incidents == {"CRASHED": {"recovered": 2, "manual": 1, "other": 1}}
    assert (counts.detection.sum_ms, sum(counts.detection.counts)) == (125, 2)
    assert (counts.recovery.sum_ms, sum(counts.recovery.counts)) == (900, 1)
    assert {name: one.sum_ms for name, one in counts.stages.items()} == {
        "detected": 120,
        "killed": 20,
        "fenced": 500,
        "serving": 260,
    }


def test_a_bucket_holds_what_took_no_longer_than_its_bound() -> None:
    one = Histogram()
    for took_ms in (0, BOUNDS_MS[0], BOUNDS_MS[0] + 1, BOUNDS_MS[-1], BOUNDS_MS[-1] + 1):
        one.add(took_ms)
    assert (one.counts[0], one.counts[1], one.counts[-2], one.counts[-1]) == (2, 1, 1, 1)


def test_only_a_suspicion_that_goes_back_to_running_was_false() -> None:
    counts = Counts()
    counts.change(Phase.RUNNING, Phase.SUSPECT)
    counts.change(Phase.SUSPECT, Phase.SNAPSHOT_LIVE)
    assert counts.false_suspicions == 0
    counts.change(Phase.SUSPECT, Phase.RUNNING)
    assert counts.false_suspicions == 1


def test_time_counts_for_the_state_it_was_spent_in_and_no_part_is_lost() -> None:
    counts = Counts()
    counts.pass_time(HAState.STARTING, 0, 0)
    for third in range(1, 4):
        counts.pass_time(HAState.OPERATIONAL, 2, third * MS * 10 // 3)
    assert counts.state_ms == {"STARTING": 3, "OPERATIONAL": 7}
    counts.pass_time(HAState.OPERATIONAL, 5, 10 * MS)
    assert counts.late_ticks == 5


def test_what_is_kept_is_what_is_read() -> None:
    counts = Counts()
    counts.serve(FIRST, 1, None)
    counts.serve(SECOND, 2, Diagnosis.CRASHED)
    counts.close(incident(("fault", 0), ("detected", 120), ("serving", 900)))
    counts.pass_time(HAState.OPERATIONAL, 3, 0)
    counts.pass_time(HAState.OPERATIONAL, 3, 5 * MS)
    again = read_counts(counts.told())
    assert again.told() == counts.told()
    again.pass_time(HAState.OPERATIONAL, 2, 0)  # the next guard counts its late looks from none
    assert again.late_ticks == 5


def test_a_file_that_makes_no_sense_begins_anew() -> None:
    good = structs.replace(Counts()).told()
    damages: tuple[dict[str, object], ...] = (
        {"version": 2},
        {"restarts": {"CRASHED": -1}},
        {"restarts": {"a name of somebody else's": 1}},
        {"incidents": {"CRASHED": {"recovered": True}}},
        {"detection_ms": {"bounds": [1], "counts": [1, 2], "sum": 1, "count": 3}},
        {"recovery_ms": {"bounds": list(BOUNDS_MS), "counts": ["x"] * 14, "sum": 1}},
        {"stage_ms": {"made up": {}}},
        {"late_ticks": 1e9},
        {"state_ms": []},
    )
    for damage in damages:
        assert read_counts({**good, **damage}).restarts == {}
        assert sum(read_counts({**good, **damage}).detection.counts) == 0
        assert read_counts({**good, **damage}).late_ticks == 0
