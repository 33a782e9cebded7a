"""A demo breaks its own core from a page, through the same doors as everything; nothing else ever does."""

import subprocess
import sys

from tests.integration.conftest import MakeHouse
from tests.integration.house import START_S


def test_a_demo_breaks_its_core_from_a_page_and_comes_back_with_its_entries(new_house: MakeHouse) -> None:
    house = new_house().up("--demo")
    assert f"{house.url}/__hc/demo" in house.said
    assert str(house.data) in house.said
    house.open_accounts()
    assert house.book("before").status == 201
    before = house.status()["core"]["epoch"]
    answer = house.ask("POST", "/__hc/drill/crash", b"")
    assert (answer.status, answer.body["fault"]) == (202, "crash")
    assert house.book("after").status == 201  # held meanwhile, and answered once
    assert house.running()["core"]["epoch"] == before + 1
    assert sorted(house.booked()) == ["after", "before"]
    assert house.closed(1)["diagnosis"] == "CRASHED"


def test_a_ledger_that_is_no_demo_has_no_door_for_drills_whatever_a_shell_has_left_over(
    new_house: MakeHouse,
) -> None:
    house = new_house()
    command = [sys.executable, "-m", "hardcore.cli", "--data", str(house.data), "up", "--port", "0"]
    house.begin_as(["env", "HARDCORE_DEMO=1", *command])
    house.running()
    for path in ("/__hc/demo", "/__hc/demo.js"):
        assert house.ask("GET", path).status == 404
    assert house.ask("POST", "/__hc/drill/crash", b"").status == 404


def test_a_ledger_that_runs_is_not_made_a_demo_behind_its_back(new_house: MakeHouse) -> None:
    house = new_house()
    house.up_unproven()
    launcher = house.hit("launcher")
    assert house.launcher is not None
    house.launcher.wait(START_S)
    assert launcher.gone
    refused: subprocess.Popen[bytes] = house.begin("--demo")
    assert refused.wait(START_S) == 1
    assert "--demo" in house.said
    assert house.ask("POST", "/__hc/drill/crash", b"").status == 404
    assert house.cli("down").code == 0
