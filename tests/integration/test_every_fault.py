"""Each fault is made for real, once, and has to be called by its right name and answered as promised.

One house for all of them, so that each drill also meets whatever the ones before have left behind. What is asked
here is the outcome that `hardcore drill` promises, that evidence came before each kill, and that a trouble which a
restart would not help kills nobody. Repetitions and times are for `make bench`.
"""

from collections.abc import Iterator
from typing import Any

import pytest

from hardcore.drilling import PROMISES
from tests.integration.house import House, whole
from tests.waiting import until

#: The core stands still but lives: its evidence is taken before it is ended.
HANGS = {"freeze", "block", "spin", "gil", "deadlock", "slow-tx"}
#: Nobody is ended: a restart would not help.
LIVES_ON = {"dblock", "diskfull"}
#: What depends on the machine, what somebody has to send first, what is not the core's, and what shows slowly: each
#: has a test of its own.
APART = {"oom", "poison", "gateway", "leak", "stall"}
#: On a busy machine two looks at the stacks take over a second, and a deadlock is to be called that.
POLICY = {"transaction_timeout_ms": 2500, "safe_retry_ms": 300}


@pytest.fixture(scope="module")
def shared_house(tmp_path_factory: pytest.TempPathFactory) -> Iterator[House]:
    """The house of this module: the same as any, with the long waits made short."""
    house = House(tmp_path_factory.mktemp("drills") / "data", POLICY)
    try:
        house.up()
        house.open_accounts()
        yield house
    finally:
        house.end()


def drill(house: House, fault: str) -> dict[str, Any] | str:
    """Break it, wait for what comes of it; the story, or why the drill was refused."""
    count = len(house.incidents())
    house.running()
    answer = house.order("drill", fault=fault, yes=True)
    if not answer["ok"]:
        return str(answer["error"])
    story = whole(house, count + 1)
    house.running()
    return story


@pytest.mark.parametrize(
    "fault",
    [
        pytest.param(fault, marks=pytest.mark.in_a_file) if fault == "dblock" else fault
        for fault in PROMISES
        if fault not in APART
    ],
)
def test_a_fault_is_called_by_its_name_and_answered_as_promised(house: House, fault: str) -> None:
    epoch = house.running()["core"]["epoch"]
    story = drill(house, fault)
    assert isinstance(story, dict), story
    assert story["diagnosis"] == PROMISES[fault].diagnosis, story
    assert story["outcome"] == PROMISES[fault].outcome, story
    steps = [line["step"] for line in story["timeline"]]
    raised = house.running()["core"]["epoch"] - epoch
    assert raised == (0 if fault in LIVES_ON else 1), story
    if fault in HANGS:
        assert story["evidence_complete"], story["evidence"]
        assert steps.index("frozen") < steps.index("dumped") < steps.index("killed")
    if fault in LIVES_ON:
        assert "killed" not in steps
    assert house.book(f"after-{fault}").status == 201


def test_memory_without_end_is_told_from_a_kill_or_the_drill_says_why_not(house: House) -> None:
    story = drill(house, "oom")
    if isinstance(story, str):
        assert "cgroup" in story
        return
    assert story["diagnosis"] == "OUT_OF_MEMORY", story
    assert story["outcome"] == "recovered"


def test_a_slow_transaction_is_named(house: House) -> None:
    story = drill(house, "slow-tx")
    assert isinstance(story, dict), story
    assert story["account_ids"] == ["system:drill"] or story["command_ids"], story


@pytest.mark.in_a_file
def test_a_lock_held_by_another_process_is_named_with_its_holder(house: House) -> None:
    story = drill(house, "dblock")
    assert isinstance(story, dict), story
    assert any("python" in line and "lock" in line for line in map(str, story["evidence"])), story


def test_while_the_disk_is_full_reads_go_on_and_writes_are_refused_and_afterwards_both_work(
    house: House,
) -> None:
    count = len(house.incidents())
    assert house.order("drill", fault="diskfull", yes=True)["ok"]
    until(lambda: house.status().get("state") == "SAFE_MODE", "safe mode")
    refused = house.book("into-the-full-disk")
    assert refused.status in {201, 503}
    if refused.status == 503:
        assert refused.body["type"] == "/problems/safe-mode"
        assert refused.outcome == "not_done"
    assert house.ask("GET", "/api/ledger/accounts").status == 200
    house.closed(count + 1)
    house.running()
    assert house.book("into-the-full-disk").status == 201
    assert house.booked().count("into-the-full-disk") == 1


def test_a_long_collection_of_garbage_ends_nobody(house: House) -> None:
    before = house.running()
    done = house.cli("drill", "gc", "--yes")
    assert done.code == 0, done.err
    after = house.running()
    assert after["core"]["pid"] == before["core"]["pid"]
    assert after["last_incident"] == before["last_incident"]
