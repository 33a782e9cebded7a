"""A gateway that dies, stands still, or is killed by what it reads: another takes over, and its loss is a story of its own."""

import contextlib
import hashlib
import json
import signal
import socket
from typing import Any
from urllib.parse import urlsplit

from hardcore.host import refused_paths
from postmortem import bundle
from tests.integration.conftest import MakeHouse
from tests.integration.house import START_S, House, Victim, whole
from tests.waiting import until


def named(method: str, path: str) -> str:
    """The name by which a path goes on the page."""
    return hashlib.sha256(f"{method} {path}".encode()).digest()[:8].hex()


def half_sent(house: House, line: str) -> socket.socket:
    """Begin a request and leave it at that; returns once the gateway has read of it."""
    where = urlsplit(house.url)
    connection = socket.create_connection((where.hostname, where.port), timeout=START_S)
    connection.sendall(f"{line} HTTP/1.1\r\nHost: localhost\r\nX-Unfin".encode())
    method, target = line.split(" ")
    name = bytes.fromhex(named(method, target.partition("?")[0]))
    page = house.folders.gateway_page
    until(lambda: name in page.read_bytes(), "the gateway to be reading it", START_S)
    return connection


def another(house: House, old: Victim) -> dict[str, Any]:
    """Wait until another gateway runs and its predecessor's story is closed; the status then."""
    until(lambda: old.gone, "the gateway to be gone", START_S)
    return house.until(
        lambda s: s["gateway"]["pid"] not in {None, old.pid} and s["gateway"]["incident"] is None,
        "another gateway to serve",
    )


def in_the_box(house: House, incident: str) -> dict[str, Any]:
    """What was taken of the gateway."""
    found = bundle.read_file(house.folders.incidents / incident, "gateway.json")
    assert isinstance(found, bytes), found
    told = json.loads(found)
    assert isinstance(told, dict)
    return told


def taken(house: House, incident: str) -> set[str]:
    """The files in its box."""
    found = bundle.read_manifest(house.folders.incidents / incident)
    assert isinstance(found, bundle.Manifest), found
    return set(found.files)


def test_a_killed_gateway_is_told_of_beside_a_core_that_noticed_nothing(house: House) -> None:
    core, count = house.status()["core"], len(house.incidents())
    victim = house.hit("gateway")
    after = another(house, victim)
    story = whole(house, count + 1)
    assert (story["diagnosis"], story["outcome"]) == ("GATEWAY_LOST", "recovered")
    assert [step["step"] for step in story["timeline"]] == [
        "fault",
        "detected",
        "gateway_spawned",
        "serving",
        "closed",
    ]
    assert story["outage_ms"] > 0
    assert story["core"]["pid"] is None
    assert [death["exit"]["signal"] for death in story["deaths"]] == [signal.SIGKILL]
    told = in_the_box(house, story["id"])
    assert (told["pid"], told["ended"], told["exit"]["signal"]) == (victim.pid, "died", signal.SIGKILL)
    assert "log.txt" in taken(house, story["id"])
    assert [one["rule"] for one in story["findings"]][:1] == ["gateway_killed"]
    assert (after["core"]["pid"], after["core"]["epoch"]) == (core["pid"], core["epoch"])


def test_a_gateway_that_stands_still_is_ended_with_its_evidence_and_replaced(house: House) -> None:
    core, count = house.status()["core"]["pid"], len(house.incidents())
    victim = house.hit("gateway", signal.SIGSTOP)
    after = another(house, victim)
    story = whole(house, count + 1)
    assert (story["diagnosis"], story["outcome"]) == ("GATEWAY_LOST", "recovered")
    told = in_the_box(house, story["id"])
    assert (told["ended"], told["last_sample"]["state"]) == ("FROZEN", "T")
    assert {"gateway.bin", "process.json", "log.txt"} <= taken(house, story["id"])
    assert [one["rule"] for one in story["findings"]][:1] == ["gateway_frozen"]
    assert after["core"]["pid"] == core
    assert after["gateway"]["refused_paths"] == []


