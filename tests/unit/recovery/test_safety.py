"""The switch between reading only and writing, moment by moment."""

import pytest

from hardcore.model.looks import DiskFacts
from hardcore.model.observations import SafeSwitched, StoreFault
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.budget import NS_PER_S as S
from hardcore.recovery.safety import (
    ANSWER_NS,
    BY_OPERATOR,
    LOOK_AGAIN_NS,
    PASSING,
    RETRY_NS_MAX,
    Deed,
    Mode,
    Safety,
    safety,
)

FULL, CORRUPT, LOCKED = Diagnosis.DISK_FULL, Diagnosis.STORE_CORRUPT, Diagnosis.DB_LOCKED
WELL = DiskFacts(free_bytes=1 << 30, read_only=False, write_ns=1_000_000)


def _switch() -> Safety:
    return safety(retry_ms=5000, floor_mb=16, slow_ms=2000)


def _answer(at_ns: int, *, on: bool, done: bool = True) -> SafeSwitched:
    return SafeSwitched(at_ns, 1, on, done)


def _on(reason: Diagnosis = FULL) -> Safety:
    switch = _switch()
    assert switch.enter(reason, 0) is Deed.ORDER_ON
    switch.switched(_answer(0, on=True))
    return switch


def _ring(switch: Safety, *, quiet: bool = False) -> tuple[int, Deed]:
    """Ring when it wants to be rung; return when that was."""
    due_ns = switch.due_ns
    assert due_ns is not None
    return due_ns, switch.ring(due_ns, quiet=quiet)


# Entering.


def test_reading_only_is_said_when_the_core_has_said_so_and_not_before() -> None:
    switch = _switch()
    switch.enter(FULL, 0)
    assert (switch.on, switch.reason) == (True, None)
    switch.switched(_answer(1, on=True))
    assert switch.reason is FULL


def test_an_order_that_nobody_answers_is_repeated() -> None:
    switch = _switch()
    switch.enter(FULL, 0)
    assert _ring(switch) == (ANSWER_NS, Deed.ORDER_ON)
    assert _ring(switch) == (2 * ANSWER_NS, Deed.ORDER_ON)


def test_an_order_that_was_refused_is_repeated() -> None:
    switch = _switch()
    switch.enter(FULL, 0)
    switch.switched(_answer(S, on=True, done=False))
    assert _ring(switch) == (S + ANSWER_NS, Deed.ORDER_ON)


def test_an_order_that_nobody_answered_is_taken_back_when_nobody_complains_any_more() -> None:
    switch = _switch()
    switch.enter(FULL, 0)
    assert _ring(switch, quiet=True)[1] is Deed.ORDER_OFF
    assert not switch.on


def test_an_answer_that_comes_after_the_order_was_taken_back_is_believed() -> None:
    switch = _switch()
    switch.enter(FULL, 0)
    _ring(switch, quiet=True)
    switch.switched(_answer(9 * S, on=True))
    assert switch.reason is FULL
    assert switch.due_ns is not None


def test_a_core_that_switched_itself_needs_no_order() -> None:
    switch = _switch()
    switch.told(StoreFault.READ_ONLY, 0)
    assert switch.reason is Diagnosis.DISK_READ_ONLY
    assert switch.enter(Diagnosis.DISK_READ_ONLY, 0) is Deed.NOTHING


def test_nobody_is_told_twice() -> None:
    switch = _on()
    assert switch.enter(FULL, 0) is Deed.NOTHING
    assert switch.enter(Diagnosis.DISK_STALLED, 0) is Deed.NOTHING


def test_a_damaged_ledger_overrules_a_full_disk() -> None:
    switch = _on()
    assert switch.enter(CORRUPT, S) is Deed.ORDER_ON
    assert switch.reason is FULL
    switch.switched(_answer(S, on=True))
    assert (switch.reason, switch.locked, switch.due_ns) == (CORRUPT, True, None)


# Leaving.


def test_a_try_is_made_after_the_first_pause_and_then_after_doubling_ones() -> None:
    switch, tries = _on(), []
    for _ in range(6):
        at_ns, deed = _ring(switch)
        assert deed is Deed.ORDER_OFF
        tries.append(at_ns)
        switch.switched(_answer(at_ns, on=False, done=False))
    pauses = [after - before for before, after in zip([0, *tries], tries, strict=False)]
    assert pauses == [5 * S, 10 * S, 20 * S, 40 * S, RETRY_NS_MAX, RETRY_NS_MAX]


def test_a_try_that_nobody_answers_has_failed() -> None:
    switch = _on()
    at_ns, _ = _ring(switch)
    assert _ring(switch) == (at_ns + ANSWER_NS, Deed.NOTHING)
    assert (switch.mode, switch.reason) == (Mode.ON, FULL)


