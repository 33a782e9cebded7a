"""Work that may hang is run once at a time, and how long it hangs is known."""

import threading

from hardcore.host import clock
from hardcore.host.errand import Errand
from tests.waiting import WAIT_S


def test_what_comes_back_is_kept_until_the_next_comes_back() -> None:
    results = iter([1, 2])
    errand: Errand[int] = Errand("test", lambda: next(results))
    errand.send(clock.now_ns())
    assert errand.back(WAIT_S)
    first = errand.last
    assert (first, errand.pending_ns(clock.now_ns())) == (1, 0)
    errand.send(clock.now_ns())
    assert errand.back(WAIT_S)
    assert errand.last == 2


def test_work_that_hangs_is_not_begun_a_second_time_and_says_for_how_long() -> None:
    let_go, begun = threading.Event(), []

    def hang() -> str:
        begun.append(threading.get_ident())
        let_go.wait(WAIT_S)
        return "back"

    errand = Errand("test", hang)
    try:
        began_ns = clock.now_ns()
        errand.send(began_ns)
        errand.send(began_ns + 5)
        assert not errand.back(0)
        assert errand.pending_ns(began_ns + 7) == 7
    finally:
        let_go.set()
    assert errand.back(WAIT_S)
    assert (errand.last, len(begun)) == ("back", 1)
