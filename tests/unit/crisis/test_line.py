"""The line of those who wait for a core: who waits for a trial is not asked at each answer, and is never lost."""

from typing import cast

from hardcore.crisis.exchange import Client, Exchange
from hardcore.crisis.heads import RequestHead
from hardcore.crisis.line import Line


def waiting(since_ns: int) -> Exchange:
    # Neither its client nor its head has anything to do with where it stands.
    one = Exchange(cast("Client", None), cast("RequestHead", None), since_ns)
    one.waiting_ns = since_ns
    return one


def test_who_stands_aside_waits_and_is_not_asked_until_something_was_heard() -> None:
    line = Line()
    first, second, third = (waiting(number) for number in (1, 2, 3))
    for one in (first, second, third):
        line.join(one)
    line.step_aside(second)
    assert line.ready() == [first, third]
    assert len(line) == 3
    assert set(line) == {first, second, third}
    line.close_up()
    assert line.ready() == [first, second, third]


def test_who_leaves_is_gone_wherever_he_stood() -> None:
    line = Line()
    first, second = waiting(1), waiting(2)
    for one in (first, second):
        line.join(one)
    line.step_aside(first)
    for one in (first, second):
        line.leave(one)
    line.close_up()
    assert (len(line), line.ready()) == (0, [])
