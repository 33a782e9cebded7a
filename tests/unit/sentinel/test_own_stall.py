from hardcore.sentinel.witnesses.own_stall import OwnStall

MS = 1_000_000


def _looked(*at_ms: int) -> tuple[OwnStall, list[bool]]:
    stall = OwnStall(100 * MS)
    return stall, [stall.look(at * MS) for at in at_ms]


def test_ticks_in_time_are_no_stall() -> None:
    stall, said = _looked(0, 100, 210, 400)
    assert said == [False] * 4
    assert stall.late_ticks == 0


def test_a_tick_more_than_two_intervals_late_is_ours() -> None:
    stall, said = _looked(0, 201, 301)
    assert said == [False, True, False]
    assert (stall.late_ticks, stall.forgiven_ns) == (1, 201 * MS)


def test_nothing_before_the_first_tick_counts() -> None:
    stall, _ = _looked(500)
    assert stall.forgiven_ns == 500 * MS
    assert stall.late_ticks == 0
