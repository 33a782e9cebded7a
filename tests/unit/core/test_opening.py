"""What a core asks of its guard while it opens its book."""

from core.journal.chain import EventRow
from core.opening import ASK_EVERY_S, MORE_TIME_USEC, AskingForTime


def test_a_long_proof_asks_for_time_only_while_it_makes_progress() -> None:
    rows = [EventRow(seq, 1, 0, "k", "c", None, b"", b"") for seq in range(1, 5)]
    asked: list[int] = []
    now_s = 100.0
    passed = AskingForTime(asked.append, lambda: now_s).over(rows)
    assert next(passed) == rows[0]
    assert asked == []
    now_s += ASK_EVERY_S
    assert next(passed) == rows[1]
    assert asked == [MORE_TIME_USEC]
    assert next(passed) == rows[2]
    now_s += ASK_EVERY_S
    assert list(passed) == rows[3:]
    assert asked == [MORE_TIME_USEC] * 2
    assert ASK_EVERY_S * 1_000_000 < MORE_TIME_USEC
