"""What the agents are told to go by follows from the policy and from who the sentinel is."""

import dataclasses
from pathlib import Path

import pytest

from core.guarded.sentinel_seen import Orders, read_orders
from hardcore.agents_file import Guard, write_agents
from hardcore.host.folders import Folders
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.policy import Policy, Word

GUARD = Guard(3, 77, 4242, "n" * 32, "http://127.0.0.1:3000")


def told(tmp_path: Path, policy: Policy) -> Orders:
    folders = Folders(tmp_path, tmp_path)
    write_agents(folders, GUARD, policy)
    orders = read_orders(folders.agents)
    assert orders is not None
    return orders


@pytest.mark.parametrize("lost", ["SENTINEL_LOST", "GATEWAY_LOST"])
def test_each_side_has_a_word_of_the_policy(tmp_path: Path, lost: str) -> None:
    as_shipped = told(tmp_path, Policy())
    assert (as_shipped.sentinel_lost, as_shipped.gateway_lost) == (True, True)
    changed = dataclasses.replace(Policy(), actions={Diagnosis(lost): frozenset({Word.SEND_ALERT})})
    orders = told(tmp_path, changed)
    assert orders.sentinel_lost is (lost != "SENTINEL_LOST")
    assert orders.gateway_lost is (lost != "GATEWAY_LOST")


def test_a_guard_that_seldom_looks_may_be_silent_for_longer(tmp_path: Path) -> None:
    slow = dataclasses.replace(Policy(), health_check_interval_ms=2000)
    assert told(tmp_path, slow).stale_ns > told(tmp_path, Policy()).stale_ns


def test_who_is_meant_and_how_another_is_started_stands_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HARDCORE_NO_SPARE", "1")
    orders = told(tmp_path, Policy())
    assert (orders.pid, orders.start, orders.nonce) == (GUARD.pid, GUARD.start, GUARD.nonce)
    assert orders.argv[-4:] == ("--listen-fd", "{listen_fd}", "--url", GUARD.url)
    assert orders.environment["HARDCORE_NO_SPARE"] == "1"
    assert (tmp_path / "agents.json").stat().st_mode & 0o777 == 0o600
