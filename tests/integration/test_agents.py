"""Who watches the watcher: without a launcher, and where the sentinel stands still, the agents bring another."""

import json
import os
import select
import signal
from pathlib import Path
from typing import Any

from hardcore.host import files
from hardcore.host.processes import start_of
from tests.integration.clients import assert_exactly_once, at_work
from tests.integration.conftest import MakeHouse
from tests.integration.house import START_S, House
from tests.waiting import until


def alone(house: House) -> None:
    """Take the launcher away: who is left is nobody's but init's."""
    assert house.launcher is not None
    house.launcher.kill()
    house.launcher.wait(START_S)


def impatient(house: House, **changes: Any) -> None:
    """Have the agents wait less for a sentinel that stands still; the next sentinel leaves its own word."""
    path = house.folders.agents
    files.write_json(path, {**json.loads(path.read_text("utf-8")), "stale_ms": 400, **changes}, durable=False)


def another(house: House, old: int) -> dict[str, Any]:
    """Wait until the next guard answers at the door, has its gateway, and has told of the loss."""
    house.until(lambda s: s["sentinel"]["pid"] not in {None, old}, "another sentinel")
    return house.running()


def test_without_a_launcher_an_agent_brings_the_next_sentinel_and_nobody_waits(new_house: MakeHouse) -> None:
    house = new_house().up()
    house.open_accounts()
    before = house.status()
    alone(house)
    sentinel = house.hold("sentinel")
    with at_work(house, 2, "agents") as clients:
        until(lambda: len(clients.told) > 10, "the load to run")
        sentinel.hit(signal.SIGKILL)
        after = another(house, sentinel.pid)
        told = len(clients.told)
        until(lambda: len(clients.told) > told + 10, "answers under the new guard")
    assert {(told.status, told.tries) for told in clients.told} == {(201, 1)}
    assert_exactly_once(house, clients)
    for who in ("core", "gateway"):
        assert after[who]["pid"] == before[who]["pid"]
    assert after["core"]["epoch"] == before["core"]["epoch"]
    story = house.closed(1)
    assert (story["diagnosis"], story["outcome"], story["outage_ms"]) == ("SENTINEL_LOST", "recovered", None)

    # One that stands still is ended and followed as well, though nothing says so but its page and the kernel.
    sentinel = house.hold("sentinel")
    impatient(house)
    sentinel.hit(signal.SIGSTOP)
    after = another(house, sentinel.pid)
    assert sentinel.gone
    assert after["core"]["pid"] == before["core"]["pid"]
    story = house.closed(2)
    facts = (house.folders.incidents / story["id"] / "incident.json").read_text("utf-8")
    assert story["diagnosis"] == "SENTINEL_LOST"
    assert "nobody watched for" in facts
    assert "stood still, and was ended" in facts
    assert house.cli("down").code == 0
    until(lambda: not house.processes(), "everything to be stopped")


def test_the_sentinel_that_a_core_has_brought_outlives_that_core(new_house: MakeHouse) -> None:
    house = new_house().up()
    house.open_accounts()
    alone(house)
    core, gateway, sentinel = (house.hold(who) for who in ("core", "gateway", "sentinel"))
    gateway.hit(signal.SIGSTOP)  # its agent sees nothing
    sentinel.hit(signal.SIGKILL)
    until(lambda: len(acts(house, "core")) == 1, "the core's agent to act", START_S)
    gateway.hit(signal.SIGKILL)
    another(house, sentinel.pid)
    new = house.hold("sentinel")
    assert os.getsid(new.pid) != os.getsid(core.pid)
    assert parent(new.pid) != core.pid
    core.hit(signal.SIGKILL)
    house.until(lambda s: s["core"]["pid"] not in {None, core.pid}, "another core")
    house.running()
    assert not new.gone
    assert house.book("after-all-of-it").status == 201


def test_where_nothing_is_wanted_no_agent_brings_anything_back(new_house: MakeHouse) -> None:
    house = new_house().up()
    alone(house)
    sentinel = house.hold("sentinel")
    sentinel.hit(signal.SIGSTOP)  # not sooner than the operator's word is there
    wanted = house.folders.state / "wanted.json"
    wanted.write_text(wanted.read_text("utf-8").replace("UP", "DOWN"), "utf-8")
    impatient(house, after_ms=100)
    assert not select.select([sentinel.pidfd], [], [], 2)[0], "it is not ended"
    done = house.cli("down")
    assert done.code == 0, done
    assert sentinel.gone, "the operator's own word ends it, once it is proven to stand still"
    assert not house.processes()
    assert '"DOWN"' in wanted.read_text("utf-8")
    assert not acts(house, "core")
    assert not acts(house, "gateway")


