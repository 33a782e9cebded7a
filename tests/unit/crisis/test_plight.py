"""Which recovery page a tab is shown: true of the moment, and of its request."""

from itertools import product

import pytest

from frontend import crisis_paper
from hardcore.crisis.heads import RequestHead, read_request
from hardcore.crisis.pages import plain
from hardcore.crisis.plight import Asked, Cover, Plight, cover, plight
from hardcore.crisis.problems import RETRY_AFTER_S, STATUS, Outcome, Problem
from hardcore.crisis.shelf import stock
from hardcore.model.phases import Face


def test_every_plight_of_every_request_has_its_page_in_both_languages() -> None:
    shelf = stock(demo=False)
    assert set(shelf.covers) == {
        (lang, Cover(one, asked)) for lang, one, asked in product(("ko", "en"), Plight, Asked)
    }
    assert len({sheet.tag for sheet in shelf.covers.values()}) == len(shelf.covers)
    assert set(crisis_paper.KINDS) == {str(one) for one in Plight}
    assert set(crisis_paper.OUTCOMES) == {str(one) for one in Asked}


@pytest.mark.parametrize("planned", [True, False])
def test_nobody_is_promised_a_return_that_is_not_coming(planned: bool) -> None:
    assert plight(Face.REFUSE, planned=planned) is Plight.STOPPED_TRYING
    assert plight(Face.CLOSED, planned=planned) is Plight.OFF


def test_a_planned_restart_is_told_from_a_fault() -> None:
    assert plight(Face.HOLD, planned=True) is Plight.PLANNED
    assert plight(Face.HOLD, planned=False) is Plight.RECOVERING


def test_a_request_that_only_reads_is_never_called_undone_or_unknown() -> None:
    for problem, outcome, posture in product(Problem, Outcome, Face):
        told = cover(problem, outcome, posture, safe=True, planned=False)
        assert told is None or told.asked is Asked.GET


def test_only_what_is_known_not_to_have_run_is_called_not_done() -> None:
    for problem, posture in product(Problem, Face):
        done = cover(problem, Outcome.NOT_DONE, posture, safe=False, planned=False)
        doubt = cover(problem, Outcome.UNKNOWN, posture, safe=False, planned=False)
        assert done is None or done.asked is Asked.NOT_DONE
        assert doubt is None or doubt.asked is Asked.UNKNOWN


def test_what_may_have_run_is_offered_to_be_kept_only_while_a_core_is_coming() -> None:
    for posture in Face:
        told = cover(
            Problem.OUTCOME_UNKNOWN, Outcome.UNKNOWN, posture, safe=False, planned=False, keepable=True
        )
        comes = posture in {Face.HOLD, Face.FORWARD}
        assert told is not None
        assert told.asked is (Asked.DOUBTFUL if comes else Asked.UNKNOWN)


def test_a_full_house_is_an_outage_only_while_nobody_serves() -> None:
    assert cover(Problem.TOO_BUSY, Outcome.NOT_DONE, Face.FORWARD, safe=True, planned=False) is None
    assert cover(Problem.TOO_BUSY, Outcome.NOT_DONE, Face.HOLD, safe=True, planned=False) is not None


def test_a_fault_that_is_no_outage_is_not_called_one() -> None:
    for problem in (Problem.BROKEN_ANSWER, Problem.CORE_TOO_SLOW, Problem.BODY_TOO_LARGE, Problem.WRONG_HOST):
        assert cover(problem, Outcome.NOT_DONE, Face.FORWARD, safe=True, planned=False) is None


@pytest.mark.parametrize(("method", "returns"), [("GET", True), ("POST", False)])
def test_the_page_that_needs_no_rendering_comes_back_by_itself_only_if_that_sends_nothing(
    method: str, returns: bool
) -> None:
    head = read_request(
        method,
        b"/",
        "1.1",
        ((b"Host", b"h"), (b"Accept", b"text/html")),
        {"h"},
        keep_alive=True,
        upgrade=False,
    )
    assert isinstance(head, RequestHead)
    for problem in Problem:
        answer = plain(problem, head)
        assert answer.head.status == STATUS[problem]
        assert (b'http-equiv="refresh"' in answer.body) is (returns and problem in RETRY_AFTER_S)
