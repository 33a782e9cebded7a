"""What can be done here is tried on a child that is gone afterwards."""

import sys
from pathlib import Path

import pytest

from hardcore.host import capability, processes
from hardcore.snapshot.stacks import find_tools


def test_the_child_that_is_dumped_lives_while_it_is_dumped_and_not_longer() -> None:
    seen: list[int] = []

    def dump(pid: int) -> str:
        seen.append(pid)
        assert processes.start_of(pid) is not None
        return ""

    told = capability.examine(Path("/py-spy"), None, dump)
    assert (told["can_dump"], told["why"], told["py_spy"], told["gcore"]) == (True, "", "/py-spy", None)
    assert processes.start_of(seen[0]) is None


def test_why_nothing_can_be_dumped_is_kept_up_to_a_bound() -> None:
    told = capability.examine(Path("/py-spy"), None, lambda _pid: "denied " * 100)
    assert told["can_dump"] is False
    assert str(told["why"]).startswith("denied")
    assert len(str(told["why"])) == capability.WHY_CHARACTERS_MAX


def test_without_a_debugger_nothing_is_tried() -> None:
    def dump(_pid: int) -> str:
        raise AssertionError("nothing to dump with")

    told = capability.examine(None, None, dump)
    assert (told["can_dump"], told["why"]) == (False, "py-spy is not installed")


def test_a_child_that_can_not_be_made_is_a_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    told = capability.examine(Path("/py-spy"), None, lambda _pid: "")
    assert told["can_dump"] is False
    assert "No such file" in str(told["why"])


def test_every_answer_stands_in_the_file_for_doctor() -> None:
    told = capability.examine(find_tools().py_spy, find_tools().gcore, lambda _pid: "")
    assert set(told) == {"py_spy", "can_dump", "why", "gcore", "yama", "oom_counter", "cgroup_own", "at"}
    assert told["oom_counter"] in {"cgroup2", "cgroup1", "vmstat", "none"}
    assert told["yama"] is None or isinstance(told["yama"], int)
    assert isinstance(told["cgroup_own"], bool)
    assert told["py_spy"] is None or Path(str(told["py_spy"])).is_absolute()
