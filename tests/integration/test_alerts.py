"""Somebody is told, by the real guard and its real sender, and nothing of the guard waits for it."""

import signal
from collections.abc import Iterator
from typing import Any

import pytest

from hardcore.host.files import read_json
from hardcore.host.muting import muted_until_ms
from tests import stores
from tests.contract.alert_targets import HANGS, Web, comes, web
from tests.integration.house import House, bytes_of
from tests.waiting import until

TOKEN = "CANARY-0a1b2c"


@pytest.fixture(scope="module")
def targets() -> Iterator[tuple[Web, Web]]:
    with web() as quick, web(HANGS) as slow:
        yield quick, slow


@pytest.fixture(scope="module")
def shared_house(tmp_path_factory: pytest.TempPathFactory, targets: tuple[Web, Web]) -> Iterator[House]:
    """One that tells two channels: the first takes what it is told, the second never answers."""
    channels = [{"kind": "webhook", "url": f"{one.url}/{TOKEN}", "min_interval_s": 3600} for one in targets]
    actions = {"CRASHED": ["SEND_ALERT", "AWAIT_OPERATOR"]}
    house = House(tmp_path_factory.mktemp("house") / "data", {"alerts": channels, "actions": actions})
    try:
        yield house.up()
    finally:
        house.end()


def told(target: Web) -> list[tuple[str, str]]:
    return [(one.json["stage"], one.json["incident"]) for one in target.came]


def test_a_storm_of_kills_is_one_message_and_one_closing_message(
    house: House, targets: tuple[Web, Web]
) -> None:
    quick, slow = targets
    house.open_accounts()
    assert house.book("before").status == 201  # somebody has seen a commit: what is lost can be told
    with stores.locked(house.data):  # so that no core can serve before the page is looked at
        house.hit("core")
        frame = until(lambda: told_frame(house), "a page to say that somebody was told")
    for _ in range(2):
        house.running()  # although the second channel has not answered, and never will
        core = house.hit("core")
        until(lambda core=core: core.gone, "the core to be gone")  # type: ignore[misc]
    house.closed(3)
    first = house.incidents()[-1]["id"]
    comes(quick, 2)
    assert told(quick) == [("opened", first), ("closed", first)]
    assert len(slow.came) >= 1
    closing_text = quick.came[1].json["text"]
    assert "[Recovered] Server was down" in closing_text
    assert "No records lost (verified)" in closing_text
    assert (frame["incident"], frame["alerted_at"]) == (first, told_at(house)[first])
    assert house.booked() == ["before"]


def told_frame(house: House) -> Any:
    frame = house.ask("GET", "/__hc/status.json").body
    return frame if frame.get("alerted_at") else None


def told_at(house: House) -> Any:
    return read_json(house.folders.alerts)["told"]


def test_who_is_needed_is_told(house: House, targets: tuple[Web, Web]) -> None:
    quick, _ = targets
    house.hit("core", signal.SIGSEGV)
    house.until(lambda s: s["state"] == "MANUAL_INTERVENTION", "it to wait for a person")
    called = until(lambda: [one for one in told(quick) if one[0] == "waits"], "the call")
    assert called == [("waits", house.closed(4)["id"])]
    house.order("resume")
    house.running()


def test_a_try_by_the_door_and_by_hand_says_what_came_of_each_channel(house: House) -> None:
    by_door = house.order("alerts-test", channel=1)
    assert [(one["channel"], one["ok"]) for one in by_door["results"]] == [(1, True)]
    by_hand = house.cli("--json", "alerts", "test", "--channel", "1")
    assert by_hand.code == 0
    assert by_hand.told["ok"] is True
    assert house.order("alerts-mute", seconds=60)["muted_until"]
    assert muted_until_ms(house.folders) > 0
    assert house.order("alerts-mute", seconds=0) == {"ok": True, "muted_until": None}
    assert muted_until_ms(house.folders) == 0


def test_no_token_stands_in_anything_but_the_policy(house: House) -> None:
    shown = [str(house.order("policy")), str(house.status()), house.cli("--json", "alerts").out]
    assert [one for one in shown if TOKEN in one] == []
    policies = {house.folders.policy, house.folders.good_policy}
    written = [
        path for place in (house.data, house.folders.run) for path in place.rglob("*") if path.is_file()
    ]
    found = [path for path in written if path not in policies and TOKEN.encode() in bytes_of(path)]
    assert found == []