def test_a_launcher_goes_on_with_the_sentinel_that_an_agent_has_brought(new_house: MakeHouse) -> None:
    house = new_house().up()
    assert house.launcher is not None
    core, sentinel = house.hold("core"), house.hold("sentinel")
    launcher = house.hold_pid(house.launcher.pid)
    launcher.hit(signal.SIGSTOP)
    sentinel.hit(signal.SIGKILL)
    house.until(lambda s: s["sentinel"]["pid"] not in {None, sentinel.pid}, "another sentinel")
    launcher.hit(signal.SIGCONT)
    house.running()
    new = house.hold("sentinel")
    assert new.pid != sentinel.pid
    assert house.status()["core"]["pid"] == core.pid
    house.launcher.send_signal(signal.SIGINT)
    assert house.launcher.wait(START_S) == 0, "it passes the stop on, and ends with it"
    until(lambda: not house.processes(), "everything to be stopped")


def test_an_up_that_comes_after_both_are_gone_goes_on_with_what_an_agent_brings(new_house: MakeHouse) -> None:
    house = new_house().up()
    before, sentinel = house.status(), house.hold("sentinel")
    alone(house)
    sentinel.hit(signal.SIGKILL)
    house.up()
    assert before["url"] in house.said, "there is one address, and somebody answers at it"
    assert house.status()["core"]["pid"] == before["core"]["pid"]
    assert house.closed(1)["diagnosis"] == "SENTINEL_LOST"


def test_a_stop_is_gone_on_with_when_a_sentinel_that_is_nobodys_child_dies_in_it(
    new_house: MakeHouse,
) -> None:
    house = new_house().up()
    alone(house)
    house.up()  # a launcher that found its sentinel there
    assert house.launcher is not None
    core, sentinel = house.hold("core"), house.hold("sentinel")
    core.hit(signal.SIGSTOP)  # so that the stop takes a moment
    assert house.order("down")["ok"]
    sentinel.hit(signal.SIGKILL)
    assert house.launcher.wait(START_S) == 0
    assert core.gone
    assert not house.processes()


def test_a_third_sentinel_and_a_strange_page_change_nothing(house: House) -> None:
    before = house.status()
    word = json.loads(house.folders.agents.read_text("utf-8"))
    argv = [part for part in word["argv"][5:] if part != "{listen_fd}"]
    at = argv.index("--listen-fd") + 1
    third = house.folders.run / "third.out"
    with third.open("wb") as out:
        pid = os.posix_spawn(
            argv[0],
            [*argv[:at], "0", *argv[at:]],
            word["environment"],
            file_actions=[(os.POSIX_SPAWN_DUP2, out.fileno(), 2)],
        )
    assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 3
    page = house.folders.sentinel_page.read_bytes()
    assert int.from_bytes(page[16:24], "little") == before["sentinel"]["pid"]
    assert int.from_bytes(page[24:32], "little") == start_of(before["sentinel"]["pid"])
    after = house.running()
    for who in ("sentinel", "core", "gateway"):
        assert after[who]["pid"] == before[who]["pid"]


def test_after_all_three_were_killed_at_once_the_launcher_begins_anew(house: House) -> None:
    assert house.book("before-all-three").status == 201
    before = house.status()
    victims = [house.hold(who) for who in ("sentinel", "gateway", "core")]
    for victim in victims:
        victim.hit(signal.SIGKILL)
    until(lambda: all(victim.gone for victim in victims), "them to be gone")
    house.until(lambda s: s["core"]["ready"] and s["core"]["pid"] != before["core"]["pid"], "another core")
    after = house.running()
    assert after["launcher"]["pid"] == before["launcher"]["pid"]
    assert after["core"]["epoch"] > before["core"]["epoch"]
    assert house.booked().count("before-all-three") == 1


def test_the_drill_of_the_guards_own_death_is_kept(house: House) -> None:
    before = house.status()
    done = house.cli("drill", "sentinel", "--json")
    assert done.code == 0, done
    story = done.told["story"]
    assert (story["diagnosis"], story["outcome"]) == ("SENTINEL_LOST", "recovered")
    after = house.running()
    assert after["sentinel"]["pid"] != before["sentinel"]["pid"]
    for who in ("launcher", "core", "gateway"):
        assert after[who]["pid"] == before[who]["pid"]


def acts(house: House, side: str) -> list[int]:
    found = files.read_json(house.folders.run / f"agent-budget-{side}.json").get("acts_ns")
    return found if isinstance(found, list) else []


def parent(pid: int) -> int:
    return int(Path(f"/proc/{pid}/stat").read_text("utf-8").rpartition(")")[2].split()[1])
