from hardcore.sentinel.witnesses.own_stall import EXCUSED_MAX, OwnStall

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
    assert stall.late_ticks == 1


def test_a_late_look_is_excused_until_the_next_one() -> None:
    assert _looked(0, 300)[0].excused
    assert not _looked(0, 300, 400)[0].excused


def test_a_few_late_looks_in_a_row_are_excused_and_no_more() -> None:
    at_ms = range(0, 300 * (EXCUSED_MAX + 2), 300)
    assert _looked(*at_ms[: EXCUSED_MAX + 1])[0].excused
    assert not _looked(*at_ms)[0].excused
