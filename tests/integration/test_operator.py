"""What the operator asks for holds, at any moment, and costs nobody a request."""

import signal
import subprocess

import pytest

from hardcore.snapshot.writer import RECORDING
from tests.integration.clients import assert_exactly_once, at_work
from tests.integration.conftest import MakeHouse
from tests.integration.house import START_S, House
from tests.waiting import until


def wanted(house: House) -> str:
    return str(house.cli("--json", "status").told["wanted"])


def ended(house: House) -> int:
    """Wait for `up` to end; nothing of the house may live after it."""
    assert house.launcher is not None
    code = house.launcher.wait(START_S)
    until(lambda: not house.processes(), "everything to be stopped")
    return code


@pytest.mark.parametrize("words", [(), ("--hard",)])
def test_a_restart_loses_no_request_and_is_not_counted(house: House, words: tuple[str, ...]) -> None:
    count, before = len(house.incidents()), house.status()
    with at_work(house, 3, f"restart{len(words)}", patient=False) as clients:
        until(lambda: len(clients.told) > 20, "the load to run")
        done = house.cli("--json", "restart", "--reason", "새 버전을 켜려고", *words)
        told = len(clients.told)
        until(lambda: len(clients.told) > told + 20, "answers of the new core")
    assert done.code == 0, done
    story = house.closed(count + 1)
    assert story["id"] == done.told["incident"]
    assert (story["diagnosis"], story["outcome"], story["planned"]) == ("OPERATOR", "recovered", True)
    assert story["reason"] == "새 버전을 켜려고"
    after = house.running()
    assert after["core"]["pid"] != before["core"]["pid"]
    assert after["core"]["epoch"] == before["core"]["epoch"] + 1
    assert after["budget"]["used"] <= before["budget"]["used"]
    assert_exactly_once(house, clients)
    if not words:
        assert {told.status for told in clients.told} == {201}, clients.told


def test_a_restart_of_a_frozen_core_comes_back(house: House) -> None:
    count = len(house.incidents())
    old = house.hit("core", signal.SIGSTOP)
    assert house.cli("restart").code == 0
    assert old.gone
    made = len(house.incidents())
    assert made > count  # one more where the guard saw the freeze before the word had come
    assert house.closed(made)["outcome"] == "recovered"
    assert house.book("after-the-frozen-restart").status == 201


def test_a_core_that_starts_is_neither_the_one_that_serves_nor_called_old(house: House) -> None:
    count = len(house.incidents())
    house.hit("core")
    status = house.until(lambda s: s["phase"] in {"STARTING", "PROVING"}, "the next core to start")
    assert (status["core"]["pid"], status["core"]["old_pid"]) == (None, None)
    house.closed(count + 1)


def test_a_core_that_has_committed_nothing_yet_tells_the_head_that_it_proved(house: House) -> None:
    house.open_accounts()
    assert house.book("before-the-head-is-asked").status == 201
    head = house.status()["core"]["last_seq"]
    assert house.cli("restart").code == 0
    assert house.status()["core"]["last_seq"] == head
    assert house.book("after-the-head-was-asked").status == 201
    assert house.status()["core"]["last_seq"] == head + 1


def test_open_files_stay_known_between_two_counts(house: House) -> None:
    house.until(lambda s: s["core"]["fds"], "the core's files to be counted")
    seen = [house.status()["core"]["fds"] for _ in range(100)]
    assert all(seen), seen


def test_the_launcher_is_the_one_that_lives(new_house: MakeHouse) -> None:
    house = new_house().up()
    assert house.launcher is not None
    assert house.status()["launcher"]["pid"] == house.launcher.pid
    house.launcher.kill()
    house.launcher.wait()
    assert house.status()["launcher"]["pid"] is None
    house.begin()
    assert (
        house.until(lambda s: s["launcher"]["pid"], "it to attach")["launcher"]["pid"] == house.launcher.pid
    )
    assert house.cli("down").code == 0


