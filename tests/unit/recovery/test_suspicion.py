from hardcore.model.recorder import CommandNote, SlotStage
from hardcore.recovery.suspicion import GREW_BYTES, LOOKS_MAX, Growth


def _note(started_ns: int) -> CommandNote:
    return CommandNote(SlotStage.DECIDING, "c", "k", "transaction", "", (), started_ns)


def _growth(*looks: tuple[int, int]) -> Growth:
    growth = Growth()
    for at_ns, rss_bytes in looks:
        growth.look(at_ns, rss_bytes)
    return growth


def test_growth_counts_from_the_last_look_before_the_command() -> None:
    growth = _growth((10, 100), (20, 150), (30, 400), (40, 390))
    assert (growth.during(15), growth.during(25)) == (300, 250)


def test_a_core_that_was_large_before_the_command_has_not_grown_during_it() -> None:
    growth = _growth((10, 9 * GREW_BYTES), (30, 9 * GREW_BYTES))
    assert not growth.grew(_note(20))


def test_a_core_that_grew_during_a_command_makes_it_suspect() -> None:
    assert _growth((10, 1), (30, 1 + GREW_BYTES)).grew(_note(20))
    assert not _growth((10, 1), (30, GREW_BYTES)).grew(_note(20))


def test_nobody_is_suspect_where_nobody_looked() -> None:
    assert not _growth().grew(_note(20))
    assert not _growth((10, 1)).grew(_note(20))
    assert not _growth((30, 9 * GREW_BYTES)).grew(_note(20))


def test_only_so_many_looks_are_kept() -> None:
    growth = _growth((0, 0), *((at_ns, GREW_BYTES) for at_ns in range(1, LOOKS_MAX + 1)))
    assert growth.during(0) == 0
