"""What the gateway knows, and the posture that follows: late or wrong lines can only make it wait."""

import itertools

import pytest

from hardcore.crisis.feed import (
    Heard,
    PhaseHeard,
    ReleaseHeard,
    ServingHeard,
    SuspectsHeard,
    Verdict,
    VerdictHeard,
)
from hardcore.crisis.standing import (
    SUSPECTS_MAX,
    Standing,
    alive,
    confirm,
    doubt,
    hear,
    leaving,
    posture,
    ready,
    trust,
)
from hardcore.model.phases import Face

FORWARD = PhaseHeard(1, "RUNNING", "OPERATIONAL", Face.FORWARD, None)
HOLD = PhaseHeard(1, "STARTING", "RECOVERY", Face.HOLD, "i1")
SERVING = ServingHeard(1, "/run/a", 7)
RELEASE = ReleaseHeard(1, 7, None)


def _after(*messages: Heard) -> Standing:
    standing = Standing()
    for message in messages:
        heard = hear(standing, message, 5)
        assert heard is not None
        standing = heard
    return standing


def test_a_gateway_that_has_heard_nothing_holds() -> None:
    assert posture(Standing()) is Face.HOLD
    assert not ready(Standing())
    assert not alive(Standing(), 0, 1000)


def test_a_core_is_served_once_it_is_named_released_and_wanted_in_any_order() -> None:
    lines: tuple[Heard, ...] = (FORWARD, SERVING, RELEASE)
    for order in itertools.permutations(lines):
        if order.index(SERVING) < order.index(RELEASE):  # a release of a core that is not named is of another
            assert posture(_after(*order)) is Face.FORWARD


@pytest.mark.parametrize("missing", [FORWARD, SERVING, RELEASE])
def test_one_of_the_three_missing_means_hold(missing: Heard) -> None:
    assert posture(_after(*[m for m in (SERVING, RELEASE, FORWARD) if m is not missing])) is Face.HOLD


@pytest.mark.parametrize("face", [Face.HOLD, Face.REFUSE, Face.CLOSED])
def test_the_feed_alone_can_end_forwarding(face: Face) -> None:
    heard = _after(SERVING, RELEASE, FORWARD, PhaseHeard(1, "X", "RECOVERY", face, None))
    assert posture(heard) is face


def test_a_verdict_of_any_kind_ends_a_suspicion_and_the_last_one_frees_the_accounts() -> None:
    two = SuspectsHeard(1, ("aa", "bb"), ("assets:cash",))
    for outcome in Verdict:
        one_left = _after(two, VerdictHeard(1, "aa", outcome))
        assert (one_left.suspects, one_left.account_ids) == (("bb",), ("assets:cash",))
        none_left = _after(two, VerdictHeard(1, "aa", outcome), VerdictHeard(1, "bb", outcome))
        assert (none_left.suspects, none_left.account_ids) == ((), ())


def test_a_hold_takes_the_release_back() -> None:
    assert posture(_after(SERVING, RELEASE, FORWARD, HOLD, FORWARD)) is Face.HOLD
    assert posture(_after(SERVING, RELEASE, FORWARD, HOLD, RELEASE, FORWARD)) is Face.FORWARD


def test_the_release_of_another_epoch_releases_nothing() -> None:
    assert posture(_after(SERVING, ReleaseHeard(1, 6, None), FORWARD)) is Face.HOLD


def test_a_new_core_needs_a_release_of_its_own() -> None:
    assert posture(_after(SERVING, RELEASE, FORWARD, ServingHeard(1, "/run/b", 8))) is Face.HOLD


def test_the_same_core_named_again_goes_on_serving() -> None:
    assert posture(_after(SERVING, RELEASE, FORWARD, SERVING)) is Face.FORWARD


def test_a_lower_generation_is_not_heard() -> None:
    standing = _after(PhaseHeard(3, "RUNNING", "OPERATIONAL", Face.FORWARD, None))
    assert hear(standing, HOLD, 9) is None
    assert hear(standing, PhaseHeard(3, "X", "RECOVERY", Face.HOLD, None), 9) is not None


def test_a_doubt_holds_until_it_is_ended() -> None:
    served = _after(SERVING, RELEASE, FORWARD)
    assert posture(doubt(served)) is Face.HOLD
    assert not ready(doubt(served))
    assert posture(trust(doubt(served))) is Face.FORWARD
    again = hear(doubt(served), RELEASE, 9)
    assert again is not None
    assert posture(again) is Face.FORWARD


def test_a_question_without_an_answer_confirms_a_doubt_and_nothing_else() -> None:
    served = _after(SERVING, RELEASE, FORWARD)
    assert not confirm(served).unanswered
    sure = confirm(doubt(served))
    assert sure.unanswered
    assert not trust(sure).unanswered
    for line in (RELEASE, ServingHeard(1, "/run/b", 8)):
        heard = hear(sure, line, 9)
        assert heard is not None
        assert not heard.unanswered


def test_a_sign_of_life_does_not_end_a_doubt() -> None:
    heard = hear(doubt(_after(SERVING, RELEASE, FORWARD)), FORWARD, 9)
    assert heard is not None
    assert posture(heard) is Face.HOLD


def test_a_core_that_is_leaving_needs_a_new_release() -> None:
    left = leaving(_after(SERVING, RELEASE, FORWARD))
    assert posture(left) is Face.HOLD
    assert posture(trust(left)) is Face.HOLD


def test_suspects_are_remembered_over_several_deaths_up_to_a_bound() -> None:
    standing = _after(SuspectsHeard(1, ("a", "b")), SuspectsHeard(1, ("b", "c")), SuspectsHeard(1, ()))
    assert standing.suspects == ("a", "b", "c")
    flood = _after(SuspectsHeard(1, tuple(str(n) for n in range(SUSPECTS_MAX + 5))))
    assert len(flood.suspects) == SUSPECTS_MAX
    assert flood.suspects[-1] == str(SUSPECTS_MAX + 4)


def test_life_is_a_matter_of_when_the_feed_was_last_heard() -> None:
    standing = _after(FORWARD)
    assert alive(standing, 5 + 10_000_000, 10)
    assert not alive(standing, 6 + 10_000_000, 10)


@pytest.mark.parametrize(
    ("state", "expected"),
    [
        ("OPERATIONAL", True),
        ("DEGRADED", True),
        ("SAFE_MODE", True),
        ("RECOVERY", False),
        ("STARTING", False),
    ],
)
def test_readiness_is_a_reading_of_the_state(state: str, expected: bool) -> None:
    assert ready(_after(PhaseHeard(1, "RUNNING", state, Face.FORWARD, None))) is expected
