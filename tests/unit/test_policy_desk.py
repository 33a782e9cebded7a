"""The policy of a running guard: taken whole or not at all, and never by half of a file."""

import asyncio
import json
import os
from pathlib import Path
from typing import Any

import pytest

from hardcore import standing
from hardcore.host import files
from hardcore.host.folders import Folders
from hardcore.host.lives import Life
from hardcore.model.actions import AlertStage
from hardcore.model.verdicts import Diagnosis
from hardcore.policy_desk import PolicyDesk, PolicyFile
from hardcore.recovery.differing import differences
from hardcore.recovery.policy import Policy, Word
from tests.unit.recovery.play import Play
from tests.unit.test_door import House, alerts_of


@pytest.fixture
def house(tmp_path: Path) -> House:
    folders = Folders(tmp_path, tmp_path / "run")
    folders.run.mkdir()
    folders.state.mkdir()
    return House(folders, Play().begin().running().manager.reading(), Life(1, "0" * 16, folders))


def write(house: House, text: str | dict[str, Any]) -> None:
    told = text if isinstance(text, str) else json.dumps(text)
    files.write_whole(house.folders.policy, told.encode(), durable=False)


def reload(desk: PolicyDesk, house: House) -> dict[str, Any]:
    async def told() -> dict[str, Any]:
        answer, _fds = await desk.reload()
        await asyncio.gather(*house.under_way)
        house.under_way.clear()
        return dict(answer)

    return asyncio.run(told())


def test_a_changed_file_is_gone_by_and_says_what_holds_only_later(house: House) -> None:
    desk = PolicyDesk(house, house.adopt)
    write(house, {"probation_ms": 7, "memory_limit_mb": 300, "gateway": {"hold_ms": 5}})
    answer = reload(desk, house)
    assert answer["changed"] == ["probation_ms", "memory_limit_mb", "gateway.hold_ms"]
    assert answer["later"] == ["memory_limit_mb", "gateway.hold_ms"]
    assert house.policy.probation_ms == 7
    assert standing.load_policy_file(house.folders.good_policy) == house.policy, "kept as the last good one"


def test_a_bad_file_never_replaces_a_good_one_and_is_told_once(house: House) -> None:
    desk = PolicyDesk(house, house.adopt)
    write(house, {"probation_ms": 7})
    reload(desk, house)
    write(house, '{"probation_ms": 8,\n"memory_limit_mb": "much"}')
    for _ in range(3):
        answer = reload(desk, house)
        assert answer["code"] == "policy-faults"
        assert [(one["line"], one["name"]) for one in answer["values"]["faults"]] == [(2, "memory_limit_mb")]
    assert house.policy.probation_ms == 7
    assert "line 2: memory_limit_mb" in desk.fault
    assert [stage for stage, _diagnosis in alerts_of(house)] == [AlertStage.OPENED]
    good = standing.load_policy_file(house.folders.good_policy)
    assert isinstance(good, Policy)
    assert good.probation_ms == 7


def test_a_mended_file_ends_the_fault_with_one_closing_word(house: House) -> None:
    desk = PolicyDesk(house, house.adopt, "failover_policy.json: line 1: not JSON")
    write(house, {})
    assert reload(desk, house)["changed"] == []
    assert desk.fault == ""
    assert alerts_of(house) == [(AlertStage.CLOSED, Diagnosis.CONFIG_INVALID)]


def test_a_file_that_is_half_written_is_read_again_before_it_is_called_broken(house: House) -> None:
    file = PolicyFile(house.folders)
    write(house, '{"probation_ms": 7')
    assert file.look() is None, "an editor may be in the middle of it"
    write(house, '{"probation_ms": 7}')
    found = file.look()
    assert found is not None
    assert found.policy == Policy(probation_ms=7)
    write(house, "{")
    assert file.look() is None
    found = file.look()
    assert found is not None
    assert found.policy is None
    assert file.look() is None, "told once"


def test_a_file_that_is_still_being_written_is_broken_only_once_it_stays_so(house: House) -> None:
    file = PolicyFile(house.folders)
    for length in range(1, 6):
        write(house, '{"probation_ms": 7}'[:length])
        assert file.look() is None


def test_a_file_that_was_only_touched_is_nothing_new(house: House) -> None:
    file = PolicyFile(house.folders)
    write(house, {"probation_ms": 7})
    assert file.look() is not None
    os.utime(house.folders.policy)
    assert file.look() is None
    write(house, {"probation_ms": 7})
    assert file.look() is None


def test_a_file_that_vanishes_is_a_fault_and_the_policy_holds(house: House) -> None:
    file = PolicyFile(house.folders)
    write(house, {"probation_ms": 7})
    file.look()
    house.folders.policy.unlink()
    assert file.look() is None
    found = file.look()
    assert found is not None
    assert "not a file" in found.faults[0].reason


def test_the_file_of_a_running_guard_is_taken_without_a_word(house: House) -> None:
    async def play() -> None:
        taken = asyncio.Event()

        def go_by(policy: Policy) -> None:
            house.policy = policy
            taken.set()

        watching = asyncio.create_task(PolicyDesk(house, go_by).look_on())
        write(house, {"probation_ms": 7})
        await asyncio.wait_for(taken.wait(), 30)
        watching.cancel()
        await asyncio.gather(*house.under_way)

    asyncio.run(play())
    assert house.policy.probation_ms == 7


def test_the_command_line_of_this_run_stays_above_the_file(
    house: House, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(standing.MODE_SWITCH, "observe")
    monkeypatch.setenv(standing.NO_SPARE_SWITCH, "1")
    house.policy = standing.of_this_run(Policy())
    write(house, {"mode": "assist", "spare": True})
    assert reload(PolicyDesk(house, house.adopt), house)["changed"] == []
    assert (house.policy.mode, house.policy.spare) == ("observe", False)


def test_what_two_policies_say_otherwise_is_named_inside_too() -> None:
    other = Policy(actions={Diagnosis.FROZEN: frozenset({Word.SEND_ALERT})}, mode="assist")
    assert differences(Policy(), other) == ["mode", "actions.FROZEN"]
    assert differences(other, other) == []


def test_no_address_of_a_channel_is_shown(house: House) -> None:
    desk = PolicyDesk(house, house.adopt)
    write(house, {"alerts": [{"kind": "ntfy", "url": "https://example.org/t0psecret"}]})
    assert reload(desk, house)["changed"] == ["alerts"]
    answer, _fds = desk.shown()
    assert "t0psecret" not in json.dumps(answer)
    assert len(house.policy.alerts) == 1
