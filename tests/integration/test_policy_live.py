"""The policy of a running guard: a good one is taken, a bad one never replaces it, at a start or later."""

import json
from typing import Any

from tests.integration.house import POLICY, START_S, House
from tests.waiting import until


def write(house: House, **changes: Any) -> None:
    house.folders.policy.write_text(json.dumps({**POLICY, **changes}), "utf-8")


def in_force(house: House) -> dict[str, Any]:
    found: dict[str, Any] = house.order("policy")["policy"]
    return found


def test_a_changed_file_is_taken_within_seconds_without_a_restart(house: House) -> None:
    before = house.running()
    write(house, max_restart_count=777, memory_limit_mb=600)
    until(lambda: in_force(house)["max_restart_count"] == 777, "the policy to be taken", START_S)
    told = house.running()
    assert told["budget"]["limit"] == 777
    assert [told[who]["pid"] for who in ("core", "gateway", "sentinel")] == [
        before[who]["pid"] for who in ("core", "gateway", "sentinel")
    ]
    write(house, max_restart_count=778, memory_limit_mb=601)
    answer = house.cli("policy", "reload", "--json").told
    if answer["changed"]:  # else the look of that second was quicker
        assert answer["changed"] == ["max_restart_count", "memory_limit_mb"]
        assert answer["later"] == ["memory_limit_mb"]
    assert in_force(house)["max_restart_count"] == 778


def test_a_bad_file_leaves_the_good_one_in_force_and_is_said_until_it_is_mended(house: House) -> None:
    good = in_force(house)
    house.folders.policy.write_text('{"version": 1,\n "max_restart_count": 0}', "utf-8")
    told = house.until(lambda s: s["policy_fault"], "the fault to be said")
    assert "line 2: max_restart_count" in told["policy_fault"]
    assert in_force(house) == good
    refused = house.cli("policy", "reload")
    assert refused.code == 1
    assert "max_restart_count" in refused.err
    assert "max_restart_count" in house.cli("status").out
    house.order("restart", hard=True, reason="is it still in force?")
    house.running()
    assert in_force(house) == good
    write(house)
    house.until(lambda s: not s["policy_fault"], "the fault to be gone")


def test_a_guard_that_starts_beside_a_bad_file_goes_by_the_last_good_one(house: House) -> None:
    write(house, max_restart_count=779)
    until(lambda: in_force(house)["max_restart_count"] == 779, "the policy to be taken", START_S)
    kept = house.folders.good_policy
    until(lambda: b"779" in kept.read_bytes(), "the good one to be kept", START_S)
    house.folders.policy.write_text("{", "utf-8")
    before = house.running()["core"]["pid"]
    sentinel = house.hit("sentinel")
    until(lambda: sentinel.gone, "the sentinel's end", START_S)
    told = house.until(lambda s: s["policy_fault"], "another guard that says the fault")
    assert in_force(house)["max_restart_count"] == 779
    assert told["core"]["pid"] == before
    write(house)
    house.until(lambda s: not s["policy_fault"], "the fault to be gone")


def test_a_dry_run_says_what_another_policy_would_have_done(house: House) -> None:
    house.running()
    victim = house.hit("core")
    house.until(lambda s: s["core"]["pid"] not in {None, victim.pid}, "another core")
    house.running()

    def killed() -> list[str]:
        return [one["id"] for one in house.incidents() if one["diagnosis"] == "KILLED_FROM_OUTSIDE"]

    until(killed, "its incident", START_S)
    incident = max(killed())
    until((house.folders.incidents / incident / "observations.jsonl").exists, "a recording", START_S)
    path = house.data.parent / "dry.json"
    path.write_text(json.dumps({**POLICY, "mode": "observe"}), "utf-8")
    told = house.cli("policy", "dry-run", str(path), "--json").told
    assert told["differences"]["mode"] == ["act", "observe"]
    (held,) = [one for one in told["incidents"] if one["incident"] == incident]
    assert held["said"] == "dry_incident_other"
    assert "Spawn" in held["does"]
    assert "Spawn" not in held["would"]
    assert house.cli("policy", "dry-run", str(path)).code == 0
