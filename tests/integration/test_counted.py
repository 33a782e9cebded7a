"""What monitors are told by a whole house: its numbers go with what has happened, over the deaths of core and guard."""

import signal
import urllib.request

from prometheus_client.openmetrics.parser import text_string_to_metric_families

from tests.integration.house import House
from tests.waiting import until

Numbers = dict[str, float]


def numbers(house: House) -> Numbers:
    """Every number at the door, by its name and the values of its labels."""
    with urllib.request.urlopen(f"{house.url}/metrics", timeout=10) as answer:
        families = list(text_string_to_metric_families(answer.read().decode()))  # type: ignore[no-untyped-call]
    return {"/".join([s.name, *s.labels.values()]): s.value for family in families for s in family.samples}


def test_a_restart_is_counted_when_its_process_serves_and_is_remembered_over_the_guards_death(
    house: House,
) -> None:
    before = until(lambda: _told_of_the_core(house), "the guard's word")
    assert before["hardcore_core_up"] == before["hardcore_core_state/OPERATIONAL"] == 1
    assert not [name for name in before if name.startswith("hardcore_core_restarts_total")]
    house.hit("core")
    house.running()
    until(lambda: numbers(house).get("hardcore_core_restarts_total/KILLED_FROM_OUTSIDE") == 1, "a restart")
    after = until(
        lambda: _with_epoch(house, before["hardcore_core_epoch"] + 1), "the guard's word of the new core"
    )
    assert after["hardcore_incidents_total/KILLED_FROM_OUTSIDE/recovered"] == 1
    assert after["hardcore_recovery_seconds_count"] == after["hardcore_detection_seconds_count"] == 1
    stages = {name for name in after if name.startswith("hardcore_recovery_stage_seconds_sum/")}
    assert stages >= {
        f"hardcore_recovery_stage_seconds_sum/{name}" for name in ("detected", "fenced", "serving")
    }
    assert after["hardcore_core_start_time_seconds"] > before["hardcore_core_start_time_seconds"]
    assert after["hardcore_snapshot_bytes"] > 0
    assert house.folders.counters.exists()

    guard = house.hit("sentinel", signal.SIGKILL)
    until(lambda: guard.gone and house.status(), "the next guard")
    house.running()
    kept = until(lambda: _with_epoch(house, after["hardcore_core_epoch"]), "the next guard's word")
    assert kept["hardcore_core_restarts_total/KILLED_FROM_OUTSIDE"] == 1  # the core went on: none is counted
    assert kept["hardcore_core_start_time_seconds"] == after["hardcore_core_start_time_seconds"]


def _told_of_the_core(house: House) -> Numbers:
    """The numbers once the guard itself has spoken of its core."""
    found = numbers(house)
    return found if "hardcore_core_start_time_seconds" in found else {}


def _with_epoch(house: House, epoch: float) -> Numbers:
    """The numbers once the guard itself has spoken of the core of this epoch."""
    found = numbers(house)
    told = "hardcore_core_start_time_seconds" in found and "hardcore_snapshot_bytes" in found
    return found if told and found["hardcore_core_epoch"] == epoch else {}
