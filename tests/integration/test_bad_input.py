"""Bad input at every door: one clear sentence with the next step, the right code, no traceback, nothing lost."""

import json
import re
import socket
from contextlib import closing
from pathlib import Path

import pytest

from tests.integration.conftest import MakeHouse
from tests.integration.house import BANK, SALARY, Done, House, run_cli, transaction
from tests.waiting import until

KOREAN = re.compile("[가-힣]")
NO_INCIDENT = "0199a000-0000-7000-8000-00000000000b"


def plain(house: House, *words: str) -> Done:
    """Run a command without this house's data folder."""
    return run_cli(*words, env=house.environment())


def refusal(done: Done, code: int = 1) -> str:
    """A command that did nothing, and the sentence it said."""
    assert done.code == code, done
    assert done.err.strip(), done
    return done.err


# ---- up ----


def test_an_unknown_option_is_named(new_house: MakeHouse) -> None:
    assert "--colour" in refusal(new_house().cli("up", "--colour"), 2)


def test_a_port_that_is_taken_is_named_with_another_to_try(new_house: MakeHouse) -> None:
    house = new_house()
    with closing(socket.create_server(("127.0.0.1", 0))) as taken:
        port = taken.getsockname()[1]
        assert str(port) in refusal(house.cli("up", "--port", str(port)))
    assert house.cli("--json", "status").told["wanted"] == "UP"
    assert not house.processes()


@pytest.mark.parametrize("port", ["-1", "65536", "http"])
def test_a_port_that_is_none_is_refused(new_house: MakeHouse, port: str) -> None:
    assert "--port" in refusal(new_house().cli("up", "--port", port), 2)


def test_only_this_machine_is_served_until_there_is_a_password(new_house: MakeHouse) -> None:
    assert "passwd" in refusal(new_house().cli("up", "--host", "0.0.0.0"), 2)


@pytest.mark.parametrize(
    ("host", "shown"), [("127.0.0.2", "127.0.0.2"), ("0:0:0:0:0:0:0:1", "[::1]"), ("localhost", "localhost")]
)
def test_the_address_that_up_prints_is_answered(new_house: MakeHouse, host: str, shown: str) -> None:
    if ":" in host and not socket.has_dualstack_ipv6():
        pytest.skip("no IPv6 here")
    house = new_house().up("--host", host)
    assert house.url.startswith(f"http://{shown}:")
    assert house.ask("GET", "/api/ledger/accounts").status == 200


def test_a_data_folder_that_is_a_file_is_refused(new_house: MakeHouse) -> None:
    house = new_house()
    house.data.write_text("not a folder")
    assert "--data" in refusal(house.cli("up", "--port", "0"), 2)
    assert house.data.read_text() == "not a folder"


@pytest.mark.parametrize("place", ["/proc/nowhere", "/dev/null/data", "/tmp/" + "x" * 300])
def test_a_data_folder_that_can_not_be_made_is_refused(new_house: MakeHouse, place: str) -> None:
    assert "--data" in refusal(plain(new_house(), "--data", place, "up", "--port", "0"))


@pytest.mark.parametrize("place", ["/proc/nowhere", "/dev/null/data", "/tmp/" + "x" * 300])
@pytest.mark.parametrize("words", [("status",), ("incidents",), ("down",), ("verify",), ("restart",)])
def test_no_command_shows_a_traceback_for_a_strange_data_folder(
    new_house: MakeHouse, place: str, words: tuple[str, ...]
) -> None:
    assert plain(new_house(), "--data", place, *words).code in {0, 1, 4}


# ---- the policy ----


def test_a_faulty_policy_is_refused_with_its_lines_and_changes_nothing(new_house: MakeHouse) -> None:
    house = new_house()
    bad = house.data.parent / "bad.json"
    bad.write_text('{\n "version": 1,\n "probation_ms": "soon",\n "colour": 1\n}')
    said = refusal(house.cli("up", "--port", "0", "--policy", str(bad)))
    assert "line 3: probation_ms" in said
    assert "line 4: colour" in said
    assert not house.folders.policy.exists()


def test_a_policy_given_to_a_guard_that_lives_is_taken_by_it_and_said_to_be(new_house: MakeHouse) -> None:
    house = new_house().up()
    sentinel = house.hold("sentinel")
    same = str(house.settle_policy())
    new = house.data.parent / "new.json"
    new.write_text(house.settle_policy(drills=False).read_text())
    house.settle_policy()
    for policy, said in ((same, False), (str(new), True)):
        assert house.launcher is not None
        house.launcher.kill()
        house.launcher.wait()
        house.begin("--policy", policy)
        until(lambda: "http://" in house.said, "it to attach")
        assert (policy in house.said) is said
        until(lambda: any("launcher.py" in line for line in house.processes().values()), "the launcher")
    until(lambda: house.cli("policy", "show").told["drills"] is False, "the policy to be taken")
    assert house.status()["sentinel"]["pid"] == sentinel.pid
    assert "drills" in refusal(house.cli("drill", "crash", "--yes"))