def test_a_hard_restart_while_the_next_core_starts_still_ends_with_one_core(house: House) -> None:
    count = len(house.incidents())
    house.hit("core")
    house.until(lambda s: s["phase"] in {"STARTING", "PROVING"}, "the next core to start")
    house.order("restart", hard=True)
    house.closed(count + 1)
    cores = [line for line in house.processes().values() if "-m core serve" in line]
    assert len(cores) == 1, cores
    assert house.book("after-two-restarts").status == 201


def test_resume_changes_nothing_where_nothing_has_failed(house: House) -> None:
    before = house.status()
    assert house.cli("resume").code == 0
    assert house.status()["core"]["pid"] == before["core"]["pid"]


def test_down_stops_everything_and_stays_down_until_up(new_house: MakeHouse) -> None:
    house = new_house().up()
    house.open_accounts()
    assert house.book("before-down").status == 201
    assert house.cli("down").code == 0
    assert ended(house) == 0
    stopped = house.cli("--json", "status")
    assert (stopped.code, stopped.told["state"], stopped.told["wanted"]) == (4, "UNKNOWN", "DOWN")
    assert house.cli("down").code == 0
    house.up()
    assert wanted(house) == "UP"
    assert house.booked() == ["before-down"]
    assert house.status()["core"]["epoch"] == 2


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_to_up_stops_everything_and_leaves_it_wanted(
    new_house: MakeHouse, number: signal.Signals
) -> None:
    house = new_house().up()
    house.open_accounts()
    assert house.launcher is not None
    house.launcher.send_signal(number)
    assert ended(house) == 0
    assert wanted(house) == "UP"
    assert not house.incidents()


def test_a_second_ctrl_c_changes_nothing(new_house: MakeHouse) -> None:
    house = new_house().up()
    assert house.launcher is not None
    house.launcher.send_signal(signal.SIGINT)
    house.launcher.send_signal(signal.SIGINT)
    assert ended(house) == 0


def test_ctrl_c_at_once_stops_what_has_hardly_begun(new_house: MakeHouse) -> None:
    house = new_house()
    launcher = house.begin("--policy", str(house.settle_policy()))
    until(lambda: "http://" in house.said, "the URL to be printed")
    until(lambda: any("launcher.py" in line for line in house.processes().values()), "the launcher")
    launcher.send_signal(signal.SIGINT)
    assert ended(house) == 0
    assert "Traceback" not in house.said


def test_down_in_the_middle_of_a_recovery_is_not_forgotten(new_house: MakeHouse) -> None:
    house = new_house().up()
    house.hit("core")
    house.until(lambda s: s["phase"] in {"STARTING", "PROVING"}, "the next core to start")
    assert house.cli("down").code == 0
    assert ended(house) == 0
    assert wanted(house) == "DOWN"


def test_down_while_the_core_is_frozen_stops_it(new_house: MakeHouse) -> None:
    house = new_house().up()
    house.hit("core", signal.SIGSTOP)
    assert house.cli("down").code == 0
    assert ended(house) == 0


def test_a_request_that_waits_when_everything_is_stopped_is_told_that_it_was_not_done(
    new_house: MakeHouse,
) -> None:
    house = new_house(backoff_initial_ms=20_000, backoff_max_ms=20_000, probation_ms=30_000).up_unproven()
    house.open_accounts()
    house.hit("core")
    house.until(lambda s: s["phase"] == "BACKOFF", "the long pause")
    with at_work(house, 1, "waiting", patient=False) as clients:
        house.until(lambda s: s["gateway"]["held_requests"] == 1, "the request to be held")
        clients.stop.set()
        down = house.cli("down")
    assert down.code == 0
    assert [(told.status, told.outcome) for told in clients.told] == [(503, "not_done")]
    ended(house)
    house.policy = {}
    house.settle_policy()
    house.up("--policy", str(house.settle_policy()))
    assert house.booked() == []


def test_a_second_up_is_refused_and_changes_nothing(house: House) -> None:
    before = house.status()
    second = house.cli("up", "--port", "0")
    assert second.code == 1
    assert house.url in second.err
    assert house.status()["core"]["pid"] == before["core"]["pid"]
    assert isinstance(house.launcher, subprocess.Popen)
    assert house.launcher.poll() is None


