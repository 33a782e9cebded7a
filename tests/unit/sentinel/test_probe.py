from hardcore.model.observations import Probed
from hardcore.model.recorder import Beats
from hardcore.sentinel.witnesses import probe as witness
from hardcore.sentinel.witnesses.probe import Probe, Unanswered
from tests.unit.sentinel.traces import MS, seen


def _look(probe: Probe, at_ms: int, completed: int = 0, *, excused: bool = False) -> Unanswered | None:
    return probe.look(Beats(completed=completed), seen(at_ms), excused=excused)


def _asked(probe: Probe, at_ms: int, *, answered: bool = False) -> None:
    probe.hear(Probed((at_ms + 900) * MS, 1, at_ms * MS, answered=answered))


def _begun() -> Probe:
    probe = Probe()
    _look(probe, 1000)
    return probe


def test_silence_counts_from_when_it_was_asked_to_when_it_was_given_up() -> None:
    probe = _begun()
    _asked(probe, 1100)
    _asked(probe, 2100)
    assert _look(probe, 3100) == Unanswered(2, 1900 * MS, 1100 * MS)


def test_an_answer_ends_it_and_all_that_was_asked_before_it() -> None:
    probe = _begun()
    _asked(probe, 1100)
    probe.hear(Probed(2300 * MS, 1, 2290 * MS, answered=True))
    assert _look(probe, 2400) is None
    _asked(probe, 2100)
    assert _look(probe, 3100) is None


def test_anything_completed_begins_it_anew() -> None:
    probe = _begun()
    _asked(probe, 1100)
    assert _look(probe, 2100, completed=1) is None
    _asked(probe, 2000)
    assert _look(probe, 3000, completed=1) is None


def test_what_has_another_reason_is_not_counted() -> None:
    probe = _begun()
    _asked(probe, 1100)
    assert _look(probe, 2100, excused=True) is None
    assert _look(probe, 2200) is None


def test_an_amnesty_begins_it_anew() -> None:
    probe = _begun()
    _asked(probe, 1100)
    assert probe.look(Beats(), seen(9000, since_ms=9000)) is None


def test_one_silence_is_no_news() -> None:
    assert witness.testify(None) is None
    assert witness.testify(Unanswered(1, 900 * MS, 0)) is None
    assert witness.testify(Unanswered(2, 1900 * MS, 0)) is not None
