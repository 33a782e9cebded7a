"""`make demo`: the sample household is in the ledger once, however often and in whichever language it is started."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.integration.house import START_S, House
from tests.waiting import until


@pytest.fixture
def demo_house(tmp_path_factory: pytest.TempPathFactory) -> Iterator[House]:
    house = House(tmp_path_factory.mktemp("demo") / "data")
    yield house
    house.end()


def begin(house: House, lang: str) -> str:
    """Start the demo as its make target does; return what it has printed when all is ready."""
    house.begin_as(
        [sys.executable, "-m", "examples.demo", "--data", str(house.data), "--port", "0", "--lang", lang]
    )
    assert house.launcher is not None
    launcher = house.launcher
    until(
        lambda: "Ctrl-C" in house.said.partition("/__hc/demo\n")[2] or launcher.poll() is not None,
        "the demo to be ready",
        START_S,
    )
    assert launcher.poll() is None, house.said
    house.url = house.status()["url"]
    return house.said


def break_core(house: House) -> None:
    """Kill the core and wait until another one serves: the status may still name the dead one for a moment."""
    killed = house.hit("core").pid
    house.until(lambda status: status["core"]["pid"] != killed, "the death to be known")
    house.running()


def end(house: House) -> None:
    """End it as a service manager would."""
    assert house.launcher is not None
    house.launcher.terminate()
    assert house.launcher.wait(START_S) == 0


def test_a_year_is_in_the_ledger_once_and_a_core_that_is_broken_again_and_again_comes_back(
    demo_house: House,
) -> None:
    begin(demo_house, "ko")
    first = demo_house.booked()
    assert "월급" in first
    assert len(first) > 400
    assert demo_house.ask("GET", "/__hc/demo").status == 200
    assert demo_house.ask("GET", "/api/ledger/verify").body["ok"]
    end(demo_house)
    assert "its limit of restarts is set high" in begin(demo_house, "en")
    assert demo_house.booked() == first
    for _ in range(6):  # more than the five that a guard puts up with otherwise
        break_core(demo_house)
    end(demo_house)
    own = demo_house.settle_policy(max_restart_count=7).read_text("utf-8")
    demo_house.folders.policy.write_text(own, "utf-8")
    assert "its limit of restarts" not in begin(demo_house, "en")
    assert demo_house.folders.policy.read_text("utf-8") == own, "a policy of one's own stays"
    end(demo_house)


def test_a_folder_that_is_in_use_is_said_and_nothing_is_booked(demo_house: House, tmp_path: Path) -> None:
    demo_house.up()
    words = [sys.executable, "-m", "examples.demo", "--data", str(demo_house.data), "--port", "0"]
    done = subprocess.run(
        words, env=demo_house.environment(), capture_output=True, timeout=50, check=False, cwd=tmp_path
    )
    assert done.returncode != 0
    assert demo_house.booked() == []
