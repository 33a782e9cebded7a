"""The spare: it appears, takes over from whatever death, weakens nothing, and is never more than one."""

import signal
from pathlib import Path
from typing import Any

import pytest

from tests.integration.clients import assert_exactly_once, at_work
from tests.integration.conftest import MakeHouse
from tests.integration.house import WITH_SPARE, House
from tests.waiting import until

#: A spare that dies is followed by another after a pause, and no more often than this is tried.
SPARES_TRIED = 3


def spare_of(house: House, but: int = 0) -> int:
    """Wait for a spare of another number than this; return its own."""

    def there(status: dict[str, Any]) -> bool:
        return bool(status["spare"] and status["spare"]["pid"] not in {None, but})

    return int(house.until(there, "another spare")["spare"]["pid"])


def cores(house: House) -> list[int]:
    """The living cores of this house, whoever they are: by what their environment names."""
    return [pid for pid in house.processes() if "HARDCORE_RECORDER=" in environment(pid)]


def environment(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/environ").read_text("utf-8", "replace")
    except OSError:
        return ""


@pytest.mark.parametrize("number", [signal.SIGSEGV, signal.SIGSTOP])
def test_whatever_ends_a_core_its_spare_is_the_next_one_and_another_spare_comes(
    new_house: MakeHouse, number: int
) -> None:
    house = new_house(**WITH_SPARE).up()
    before = house.spared()
    house.open_accounts()
    with at_work(house, 2, f"by{number}", patient=False) as clients:
        until(lambda: len(clients.told) > 10, "the load to run")
        house.hit("core", number)
        after = house.until(lambda s: s["core"]["epoch"] == before["core"]["epoch"] + 1, "the spare to serve")
        told = len(clients.told)
        until(lambda: len(clients.told) > told + 10, "answers of the next core")
    assert after["core"]["pid"] == before["spare"]["pid"]
    refused = [told for told in clients.told if told.status != 201]
    # A fatal signal of its own makes suspects of the commands that it died in: those are looked up, and never run.
    suspects = refused if number == signal.SIGSEGV else []
    assert refused == suspects, "each had a key: it was sent again"
    assert {(told.status, told.outcome) for told in suspects} <= {(503, "not_done")}
    assert_exactly_once(house, clients)
    story = house.closed(1)
    assert (story["outcome"], story["proof"]["kind"]) == ("recovered", "witness")
    assert house.spared()["spare"]["pid"] not in {before["spare"]["pid"], before["core"]["pid"]}


def test_a_spare_that_is_stopped_takes_nothing_over_and_the_cold_way_is_taken(new_house: MakeHouse) -> None:
    house = new_house(**WITH_SPARE).up()
    before = house.spared()
    stopped = house.hold_pid(before["spare"]["pid"])
    stopped.hit(signal.SIGSTOP)
    house.hit("core")
    after = house.until(lambda s: s["core"]["ready"] and s["core"]["pid"] != before["core"]["pid"], "a core")
    assert after["core"]["pid"] != stopped.pid
    assert after["core"]["epoch"] == before["core"]["epoch"] + 1, "one that did not take over raised nothing"
    until(lambda: stopped.gone, "the sick spare to be ended")
    assert house.spared()["spare"]["pid"] != stopped.pid


def test_spares_that_die_again_and_again_are_given_up_and_nobody_who_serves_is_touched(
    new_house: MakeHouse,
) -> None:
    house = new_house(**WITH_SPARE).up()
    before = house.spared()
    last = 0
    for _ in range(SPARES_TRIED):
        last = spare_of(house, but=last)
        house.hold_pid(last).hit(signal.SIGKILL)
    degraded = house.until(lambda s: s["state"] == "DEGRADED" and s["spare"] is None, "no spare to be tried")
    assert degraded["spare_lack"] == "died"
    assert (degraded["core"]["pid"], degraded["core"]["epoch"]) == (
        before["core"]["pid"],
        before["core"]["epoch"],
    )
    assert degraded["incident"] is None
    house.hit("core")
    after = house.until(lambda s: s["core"]["ready"] and s["core"]["pid"] != before["core"]["pid"], "a core")
    assert after["core"]["epoch"] == before["core"]["epoch"] + 1


def test_without_a_spare_all_is_as_it_was(new_house: MakeHouse) -> None:
    house = new_house(spare=False).up()
    before = house.running()
    house.hit("core")
    after = house.until(lambda s: s["core"]["ready"] and s["core"]["pid"] != before["core"]["pid"], "a core")
    assert after["core"]["epoch"] == before["core"]["epoch"] + 1
    assert after["spare"] is None
    assert after["spare_off"], "and why is said"
    assert house.closed(1)["outcome"] == "recovered"


def test_there_are_never_more_cores_than_one_that_serves_and_one_that_waits(new_house: MakeHouse) -> None:
    house = new_house(**WITH_SPARE).up()
    most = 0
    for number in range(3):
        before = house.spared()
        if number % 2:
            house.order("restart")
        else:
            house.hit("core")

        def replaced(old: int = before["core"]["pid"]) -> bool:
            nonlocal most
            most = max(most, len(cores(house)))
            status = house.status()
            spare = status.get("spare")
            return bool(spare and spare["ready"] and status["core"]["pid"] not in {None, old})

        until(replaced, "the next core and the next spare")
    assert most == 2


def test_nothing_is_left_when_all_is_stopped(new_house: MakeHouse) -> None:
    house = new_house(**WITH_SPARE).up()
    house.spared()
    assert house.cli("down").code == 0
    assert house.launcher is not None
    assert house.launcher.wait(30) == 0
    assert house.processes() == {}, "the spare is gone with the core"
    pages = [path for path in house.folders.run.glob("recorder-*") if not path.suffix]
    assert len(pages) <= 1, "what is kept is the page of a core that wrote"


def test_a_core_that_can_not_be_killed_is_fenced_off_and_its_spare_serves(new_house: MakeHouse) -> None:
    house = new_house(**WITH_SPARE).up()
    before = house.spared()
    house.open_accounts()
    old = house.hold("core")
    freezer = Path("/sys/fs/cgroup/freezer") / f"hardcore-test-{old.pid}"
    try:
        freezer.mkdir()
        (freezer / "cgroup.procs").write_text(f"{old.pid}\n")
    except OSError as error:
        if freezer.exists():
            freezer.rmdir()
        pytest.skip(f"nothing can be frozen here: {error.strerror}")
    try:
        (freezer / "freezer.state").write_text("FROZEN\n")
        until(lambda: (freezer / "freezer.state").read_text() == "FROZEN\n", "the core to be frozen")
        house.order("restart", hard=True)
        after = house.until(lambda s: s["core"]["epoch"] == before["core"]["epoch"] + 1, "the spare to serve")
        assert after["core"]["pid"] == before["spare"]["pid"]
        assert house.book("behind-the-fence").status == 201
        shown = house.until(lambda s: s["state"] == "DEGRADED", "it to be told who is behind the fence")
        assert shown["core"]["old_pid"] == old.pid
        assert not old.gone
    finally:
        (freezer / "freezer.state").write_text("THAWED\n")
        until(lambda: old.gone, "the old core to be gone")
        freezer.rmdir()
    house.until(lambda s: s["state"] == "OPERATIONAL" and s["core"]["old_pid"] is None, "all to be well")
    assert house.booked() == ["behind-the-fence"]
    house.spared()
