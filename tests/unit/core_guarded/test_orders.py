"""What a guard may order, read from one line or refused with a sentence."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.guarded.drills import AT_ONCE, BY_COMMAND, Drill
from core.guarded.orders import (
    DISK_FULL_S_MAX,
    DrillOrder,
    Order,
    Refused,
    SafeOrder,
    StatusOrder,
    TasksOrder,
    generation_of,
    read_order,
)


def drill(fault: object = "crash", generation: object = 4, **more: object) -> bytes:
    return json.dumps({"verb": "drill", "fault": fault, "generation": generation, **more}).encode()


def safe(on: object = True, reason: object = "DISK_FULL", generation: object = 4) -> bytes:
    return json.dumps({"verb": "safe", "on": on, "reason": reason, "generation": generation}).encode()


def test_orders_are_read() -> None:
    assert read_order(b'{"verb": "status"}', 9) == StatusOrder()
    assert read_order(b'{"verb": "tasks"}', 9) == TasksOrder()
    assert read_order(safe(), 4) == SafeOrder(on=True, reason="DISK_FULL", generation=4)
    assert read_order(safe(on=False), 4) == SafeOrder(on=False, reason="DISK_FULL", generation=4)
    for fault in Drill:
        assert read_order(drill(fault.value, armed=True), 4) == DrillOrder(fault, 4, armed=True)
    assert read_order(drill("diskfull", seconds=7), 4) == DrillOrder(Drill.DISKFULL, 4, seconds=7)


def test_every_drill_has_one_place_where_it_happens() -> None:
    assert AT_ONCE.keys() | BY_COMMAND.keys() == set(Drill)
    assert not AT_ONCE.keys() & BY_COMMAND.keys()


def test_memory_is_used_up_only_where_the_guard_has_bounded_it() -> None:
    refused = read_order(drill("oom"), 4)
    assert isinstance(refused, Refused)
    assert "armed" in refused.error


def test_only_what_changes_something_has_a_generation() -> None:
    assert [generation_of(read_order(line, 0)) for line in (drill(), safe())] == [4, 4]
    questions: list[Order] = [StatusOrder(), TasksOrder(), Refused("")]
    assert {generation_of(order) for order in questions} == {0}


@pytest.mark.parametrize(
    "line",
    [
        b"",
        b"status",
        b"[]",
        b'"status"',
        b"{}",
        b'{"verb": "shutdown"}',
        b'{"verb": ["status"]}',
        b"[" * 3000,
        b"\xff",
        drill("melt"),
        drill(None),
        drill(["crash"]),
        drill(generation=None),
        drill(generation="4"),
        drill(generation=True),
        drill(generation=-1),
        drill(generation=3),
        drill(generation=1 << 63),
        drill("oom", armed=1),
        drill("diskfull", seconds=0),
        drill("diskfull", seconds=DISK_FULL_S_MAX + 1),
        drill("diskfull", seconds=2.5),
        safe(on="yes"),
        safe(reason=None),
        safe(reason="disk full"),
        safe(generation=3),
    ],
)
def test_what_is_no_order_is_refused_with_a_sentence(line: bytes) -> None:
    refused = read_order(line, 4)
    assert isinstance(refused, Refused)
    assert refused.error.endswith(".")


@given(st.binary(max_size=200))
def test_no_line_can_raise(line: bytes) -> None:
    assert isinstance(read_order(line, 0), Order)


@given(
    st.dictionaries(
        st.sampled_from(["verb", "fault", "on", "reason", "generation", "armed", "seconds"]),
        st.one_of(
            st.none(),
            st.booleans(),
            st.integers(),
            st.floats(),
            st.text(max_size=5),
            st.sampled_from(["drill", "safe", "oom", "crash"]),
            st.lists(st.integers(), max_size=1),
        ),
    )
)
def test_no_object_can_raise(said: dict[str, object]) -> None:
    assert isinstance(read_order(json.dumps(said).encode(), 0), Order)