def test_there_is_one_drill_at_a_time(house: House) -> None:
    count = len(house.incidents())
    house.running()
    assert house.order("drill", fault="freeze", yes=True)["ok"]
    second = house.order("drill", fault="spin", yes=True)
    assert (second["ok"], second["code"]) in {(False, "drill-under-way"), (False, "not-running")}
    story = house.closed(count + 1)
    assert (story["diagnosis"], story["drill"]) == ("FROZEN", "freeze")
    house.running()


@pytest.mark.in_a_file  # whose lock is held
def test_a_trouble_that_is_still_open_is_made_no_worse_by_a_drill_and_does_not_keep_a_restart_waiting(
    new_house: MakeHouse,
) -> None:
    house = new_house(clean_after_ms=3_600_000).up()
    house.open_accounts()
    assert house.order("drill", fault="dblock", yes=True)["ok"]
    assert house.order("drill", fault="crash", yes=True)["code"] == "drill-under-way"
    incident = house.until(lambda status: status["incident"], "the lock to be noticed")["incident"]
    second = house.cli("--lang", "ko", "drill", "crash", "--yes")
    assert (second.code, incident in second.err) == (1, True)
    before = house.status()["core"]["epoch"]
    assert house.cli("restart").code == 0
    assert house.status()["core"]["epoch"] > before


def test_while_only_reads_are_served_there_is_no_drill(new_house: MakeHouse) -> None:
    house = new_house().up()
    house.open_accounts()
    assert house.order("drill", fault="diskfull", yes=True)["ok"]
    house.until(lambda status: status["safe"], "reading only")
    refused = house.order("drill", fault="crash", yes=True)
    assert refused["code"] in {"reads-only", "incident-open"}
    house.running()


def test_a_restart_that_ends_without_a_serving_core_is_no_success(new_house: MakeHouse) -> None:
    house = new_house().up()
    assert house.launcher is not None
    ledger = house.data / "ledger.db"
    house.hold("core").hit(signal.SIGSTOP)
    for name in ("ledger.db-wal", "ledger.db-shm"):
        ledger.with_name(name).unlink(missing_ok=True)
    ledger.write_bytes(b"this is no ledger" * 1000)
    done = house.cli("restart", "--hard")
    assert (done.code, "A new core serves" in done.out) == (1, False), done


def test_a_changed_policy_file_is_soon_in_force_and_a_faulty_one_is_not(house: House) -> None:
    file = house.folders.policy
    before = file.read_text("utf-8")

    def shows(clean_after_ms: int) -> bool:
        shown = house.cli("policy", "show")
        return (shown.told["clean_after_ms"], shown.err) == (clean_after_ms, "")

    assert shows(500)
    try:
        file.write_text(before.replace('"clean_after_ms": 500', '"clean_after_ms": 777'), "utf-8")
        assert house.cli("policy", "show", "--file").told["clean_after_ms"] == 777
        until(lambda: shows(777), "the changed file to be taken")
        file.write_text("{ half a policy", "utf-8")
        kept = house.cli("policy", "show")
        assert (kept.told["clean_after_ms"], "last good one" in kept.err) == (777, True)
    finally:
        file.write_text(before, "utf-8")
    until(lambda: shows(500), "the file as it was to be taken")


def test_a_replay_takes_what_a_list_prints_and_says_truly_what_is_not_there(new_house: MakeHouse) -> None:
    house = new_house().up()
    house.hit("core")
    incident = house.closed(1)["id"]
    recording = house.folders.incidents / incident / RECORDING
    until(lambda: recording.exists() and house.cli("replay", incident[:11]).code == 0, "the recording")
    assert house.cli("--json", "replay", incident[:11]).told["incident"] == incident
    nothing = house.cli("--lang", "ko", "replay", "nix")
    assert (nothing.code, "이런 사건은 없어요" in nothing.err) == (1, True)
    recording.write_bytes(recording.read_bytes()[:100])
    damaged = house.cli("replay", incident)
    assert (damaged.code, "damaged" in damaged.err, ".." in damaged.err) == (1, True, False)
    recording.unlink()
    assert "no recording" in house.cli("replay", incident).err