def test_a_policy_file_that_is_not_there_is_named(new_house: MakeHouse) -> None:
    house = new_house()
    assert "missing.json" in refusal(house.cli("up", "--port", "0", "--policy", "missing.json"))
    assert "missing.json" in refusal(house.cli("policy", "check", "missing.json"))


def test_a_faulty_policy_in_the_data_folder_never_replaces_the_last_good_one(new_house: MakeHouse) -> None:
    house = new_house().up()
    assert house.cli("down").code == 0
    house.folders.policy.write_text("{ half a policy")
    house.up()
    assert "policy check" in house.said
    assert house.status()["budget"]["limit"] == 1000
    assert house.folders.policy.read_text() == "{ half a policy"


def test_a_faulty_policy_without_a_good_one_before_it_is_refused(new_house: MakeHouse) -> None:
    house = new_house()
    house.data.mkdir()
    house.folders.policy.write_text("{ half a policy")
    assert "line 1" in refusal(house.cli("up", "--port", "0"))


# ---- commands ----


@pytest.mark.parametrize(
    "words",
    [
        ("drill", "earthquake"),
        ("drill",),
        ("fly",),
        ("status", "--loud"),
        ("--lang", "xx", "status"),
        ("incidents", "show"),
        ("incidents", "export", "x"),
        ("policy",),
        ("policy", "check"),
    ],
)
def test_words_that_make_no_sense_are_a_usage_error(house: House, words: tuple[str, ...]) -> None:
    refusal(house.cli(*words), 2)


def test_an_incident_that_is_not_there_is_said_so(house: House) -> None:
    for words in ("show " + NO_INCIDENT, "show ../../etc", f"export {NO_INCIDENT} --out x.md"):
        refusal(house.cli("incidents", *words.split()))


def test_an_order_to_nobody_says_how_to_start(new_house: MakeHouse) -> None:
    house = new_house()
    for words in (("restart",), ("resume",), ("drill", "crash")):
        assert "hardcore up" in refusal(house.cli(*words))
    assert not house.data.exists()


def test_reading_commands_answer_with_no_data_at_all_and_make_none(new_house: MakeHouse) -> None:
    house = new_house()
    assert house.cli("--json", "status").told["state"] == "UNKNOWN"
    assert house.cli("--json", "incidents").told == []
    assert house.cli("down").code == 0
    refusal(house.cli("verify"))
    assert not house.data.exists()


def test_reading_commands_answer_with_everything_stopped(new_house: MakeHouse) -> None:
    house = new_house().up()
    house.open_accounts()
    house.hit("core")
    story = house.closed(1)
    url = house.url
    assert house.cli("down").code == 0
    status = house.cli("--json", "status")
    assert (status.code, status.told["state"], status.told["url"]) == (4, "UNKNOWN", url)
    assert status.told["last_incident"] == story["id"]
    assert [item["id"] for item in house.cli("--json", "incidents").told] == [story["id"]]
    assert house.cli("incidents", "show", story["id"][:18]).code == 0
    out = house.data.parent / "incident.md"
    assert house.cli("incidents", "export", story["id"], "--out", str(out)).code == 0
    assert story["id"] in out.read_text("utf-8")
    assert house.cli("--json", "verify").told["ok"]


def test_drills_that_the_policy_forbids_are_refused(new_house: MakeHouse) -> None:
    house = new_house(drills=False).up()
    pid = house.status()["core"]["pid"]
    assert "drills" in refusal(house.cli("drill", "crash", "--yes"))
    assert house.status()["core"]["pid"] == pid


def test_every_command_speaks_korean(house: House) -> None:
    for words in (
        ("status",),
        ("resume",),
        ("restart",),
        ("drill", "crash", "--yes"),
        ("incidents",),
        ("verify",),
        ("policy", "check", str(house.folders.policy)),
    ):
        done = house.cli("--lang", "ko", *words)
        assert done.code in {0, 3}, done
        assert KOREAN.search(done.out), done
        house.running()
    newest = house.incidents()[0]["id"]
    assert KOREAN.search(house.cli("incidents", "show", newest, env={"LANG": "ko_KR.UTF-8"}).out)
    for line in (f"incidents show {NO_INCIDENT}", "up", f"incidents export {NO_INCIDENT} --out x.md"):
        assert KOREAN.search(refusal(house.cli("--lang", "ko", *line.split())))