def test_the_drill_of_a_gateways_death_is_kept_and_no_path_is_suspect_of_it(house: House) -> None:
    core = house.status()["core"]["pid"]
    with contextlib.closing(half_sent(house, "POST /api/slow")):
        done = house.cli("drill", "gateway", "--yes", "--json")
    assert done.code == 0, done
    known = refused_paths.read(house.folders.refused_paths)
    assert not any(named("POST", "/api/slow") in paths for _, paths in known.deaths)
    assert (done.told["story"]["diagnosis"], done.told["story"]["drill"]) == ("GATEWAY_LOST", "gateway")
    assert house.status()["core"]["pid"] == core


def test_a_path_that_two_gateways_died_over_is_refused_and_no_other(house: House) -> None:
    for innocent, query in (("/api/once", "?a=1"), ("/api/twice", "?b=2")):
        with (
            contextlib.closing(half_sent(house, f"POST /api/poison{query}")),
            contextlib.closing(half_sent(house, f"GET {innocent}")),
        ):
            another(house, house.hit("gateway", signal.SIGSEGV))
    assert house.status()["gateway"]["refused_paths"] == [named("POST", "/api/poison")]
    refused = house.ask("POST", "/api/poison?c=3", {"other": "body"})
    assert (refused.status, refused.body["type"]) == (400, "/problems/refused-path")
    assert house.ask("GET", "/api/poison").status != 400
    assert house.ask("GET", "/api/once").status == house.ask("GET", "/api/twice").status == 404
    counted = house.until(lambda s: s["gateway"]["refused_requests"] == 1, "the refusal to be counted")
    assert counted["gateway"]["refused_paths"] == [named("POST", "/api/poison")]
    (newest, *_) = house.incidents()
    until((house.folders.incidents / newest["id"] / "report.md").exists, "the report", START_S)
    assert in_the_box(house, newest["id"])["refused_paths"] == [named("POST", "/api/poison")]


def test_a_gateway_that_died_with_its_guard_is_told_of_by_the_next_one(house: House) -> None:
    count = len(house.incidents())
    core, gateway, sentinel = house.status()["core"]["pid"], house.hold("gateway"), house.hold("sentinel")
    with contextlib.closing(half_sent(house, "POST /api/both")):
        sentinel.hit(signal.SIGSTOP)  # it must not see it
        gateway.hit(signal.SIGSEGV)
        until(lambda: gateway.gone, "the gateway to be gone", START_S)
        sentinel.hit(signal.SIGKILL)
    house.until(lambda s: s["sentinel"]["pid"] != sentinel.pid, "another guard")
    another(house, gateway)
    until(lambda: len(house.incidents()) == count + 2, "both losses to be told of", START_S)
    house.running()
    stories = {one["diagnosis"]: one["id"] for one in house.incidents()[:2]}
    assert set(stories) == {"GATEWAY_LOST", "SENTINEL_LOST"}
    until(lambda: all(one["closed_at"] for one in house.incidents()), "all to be told to the end", START_S)
    lost = next(one for one in house.incidents() if one["id"] == stories["SENTINEL_LOST"])
    assert lost["outage_ms"] is not None, "nobody says that the ledger went on answering"
    told = in_the_box(house, stories["GATEWAY_LOST"])
    assert (told["pid"], told["ended"]) == (gateway.pid, "died")
    known = refused_paths.read(house.folders.refused_paths)
    assert named("POST", "/api/both") in known.deaths[-1][1]
    assert house.status()["core"]["pid"] == core


def test_a_gateway_that_a_policy_leaves_to_a_person_comes_back_on_his_word(new_house: MakeHouse) -> None:
    house = new_house(actions={"GATEWAY_LOST": ["SEND_ALERT", "SNAPSHOT", "AWAIT_OPERATOR"]}).up()
    victim = house.hit("gateway")
    waits = house.until(lambda s: s["gateway"]["awaits_operator"], "the guard to wait")
    assert waits["gateway"]["pid"] is None
    assert waits["core"]["pid"]
    assert house.order("resume")["ok"]
    after = another(house, victim)
    assert not after["gateway"]["awaits_operator"]
    assert house.closed(1)["diagnosis"] == "GATEWAY_LOST"