def test_a_try_that_was_answered_too_late_has_still_succeeded() -> None:
    switch = _on()
    _ring(switch)
    _ring(switch)
    switch.switched(_answer(99 * S, on=False))
    assert not switch.on


def test_a_disk_that_is_the_reason_again_soon_is_not_tried_as_early_as_at_first() -> None:
    switch = _on()
    at_ns, _ = _ring(switch)
    switch.switched(_answer(at_ns, on=False))
    switch.told(StoreFault.FULL, at_ns)
    assert switch.due_ns == at_ns + 10 * S
    switch.leave()
    switch.forget()
    switch.told(StoreFault.FULL, at_ns)
    assert switch.due_ns == at_ns + 5 * S


@pytest.mark.parametrize(
    "disk",
    [
        DiskFacts(free_bytes=1 << 20, read_only=False, write_ns=1),
        DiskFacts(free_bytes=1 << 30, read_only=True, write_ns=1),
        DiskFacts(free_bytes=1 << 30, read_only=False, write_ns=3 * S),
        DiskFacts(free_bytes=1 << 30, read_only=False, write_ns=None, pending_ns=3 * S),
        DiskFacts(free_bytes=1 << 30, read_only=False, write_ns=None, fault="EDQUOT"),
    ],
    ids=["full", "read-only", "slow", "standing", "quota"],
)
def test_no_try_is_made_while_the_disk_is_seen_to_be_ill(disk: DiskFacts) -> None:
    switch = _on()
    switch.disk = disk
    at_ns, deed = _ring(switch)
    assert deed is Deed.NOTHING
    switch.disk = WELL
    assert _ring(switch) == (at_ns + LOOK_AGAIN_NS, Deed.ORDER_OFF)


def test_a_lock_is_looked_at_again_and_again_and_tried_when_it_is_free() -> None:
    switch = _on(LOCKED)
    at_ns, deed = _ring(switch)
    assert (at_ns, deed) == (5 * S, Deed.LOOK)
    assert switch.looked(held=True, now_ns=at_ns) is Deed.NOTHING
    assert _ring(switch) == (at_ns + LOOK_AGAIN_NS, Deed.LOOK)
    assert switch.looked(held=False, now_ns=at_ns) is Deed.ORDER_OFF


def test_a_lock_that_nobody_can_look_at_is_tried_all_the_same() -> None:
    switch = _on(LOCKED)
    at_ns, _ = _ring(switch)
    assert _ring(switch) == (at_ns + ANSWER_NS, Deed.ORDER_OFF)


def test_a_look_at_the_lock_that_was_for_something_else_turns_no_switch() -> None:
    assert _on().looked(held=False, now_ns=S) is Deed.NOTHING
    assert _on(LOCKED).looked(held=False, now_ns=S) is Deed.NOTHING


@pytest.mark.parametrize("reason", sorted(set(Diagnosis) - PASSING - {BY_OPERATOR}))
def test_only_a_disks_reasons_and_a_lock_end_by_themselves(reason: Diagnosis) -> None:
    switch = _on(reason)
    assert switch.due_ns is None
    assert switch.try_to_write(S) is Deed.ORDER_OFF


def test_a_core_that_says_its_store_writes_again_has_left() -> None:
    switch = _on()
    switch.told(StoreFault.OK, S)
    assert not switch.on


def test_a_store_that_writes_says_nothing_of_a_damaged_ledger() -> None:
    switch = _on(CORRUPT)
    switch.told(StoreFault.OK, S)
    switch.told(StoreFault.FULL, S)
    assert switch.reason is CORRUPT


# Started so.


def test_a_core_that_was_started_to_read_only_is_changed_for_another() -> None:
    switch = _switch()
    switch.begin(FULL, 0)
    assert switch.reason is FULL
    assert _ring(switch) == (5 * S, Deed.RENEW)
    switch.begin(FULL, 6 * S)
    assert _ring(switch) == (16 * S, Deed.RENEW)


def test_a_core_that_was_started_to_read_only_is_told_nothing() -> None:
    switch = _switch()
    switch.begin(FULL, 0)
    assert switch.enter(CORRUPT, 0) is Deed.NOTHING
    assert (switch.reason, switch.due_ns) == (CORRUPT, None)


def test_a_ledger_that_is_known_to_be_damaged_stays_so_over_a_death() -> None:
    switch = _on(CORRUPT)
    switch.leave()
    assert switch.locked
    switch.begin(None, 0)
    assert (switch.locked, switch.on) == (True, False)


def test_nothing_waits_where_all_is_well() -> None:
    switch = _switch()
    assert (switch.due_ns, switch.ring(S, quiet=True), switch.try_to_write(S)) == (
        None,
        Deed.NOTHING,
        Deed.NOTHING,
    )
