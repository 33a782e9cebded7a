from hardcore.recovery.deadline import AMNESTIES_MAX, Deadline


def _deadline(*, forgiving: bool) -> Deadline:
    deadline = Deadline(late_ns=20)
    deadline.set(100, 50, forgiving=forgiving)
    return deadline


def test_it_rings_when_the_time_is_over_and_not_before() -> None:
    deadline = _deadline(forgiving=True)
    assert not deadline.rings(149)
    assert deadline.rings(150)


def test_it_rings_once() -> None:
    deadline = _deadline(forgiving=True)
    assert deadline.rings(150)
    assert not deadline.rings(151)
    assert deadline.due_ns is None


def test_a_phase_without_a_limit_never_rings() -> None:
    deadline = _deadline(forgiving=True)
    deadline.set(100, None, forgiving=True)
    assert not deadline.rings(10**18)


def test_whoever_is_woken_far_too_late_begins_the_time_anew() -> None:
    deadline = _deadline(forgiving=True)
    assert not deadline.rings(1000)
    assert deadline.due_ns == 1050


def test_a_little_late_is_not_overslept() -> None:
    assert _deadline(forgiving=True).rings(170)


def test_time_that_is_not_the_cores_is_not_given_back() -> None:
    assert _deadline(forgiving=False).rings(10_000)


def test_a_machine_that_is_always_late_still_comes_to_an_end() -> None:
    deadline = _deadline(forgiving=True)
    rung = [deadline.rings(10_000 * n) for n in range(1, AMNESTIES_MAX + 2)]
    assert rung == [False] * AMNESTIES_MAX + [True]


def test_an_extension_never_shortens() -> None:
    deadline = _deadline(forgiving=True)
    deadline.extend(120)
    assert deadline.due_ns == 150
    deadline.extend(200)
    assert deadline.due_ns == 200
