"""What a guard tells its core, read whole or refused whole."""

from pathlib import Path

import pytest

from core.guarded.environment import GuardedEnvironment, LastSeen

HASH = "0f" * 32
WHOLE = {
    "HARDCORE_DATA": "/data",
    "HARDCORE_SOCKET": "/run/core.sock",
    "HARDCORE_RECORDER": "/run/recorder",
    "HARDCORE_CONTROL": "/run/core.ctl",
    "HARDCORE_EPOCH": "7",
    "HARDCORE_WITNESS": f"12:7:{HASH}",
    "HARDCORE_SAFE": "DISK_FULL",
    "HARDCORE_LIMIT_MS": "2500",
    "HARDCORE_MEMORY_BYTES": "268435456",
    "HARDCORE_AGENTS": "/run/agents.json",
    "HARDCORE_LISTEN_FD": "7",
    "NOTIFY_SOCKET": "@abstract",
    "WATCHDOG_USEC": "300000",
    "PATH": "/bin",
}


def test_everything_that_was_said_is_read() -> None:
    assert GuardedEnvironment.read(WHOLE) == GuardedEnvironment(
        data=Path("/data"),
        socket=Path("/run/core.sock"),
        recorder=Path("/run/recorder"),
        control=Path("/run/core.ctl"),
        expected_epoch=7,
        witnesses=(LastSeen(12, 7, bytes.fromhex(HASH)),),
        safe="DISK_FULL",
        limit_ms=2_500,
        memory_bytes=268_435_456,
        agents=Path("/run/agents.json"),
        listen_fd=7,
        notify_socket="@abstract",
        watchdog_usec=300_000,
    )


def test_a_core_that_was_told_nothing_runs_alone() -> None:
    found = GuardedEnvironment.read({"PATH": "/bin", "HARDCORE_EPOCH": ""})
    assert found == GuardedEnvironment()
    assert not found.guarded


def test_a_spare_needs_a_door_for_its_order_and_is_there_to_write() -> None:
    door = {"HARDCORE_SPARE": "1", "HARDCORE_CONTROL": "/run/core.ctl"}
    found = GuardedEnvironment.read(door)
    assert isinstance(found, GuardedEnvironment)
    assert found.spare
    for wrong in (
        {"HARDCORE_SPARE": "1"},
        {**door, "HARDCORE_SPARE": "0"},
        {**door, "HARDCORE_SAFE": "DISK_FULL"},
    ):
        faults = GuardedEnvironment.read(wrong)
        assert isinstance(faults, list)
        assert "HARDCORE_SPARE" in faults[0]


@pytest.mark.parametrize(
    "name", ["HARDCORE_SOCKET", "HARDCORE_RECORDER", "HARDCORE_CONTROL", "NOTIFY_SOCKET"]
)
def test_any_wire_to_a_guard_makes_a_guarded_core(name: str) -> None:
    found = GuardedEnvironment.read({name: "/run/wire"})
    assert isinstance(found, GuardedEnvironment)
    assert found.guarded


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("HARDCORE_DATA", "data"),
        ("HARDCORE_SOCKET", "/" + "s" * 107),
        ("HARDCORE_CONTROL", "/" + "가" * 36),
        ("HARDCORE_EPOCH", "seven"),
        ("HARDCORE_EPOCH", "-1"),
        ("HARDCORE_EPOCH", "9223372036854775808"),
        ("HARDCORE_WITNESS", "12:7"),
        ("HARDCORE_WITNESS", f"12:7:{HASH}0"),
        ("HARDCORE_WITNESS", f"9999999999999999999:7:{HASH}"),
        ("HARDCORE_WITNESS", f"12:7:{HASH},"),
        ("HARDCORE_WITNESS", ",".join([f"12:7:{HASH}"] * 5)),
        ("HARDCORE_SAFE", "disk full"),
        ("HARDCORE_SAFE", "D" * 41),
        ("HARDCORE_SAFE", "DISK_FULL\n"),
        ("HARDCORE_LIMIT_MS", "0"),
        ("HARDCORE_LIMIT_MS", "86400001"),
        ("HARDCORE_MEMORY_BYTES", "0"),
        ("HARDCORE_MEMORY_BYTES", "256M"),
        ("NOTIFY_SOCKET", "relative"),
        ("NOTIFY_SOCKET", "@"),
        ("NOTIFY_SOCKET", "@" + "a" * 107),
        ("WATCHDOG_USEC", "0"),
        ("WATCHDOG_USEC", "3e5"),
    ],
)
def test_a_wrong_value_is_one_sentence_with_its_name(name: str, value: str) -> None:
    faults = GuardedEnvironment.read({**WHOLE, name: value})
    assert isinstance(faults, list)
    (fault,) = faults
    assert fault.startswith(name)
    assert fault.endswith(".")


def test_all_faults_are_told_at_once() -> None:
    wrong = {"HARDCORE_DATA": "data", "HARDCORE_EPOCH": "x", "HARDCORE_WITNESS": "y", "WATCHDOG_USEC": "z"}
    faults = GuardedEnvironment.read(wrong)
    assert isinstance(faults, list)
    assert len(faults) == 4


def test_a_watchdog_that_is_meant_for_another_process_is_not_ours() -> None:
    said = {"WATCHDOG_USEC": "300000", "WATCHDOG_PID": "12"}
    ours, others = GuardedEnvironment.read(said, own_pid=12), GuardedEnvironment.read(said, own_pid=13)
    assert isinstance(ours, GuardedEnvironment)
    assert isinstance(others, GuardedEnvironment)
    assert (ours.watchdog_usec, others.watchdog_usec) == (300_000, None)
