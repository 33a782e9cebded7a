"""What a page is told of an outage follows from what the gateway knows: never back, never more than is true."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from hardcore.crisis.estimate import Sample, Told, Way, sample
from hardcore.crisis.face import (
    NS_PER_MS,
    Outage,
    Pace,
    Text,
    due_ms,
    fields,
    finished,
    follow,
    is_sure,
    length_ms,
    show,
)
from hardcore.crisis.feed import AlertedHeard
from hardcore.crisis.standing import Serving, Standing, confirm, doubt, leaving, posture
from hardcore.model.phases import Face

PACE = Pace(longer_than_ms=30_000, floor_ms=5_000, doubt_ms=500)
PEACE = Standing(
    1, "RUNNING", "OPERATIONAL", Face.FORWARD, serving=Serving("/run/a", 7), released=7, heard_ns=1
)
DOWN = replace(PEACE, phase="STARTING", state="RECOVERY", face=Face.HOLD, stage=2, released=None)


def _ms(count: int) -> int:
    return count * NS_PER_MS


def _outage(*, since_ms: int = 1000, now_ms: int = 1000, samples: tuple[Sample, ...] = ()) -> Outage:
    begun = follow(None, PEACE, replace(DOWN, since_ns=_ms(since_ms)), samples, _ms(now_ms))
    assert begun is not None
    return begun


def test_while_a_core_serves_there_is_no_outage() -> None:
    assert follow(None, PEACE, PEACE, (), 5) is None
    assert follow(_outage(), DOWN, PEACE, (), 5) is None
    shown = show(None, PEACE, 3, PACE, 5)
    assert (shown.text, shown.stage, shown.elapsed_ms, shown.samples) == (None, None, 0, 3)


def test_a_doubt_of_our_own_is_the_first_stage_of_an_outage_that_nobody_planned() -> None:
    doubted = doubt(replace(PEACE, planned=True))  # the last start was a planned one
    begun = follow(None, PEACE, doubted, (), _ms(1000))
    assert begun is not None
    assert (begun.began_ns, begun.stage, begun.planned, begun.epoch) == (_ms(1000), 1, False, 7)


def test_a_doubt_is_told_to_nobody_before_the_guard_confirms_it_or_the_core_does_not_answer_or_it_lasts() -> (
    None
):
    doubted = doubt(PEACE)
    begun = follow(None, PEACE, doubted, (), _ms(1000))
    assert begun is not None
    early, late = _ms(1499), _ms(1500)
    assert not is_sure(begun, PACE, early)
    shown = show(begun, doubted, 0, PACE, early)
    assert (shown.text, shown.state, shown.phase) == (None, "OPERATIONAL", "RUNNING")
    assert due_ms(begun, PACE, early) == 1
    assert is_sure(begun, PACE, late)
    confirmed, guards = confirm(doubted), replace(DOWN, since_ns=_ms(1000))
    for known in (confirmed, guards):
        outage = follow(begun, doubted, known, (), early)
        assert outage is not None
        assert show(outage, known, 0, PACE, early).text is Text.RECOVERING


def test_what_the_guard_has_not_said_yet_is_not_shown_with_words_of_its_last_line() -> None:
    known = confirm(doubt(PEACE))
    outage = follow(None, PEACE, known, (), _ms(1000))
    assert outage is not None
    shown = show(outage, known, 0, PACE, _ms(1000))
    assert (shown.text, shown.state, shown.phase) == (Text.RECOVERING, "RECOVERY", "")


def test_a_core_that_leaves_is_no_outage_before_the_guard_says_so() -> None:
    outage = follow(None, PEACE, leaving(PEACE), (), _ms(1000))
    assert outage is not None
    assert not is_sure(outage, PACE, _ms(1001))


def test_a_gateway_that_has_heard_nothing_knows_of_no_outage_until_the_silence_is_long() -> None:
    nothing = Standing()
    outage = follow(None, nothing, nothing, (), _ms(1000))
    assert outage is not None
    assert not is_sure(outage, PACE, _ms(1499))
    assert is_sure(outage, PACE, _ms(1500))


def test_no_length_is_told_of_an_outage_whose_begin_nobody_saw() -> None:
    nothing, off = Standing(), replace(DOWN, face=Face.CLOSED, since_ns=_ms(900))
    fresh = follow(None, nothing, nothing, (), _ms(1000))
    unseen = follow(fresh, nothing, off, (), _ms(1001))
    assert unseen is not None
    assert length_ms(unseen, _ms(2000)) is None
    named = follow(unseen, off, replace(DOWN, incident="i1", since_ns=_ms(400)), (), _ms(1500))
    assert named is not None
    assert length_ms(named, _ms(2000)) == 1600
    assert length_ms(_outage(), _ms(2000)) == 1000


def test_the_outage_begins_with_whoever_saw_it_first() -> None:
    doubted = follow(None, PEACE, doubt(PEACE), (), _ms(1000))
    later = follow(doubted, doubt(PEACE), replace(DOWN, since_ns=_ms(1004)), (), _ms(1005))
    earlier = follow(doubted, doubt(PEACE), replace(DOWN, since_ns=_ms(400)), (), _ms(1005))
    assert later is not None
    assert earlier is not None
    assert (later.began_ns, earlier.began_ns) == (_ms(1000), _ms(400))
    unsaid = follow(None, PEACE, replace(DOWN, since_ns=0), (), _ms(1005))
    assert unsaid is not None
    assert unsaid.began_ns == _ms(1005)


@given(st.lists(st.sampled_from([None, 1, 2, 3, 4]), max_size=9))
def test_a_stage_never_goes_back(stages: list[int | None]) -> None:
    outage, before = _outage(), 0
    for at_ms, stage in enumerate(stages, 1001):
        followed = follow(outage, DOWN, replace(DOWN, stage=stage), (), _ms(at_ms))
        assert followed is not None
        outage = followed
        assert outage.stage >= before
        before = outage.stage


def test_the_promise_never_grows_while_the_stages_go_on() -> None:
    samples = tuple(sample(total, [(1, 0), (3, total // 2), (4, total - 100)]) for total in range(2000, 2010))
    outage = _outage(samples=samples)
    first = outage.told
    late = follow(outage, DOWN, replace(DOWN, stage=4), samples, _ms(1000 + 60_000))
    early = follow(outage, DOWN, replace(DOWN, stage=4), samples, _ms(1000 + 200))
    assert first is not None
    assert late is not None
    assert early is not None
    assert late.told is not None
    assert early.told is not None
    assert late.told.high_s <= first.high_s
    assert early.told.high_s == 1


@pytest.mark.parametrize(
    ("face", "planned", "elapsed_ms", "told", "text"),
    [
        (Face.HOLD, False, 0, None, Text.RECOVERING),
        (Face.HOLD, True, 0, None, Text.PLANNED),
        (Face.HOLD, False, 30_000, None, Text.RECOVERING),
        (Face.HOLD, False, 30_001, None, Text.LONGER),
        (Face.HOLD, True, 30_001, None, Text.LONGER),
        (
            Face.HOLD,
            False,
            1_500,
            Told(0, 1),
            Text.RECOVERING,
        ),  # past it, but nobody is to be alarmed yet
        (Face.HOLD, False, 5_001, Told(0, 1), Text.LONGER),
        (Face.HOLD, False, 5_001, Told(4, 9), Text.RECOVERING),
        (Face.HOLD, False, 9_001, Told(4, 9), Text.LONGER),
        (Face.REFUSE, False, 90_000, None, Text.STOPPED_TRYING),
        (Face.CLOSED, True, 90_000, None, Text.OFF),
    ],
)
def test_each_text_is_said_where_its_facts_are(
    face: Face, planned: bool, elapsed_ms: int, told: Told | None, text: Text
) -> None:
    outage = replace(_outage(), planned=planned, told=told)
    shown = show(outage, replace(DOWN, face=face), 9, PACE, outage.began_ns + _ms(elapsed_ms))
    assert shown.text is text


@pytest.mark.parametrize(("elapsed_ms", "promised"), [(1_000, True), (1_001, False)])
def test_past_its_end_a_promise_is_no_longer_shown(elapsed_ms: int, promised: bool) -> None:
    outage = replace(_outage(), told=Told(0, 1))
    shown = show(outage, DOWN, 9, PACE, outage.began_ns + _ms(elapsed_ms))
    assert (shown.eta is not None) is promised


@pytest.mark.parametrize("face", [Face.REFUSE, Face.CLOSED])
def test_no_time_is_promised_where_nobody_is_coming(face: Face) -> None:
    outage = replace(_outage(), told=Told(0, 1))
    assert show(outage, replace(DOWN, face=face), 9, PACE, outage.began_ns).eta is None


def test_the_moment_in_which_time_alone_changes_what_is_shown_is_known() -> None:
    outage = replace(_outage(), told=Told(0, 1))
    began_ns = outage.began_ns
    assert due_ms(outage, PACE, began_ns) == 1_001
    assert due_ms(outage, PACE, began_ns + _ms(1_001)) == 4_000
    assert due_ms(outage, PACE, began_ns + _ms(5_001)) is None
    assert due_ms(_outage(), PACE, began_ns) == 30_001


def test_an_outage_that_is_over_teaches_how_long_it_took_and_when_each_stage_came() -> None:
    outage = follow(_outage(), DOWN, replace(DOWN, stage=4), (), _ms(1_700))
    assert outage is not None
    assert finished(outage, 8, _ms(2_000)) == Sample(1_000, (0, 0, 700, 700))


def test_no_time_is_promised_before_it_is_known_which_way_the_next_core_comes() -> None:
    cold = tuple(sample(9_000, [(1, 0), (3, 100)], Way.COLD) for _ in range(9))
    quick = tuple(sample(300, [(1, 0), (3, 100)], Way.SPARE) for _ in range(9))
    killing = replace(DOWN, phase="KILLING", since_ns=_ms(1_000))
    outage = follow(None, PEACE, killing, cold + quick, _ms(1_000))
    assert outage is not None
    assert (outage.way, outage.told) == (None, None)
    switched = follow(outage, killing, replace(killing, phase="SWITCHING", stage=3), cold + quick, _ms(1_100))
    started = follow(outage, killing, replace(killing, phase="STARTING", stage=3), cold + quick, _ms(1_100))
    assert switched is not None
    assert started is not None
    assert (switched.told, switched.of) == (Told(0, 1), 9)
    assert (started.told, started.of) == (Told(9, 10), 9)


def test_a_spare_that_failed_to_take_over_leaves_the_history_of_a_cold_start() -> None:
    outage = _outage()
    for phase in ("SWITCHING", "KILLING", "STARTING", "PROVING"):
        later = follow(outage, DOWN, replace(DOWN, phase=phase), (), _ms(1_500))
        assert later is not None
        outage = later
    over = finished(outage, 8, _ms(2_000))
    assert over is not None
    assert over.way is Way.COLD


def test_an_outage_whose_way_nobody_saw_teaches_nothing() -> None:
    unseen = follow(None, PEACE, replace(DOWN, phase="KILLING"), (), _ms(1_000))
    assert unseen is not None
    assert finished(unseen, 8, _ms(2_000)) is None


def test_what_was_promised_is_kept_beside_what_came() -> None:
    known = tuple(sample(900, [(1, 0)]) for _ in range(9))
    over = finished(_outage(samples=known), 8, _ms(5_000))
    assert over is not None
    assert (over.total_ms, over.told, over.within) == (4_000, Told(0, 1), False)


def test_an_outage_teaches_nothing_that_was_nobodys_to_foresee() -> None:
    outage = _outage()
    assert finished(replace(outage, epoch=None), 8, _ms(2_000)) is None  # its begin was not seen
    assert finished(outage, 7, _ms(2_000)) is None  # the same core went on
    for face in (Face.REFUSE, Face.CLOSED):  # a person had to act
        touched = follow(outage, DOWN, replace(DOWN, face=face), (), _ms(1_500))
        assert touched is not None
        again = follow(touched, DOWN, DOWN, (), _ms(1_600))
        assert again is not None
        assert finished(again, 8, _ms(2_000)) is None


@pytest.mark.parametrize(
    ("alerted", "text", "at"),
    [
        (None, Text.LONGER, None),
        (
            AlertedHeard(1, "i1", "2026-01-01T00:00:01.000Z", failed=False),
            Text.LONGER,
            "2026-01-01T00:00:01.000Z",
        ),
        (AlertedHeard(1, "i1", None, failed=True), Text.UNTOLD, None),
        (AlertedHeard(1, "i0", None, failed=True), Text.LONGER, None),
        (AlertedHeard(1, "i0", "2026-01-01T00:00:01.000Z", failed=False), Text.LONGER, None),
    ],
)
def test_that_somebody_was_told_is_said_of_this_incident_alone(
    alerted: AlertedHeard | None, text: Text, at: str | None
) -> None:
    known = replace(DOWN, incident="i1", alerted=alerted)
    outage = _outage()
    shown = show(outage, known, 9, PACE, outage.began_ns + _ms(30_001))
    assert (shown.text, shown.alerted_at) == (text, at)
    assert show(outage, known, 9, PACE, outage.began_ns).text is Text.RECOVERING


def test_a_core_that_takes_over_without_a_pause_is_no_outage() -> None:
    after = replace(PEACE, serving=Serving("/run/b", 8), released=8)
    assert posture(after) is Face.FORWARD
    assert follow(None, PEACE, after, (), 5) is None


def test_the_frame_has_every_field_of_the_wire() -> None:
    outage = replace(_outage(), told=Told(0, 1), of=9)
    told = fields(show(outage, DOWN, 9, PACE, outage.began_ns + _ms(250)), 2, "2026-01-01T00:00:00.000Z")
    assert told == {
        "v": 1,
        "type": "state",
        "state": "RECOVERY",
        "phase": "STARTING",
        "stage": 2,
        "stages": 4,
        "since": "2026-01-01T00:00:00.000Z",
        "elapsed_ms": 250,
        "eta": {"low_s": 0, "high_s": 1, "samples": 9},
        "samples": 9,
        "incident": None,
        "held": 2,
        "planned": False,
        "alerted_at": None,
        "safe": None,
        "text": "R1",
        "sound": None,
    }


def test_a_core_that_only_reads_is_served_and_no_outage() -> None:
    safe = replace(PEACE, state="SAFE_MODE", safe="DISK_FULL")
    assert follow(None, PEACE, safe, (), 5) is None
    told = fields(show(None, safe, 3, PACE, 5), 0, None)
    assert (told["text"], told["safe"], told["state"]) == (None, "DISK_FULL", "SAFE_MODE")
    assert fields(show(None, PEACE, 3, PACE, 5), 0, None)["safe"] is None
