"""What a guard may order, read from one line or refused with a sentence."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.guarded.drills import AT_ONCE, BESIDE, BY_COMMAND, Drill
from core.guarded.environment import WITNESSES_MAX, LastSeen
from core.guarded.orders import (
    DISK_FULL_S_MAX,
    LEAK_MB_PER_S_MAX,
    LEAK_S,
    WAIT_MS_MAX,
    CheckpointOrder,
    ComponentOrder,
    DrainOrder,
    DrillOrder,
    Order,
    PromoteOrder,
    QuarantineOrder,
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


def component(name: object, generation: object = 4) -> bytes:
    return json.dumps({"verb": "component", "name": name, "generation": generation}).encode()


SEEN = f"12:7:{'0f' * 32}"


def promote(**said: object) -> bytes:
    whole = {"expected_epoch": 7, "witnesses": [SEEN], "busy_ms": 100, "generation": 4}
    return json.dumps({"verb": "promote", **whole, **said}).encode()


def drain(within_ms: object = 2_000, generation: object = 4) -> bytes:
    return json.dumps({"verb": "drain", "within_ms": within_ms, "generation": generation}).encode()


def test_an_order_to_take_over_says_from_whom_and_what_was_seen() -> None:
    seen = LastSeen(12, 7, bytes.fromhex("0f" * 32))
    assert read_order(promote(), 4) == PromoteOrder(7, (seen,), 100, 4)
    assert read_order(promote(expected_epoch=None, witnesses=[], busy_ms=None), 4) == PromoteOrder(
        None, (), None, 4
    )
    assert read_order(promote(witnesses=[SEEN] * WITNESSES_MAX), 4) == PromoteOrder(
        7, (seen,) * WITNESSES_MAX, 100, 4
    )
    assert read_order(drain(), 4) == DrainOrder(2_000, 4)


@pytest.mark.parametrize(
    "line",
    [
        promote(expected_epoch=-1),
        promote(expected_epoch="7"),
        promote(expected_epoch=True),
        promote(busy_ms=0),
        promote(busy_ms=WAIT_MS_MAX + 1),
        promote(witnesses=None),
        promote(witnesses=SEEN),
        promote(witnesses=[SEEN, "12:7"]),
        promote(witnesses=[12]),
        promote(witnesses=[SEEN] * (WITNESSES_MAX + 1)),
        promote(generation=3),
        promote(generation=None),
        drain(0),
        drain(WAIT_MS_MAX + 1),
        drain("2000"),
        drain(generation=3),
        drain(generation=None),
    ],
)
def test_half_an_order_to_switch_is_none(line: bytes) -> None:
    assert isinstance(read_order(line, 4), Refused)


def test_orders_are_read() -> None:
    assert read_order(b'{"verb": "status"}', 9) == StatusOrder()
    assert read_order(b'{"verb": "tasks"}', 9) == TasksOrder()
    assert read_order(safe(), 4) == SafeOrder(on=True, reason="DISK_FULL", generation=4)
    assert read_order(safe(on=False), 4) == SafeOrder(on=False, reason="DISK_FULL", generation=4)
    for fault in set(Drill) - BESIDE:
        assert read_order(drill(fault.value, armed=True), 4) == DrillOrder(fault, 4, armed=True)
    assert read_order(drill("diskfull", seconds=7), 4) == DrillOrder(Drill.DISKFULL, 4, seconds=7)
    assert read_order(drill("leak", mb_per_s=0), 4) == DrillOrder(Drill.LEAK, 4, seconds=LEAK_S, mb_per_s=0)
    assert read_order(drill("stall", component="exporter"), 4) == DrillOrder(
        Drill.STALL, 4, component="exporter"
    )
    assert read_order(component("importer"), 4) == ComponentOrder("importer", 4)
    assert read_order(b'{"verb": "checkpoint", "generation": 4}', 4) == CheckpointOrder(4)


def test_every_drill_has_one_place_where_it_happens() -> None:
    places = [*AT_ONCE, *BY_COMMAND, *BESIDE]
    assert sorted(places) == sorted(Drill)


def test_memory_is_used_up_only_where_the_guard_has_bounded_it() -> None:
    refused = read_order(drill("oom"), 4)
    assert isinstance(refused, Refused)
    assert "armed" in refused.error


_CHANGING = (
    drill(),
    safe(),
    promote(),
    drain(),
    component("notifier"),
    b'{"verb": "checkpoint", "generation": 4}',
)


def test_only_what_changes_something_has_a_generation() -> None:
    assert [generation_of(read_order(line, 0)) for line in _CHANGING] == [4] * 6
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
        drill("leak", mb_per_s=LEAK_MB_PER_S_MAX + 1),
        drill("leak", seconds=0),
        drill("leak", mb_per_s=True),
        drill("stall"),
        drill("stall", component="Importer!"),
        component(None),
        component("a" * 25),
        component("importer", generation=3),
        b'{"verb": "checkpoint"}',
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


def test_an_order_to_read_the_rules_is_given_by_the_newest_generation_only() -> None:
    line = b'{"verb": "quarantine", "generation": 4}'
    assert read_order(line, 4) == QuarantineOrder(4)
    assert generation_of(QuarantineOrder(4)) == 4
    assert isinstance(read_order(line, 5), Refused)
    assert isinstance(read_order(b'{"verb": "quarantine"}', 0), Refused)
