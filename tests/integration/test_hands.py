"""The hands when something small fails them: the deed is done all the same, once, and the guard can still end."""

import os
import signal
import subprocess
import sys
from pathlib import Path

from tests.integration.conftest import MakeHouse
from tests.integration.house import START_S, House
from tests.waiting import until

#: A sentinel without a launcher; it makes its listener itself. `%s`: what is different about it.
SENTINEL = """
import socket, sys
from hardcore import executor, gatekeeper, reporting, runtime
from hardcore.host.lives import Life
%s
listener = socket.create_server(("127.0.0.1", 0))
url = "http://127.0.0.1:%%d" %% listener.getsockname()[1]
sys.argv = ["runtime", "--data", sys.argv[1], "--listen-fd", str(listener.fileno()), "--url", url]
code = runtime.main()
sys.stderr.flush()
runtime.os._exit(code)
"""
BLIND = (
    SENTINEL
    % """
def look(self):
    raise RuntimeError("no eyes")
Life.look = look
"""
)
DEAF = """
import pathlib, signal, time
signal.signal(signal.SIGTERM, signal.SIG_IGN)
(pathlib.Path(__file__).parent / "deaf").touch()
time.sleep(600)
"""
HASTY = SENTINEL % "reporting.REPORT_S = 0.5; executor.FINISH_S = gatekeeper.MAKING_S = 1.0"


def spoil_hints(house: House) -> Path:
    """Nothing can be put in the hint's place any more, as on a full run folder."""
    switch = house.folders.switch
    switch.unlink(missing_ok=True)
    switch.mkdir()
    (switch / "taken").touch()
    return switch


def counted(house: House, mark: str) -> int:
    return sum(mark in line for line in house.processes().values())


def replaced(house: House, who: str) -> None:
    old = house.hit(who)
    house.until(lambda s: s[who]["pid"] not in {None, old.pid}, f"another {who}")


def test_a_frozen_core_is_killed_although_no_hint_can_be_written(new_house: MakeHouse) -> None:
    house = new_house().up()
    spoil_hints(house)
    core = house.hit("core", signal.SIGSTOP)
    story = house.closed(1)
    assert story["outcome"] == "recovered"
    assert core.gone
    house.running()
    assert counted(house, "-m core serve") == 1
    assert house.cli("down").code == 0
    until(lambda: not house.processes(), "everything to be stopped")


def test_one_core_and_one_gateway_are_made_although_no_hint_can_be_written(new_house: MakeHouse) -> None:
    house = new_house().up()
    spoil_hints(house)
    for who in ("core", "gateway"):
        replaced(house, who)
    house.running()
    assert counted(house, "-m core serve") == 1
    assert counted(house, "-m hardcore.crisis") == 1
    house.open_accounts()
    assert house.book("without-a-hint").status == 201


def test_a_log_that_takes_nothing_stops_neither_recovery_nor_the_end(new_house: MakeHouse) -> None:
    house = new_house().up()
    log = house.folders.logs / "sentinel.log"
    log.unlink()
    os.mkfifo(log)
    for number in (1, 2):
        house.hit("core")
        assert house.closed(number)["outcome"] == "recovered"
        house.running()
    assert house.cli("down").code == 0
    until(lambda: not house.processes(), "everything to be stopped")


def test_a_watch_that_ends_by_a_bug_ends_the_guard_and_the_next_one_takes_over(new_house: MakeHouse) -> None:
    house = new_house()
    blind = house.begin_as([sys.executable, "-c", BLIND, str(house.data)])
    assert blind.wait(START_S) == 70
    assert "no eyes" in house.said
    house.up()
    assert counted(house, "-m core serve") in {1, 2}, "the core, and perhaps its spare"


def test_a_hand_that_hangs_holds_neither_the_recovery_nor_the_end_up(new_house: MakeHouse) -> None:
    house = new_house()
    sentinel = house.begin_as([sys.executable, "-c", HASTY, str(house.data)])
    house.running()
    log = house.folders.logs / "gateway.log"
    log.unlink()
    os.mkfifo(log)  # opening it never returns
    gateway = house.hit("gateway")
    house.until(lambda s: s["gateway"]["pid"] is None, "the gateway to be gone")
    core = house.hit("core")
    house.until(lambda s: s["core"]["ready"] and s["core"]["pid"] != core.pid, "another core")
    assert gateway.gone
    sentinel.send_signal(signal.SIGTERM)
    assert sentinel.wait(START_S) == 0
    until(lambda: not house.processes(), "everything to be stopped")


def test_a_report_that_hangs_is_ended_and_the_guard_ends_too(new_house: MakeHouse) -> None:
    house = new_house()
    house.data.mkdir()
    nice = house.data / "bin" / "nice"  # what a report is begun with
    nice.parent.mkdir()
    nice.write_text("#!/bin/sh\nexec sleep 600\n")
    nice.chmod(0o700)
    path = f"PATH={nice.parent}:{os.environ['PATH']}"
    sentinel = house.begin_as(["env", path, sys.executable, "-c", HASTY, str(house.data)])
    house.running()
    house.hit("core")
    hanging = house.hold_pid(until(lambda: of(house, "sleep 600"), "the report to hang"))
    until(lambda: hanging.gone, "the report to be ended")
    house.hit("core")
    house.until(lambda s: s["core"]["ready"] and of(house, "sleep 600"), "the next report to hang")
    sentinel.send_signal(signal.SIGTERM)
    assert sentinel.wait(START_S) == 0
    until(lambda: not house.processes(), "everything to be stopped")


def test_a_gateway_that_an_earlier_guard_left_and_that_never_leaves_is_ended(new_house: MakeHouse) -> None:
    house = new_house()
    first = house.begin_as([sys.executable, "-c", HASTY, str(house.data)])
    house.running()
    deaf = house.data / "deaf.py"  # what an older gateway looks like that never leaves
    deaf.write_text(DEAF)
    mark = {"HARDCORE_GATEWAY": str(house.folders.run)}
    with subprocess.Popen([sys.executable, str(deaf)], env=house.environment(**mark)) as older:
        until((house.data / "deaf").exists, "it to hear nothing")
        first.kill()
        first.wait(START_S)
        house.up()
        assert older.wait(START_S) == -signal.SIGKILL


def of(house: House, mark: str) -> int:
    return next((pid for pid, line in house.processes().items() if mark in line), 0)