def test_json_is_one_value_on_standard_output(house: House) -> None:
    for words in (("status",), ("resume",), ("restart",), ("incidents",), ("verify",)):
        assert house.cli("--json", *words).told is not None
    refused = house.cli("--json", "incidents", "show", NO_INCIDENT)
    assert refused.told["ok"] is False
    house.running()


def test_a_language_of_the_machine_that_can_not_print_korean_is_no_crash(house: House) -> None:
    assert house.cli("--lang", "ko", "status", env={"LANG": "C", "LC_ALL": "C"}).code == 0


# ---- HTTP ----


def test_bad_requests_are_answered_as_problems_and_nothing_is_booked(house: House) -> None:
    house.open_accounts()
    before = len(house.booked())
    lopsided = transaction("lopsided")
    lopsided["postings"][0]["amount"] = "2"
    nobody = transaction("nobody")
    nobody["postings"][0]["account"] = "assets:nobody"
    for body, status in (
        (b"{", 400),
        (b"[]", 422),
        (b"\xff", 400),
        (lopsided, 422),
        (nobody, 422),
        ({**transaction("one"), "postings": []}, 422),
        ({**transaction("one"), "date": "2026-02-30"}, 422),
        ({**transaction("one"), "description": "x" * (2 << 20)}, 413),
    ):
        answer = house.ask("POST", "/api/ledger/transactions", body, key="bad-request")
        assert answer.status == status, (body[:80] if isinstance(body, bytes) else body["postings"], answer)
        assert answer.headers["content-type"].startswith("application/problem+json"), answer
        assert answer.body["type"].startswith("/problems/"), answer
        assert answer.body["status"] == status
    assert len(house.booked()) == before


def test_another_body_under_the_same_key_is_refused(house: House) -> None:
    house.open_accounts()
    assert house.book("same-key").status == 201
    other = house.ask("POST", "/api/ledger/transactions", transaction("same-key", 2), key="same-key")
    assert (other.status, other.body["type"]) == (422, "/problems/key-reused")


def test_a_stranger_at_the_control_socket_gets_an_answer_and_harms_nothing(house: House) -> None:
    pid = house.status()["core"]["pid"]
    for line in (
        b"\n",
        b"{}\n",
        b"[1]\n",
        b"\xff\n",
        b'{"verb": "fly"}\n',
        b'{"verb": "drill"}\n',
        b'{"verb": 5}\n',
    ):
        with socket.socket(socket.AF_UNIX) as door:
            door.settimeout(20)
            door.connect(str(house.folders.control))
            door.sendall(line)
            answer = json.loads(door.makefile("rb").readline())
            assert answer["ok"] is False
            assert answer["code"]
            assert answer["error"]
    assert house.status()["core"]["pid"] == pid


def test_status_has_the_shape_that_programs_rely_on(house: House) -> None:
    done = house.cli("--json", "status")
    assert done.code == 0
    status = done.told
    assert {"state", "phase", "since", "mode", "wanted", "safe", "url", "incident", "last_incident"} <= set(
        status
    )
    assert {"dead_letters", "ledger_verified_at", "spare"} <= set(status)
    assert set(status["launcher"]) >= {"pid"}
    assert set(status["sentinel"]) >= {"pid", "tick_ms", "late_ticks", "cpu_percent", "rss_bytes", "adopted"}
    assert set(status["gateway"]) >= {"pid", "websockets", "held_requests"}
    assert set(status["core"]) >= {
        "pid", "old_pid", "epoch", "ready", "heartbeat_age_ms", "loop_lag_ms", "last_seq", "in_flight",
        "cpu_percent", "rss_bytes", "threads", "fds",
    }  # fmt: skip
    assert set(status["budget"]) >= {"used", "limit", "window_s"}
    unreachable = run_cli(
        "--data", str(Path(house.data.parent) / "nothing"), "--json", "status", env=house.environment()
    )
    assert unreachable.code == 4
    assert set(unreachable.told) <= set(status)
    for part in ("launcher", "sentinel", "gateway", "core", "budget"):
        assert isinstance(unreachable.told[part], dict)
        assert set(unreachable.told[part]) <= set(status[part])


def test_the_balances_are_what_was_booked(house: House) -> None:
    house.open_accounts()
    count = len(house.booked())
    posted = house.ask("GET", f"/api/ledger/accounts/{BANK}").body["balances"]["posted"]
    other = house.ask("GET", f"/api/ledger/accounts/{SALARY}").body["balances"]["posted"]
    assert (int(posted), int(other)) == (count, -count)
