"""What is held back and what is damaged: nothing that goes on is lost, and one bad line silences nobody."""

import datetime as dt
import json
import os
from pathlib import Path
from typing import Any

import pytest

from hardcore.alerting import sender
from hardcore.alerting.sender import Sender
from hardcore.alerting.wording import compose
from hardcore.host import muting
from tests.contract.alert_targets import Outgoing, Web, outgoing, web

LONG_S = 3600


@pytest.fixture
def out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Outgoing:
    monkeypatch.setattr(sender, "REPORT_S", 0.0)
    return outgoing(tmp_path)


def hook(url: str, **more: object) -> dict[str, object]:
    return {"kind": "webhook", "url": f"{url}/x", "min_interval_s": LONG_S, **more}


def send(out: Outgoing) -> None:
    Sender(out.folders, (0.02,)).run(life_s=30.0)


def came(target: Web) -> list[tuple[str, str]]:
    return [(one.json["stage"], one.json["incident"]) for one in target.came]


def entry(out: Outgoing, name: str) -> Any:
    return next(one for one in out.book["last"] if one["id"] == name)


def quiet_now() -> str:
    """Quiet hours that go on for long enough to end nothing while a test runs."""
    at = dt.datetime.now().astimezone()
    return f"{(at - dt.timedelta(hours=1)):%H:%M}-{(at + dt.timedelta(hours=2)):%H:%M}"


def told_once(out: Outgoing) -> None:
    out.put(incident="a1")
    out.put("closed", incident="a1", outcome="recovered")
    send(out)


def test_a_second_trouble_that_goes_on_is_told_when_the_floor_is_over(out: Outgoing) -> None:
    with web() as target:
        out.channels(hook(target.url))
        told_once(out)
        name = out.put(incident="a2")
        send(out)
        assert came(target) == [("opened", "a1"), ("closed", "a1")]
        assert (entry(out, name)["held"], len(out.waiting)) == ("floor", 1)
        assert entry(out, name)["again_at"] > entry(out, name)["at"]
        out.channels(hook(target.url, min_interval_s=0))
        send(out)
        assert came(target)[2:] == [("opened", "a2")]
    assert (out.waiting, "a2" in out.book["told"]) == ([], True)


def test_a_second_trouble_that_is_over_in_time_is_counted_and_not_told(out: Outgoing) -> None:
    with web() as target:
        out.channels(hook(target.url))
        told_once(out)
        out.put(incident="a2")
        send(out)
        out.put("closed", incident="a2", outcome="recovered")
        send(out)
        assert len(target.came) == 2
    assert (out.waiting, "a2" in out.book["untold"]) == ([], False)


def test_an_end_that_needs_a_person_is_told_although_its_beginning_was_not(out: Outgoing) -> None:
    with web() as target:
        out.channels(hook(target.url, quiet_hours=quiet_now()))
        out.put(incident="a1")
        send(out)
        assert target.came == []
        out.put("closed", incident="a1", outcome="manual")
        send(out)
        assert came(target) == [("closed", "a1")]
    assert out.waiting == []


def test_what_began_in_silence_is_told_when_it_ends(out: Outgoing) -> None:
    with web() as target:
        out.channels(hook(target.url))
        muting.mute(out.folders, LONG_S)
        out.put(incident="a1")
        send(out)
        assert len(out.waiting) == 1
        muting.unmute(out.folders)
        send(out)
        assert came(target) == [("opened", "a1")]


def test_a_silence_of_more_than_anybody_may_ask_for_is_none(out: Outgoing) -> None:
    (out.folders.state / "alerts_muted.json").write_text('{"until": "9999-12-31T00:00:00Z"}', "utf-8")
    with web() as target:
        out.channels(hook(target.url))
        out.put(incident="a1")
        send(out)
        assert came(target) == [("opened", "a1")]


def test_nobody_was_told_when_all_failed_who_were_not_spared(out: Outgoing) -> None:
    with web() as gone:
        url = gone.url
    out.channels(hook(url), hook(url, quiet_hours=quiet_now(), name="night"))
    out.put(incident="a1")
    send(out)
    assert list(out.book["untold"]) == ["a1"]


def test_who_is_only_put_off_is_not_told_of_as_unreachable(out: Outgoing) -> None:
    with web() as target:
        out.channels(hook(target.url, quiet_hours=quiet_now()))
        out.put(incident="a1")
        send(out)
    assert (out.book["told"], out.book["untold"]) == ({}, {})
    assert len(out.waiting) == 1


@pytest.mark.parametrize("kept", ['{"alerts": [', "[]", '{"alerts": [{"kind": "pager"}]}'])
def test_a_policy_that_nobody_can_read_takes_nothing_away(out: Outgoing, kept: str) -> None:
    out.folders.good_policy.write_text(kept, "utf-8")
    out.put("waits", incident="a1")
    send(out)
    assert len(out.waiting) == 1


def test_one_bad_channel_silences_no_other(out: Outgoing) -> None:
    with web() as target:
        out.channels({"kind": "pager"}, hook(target.url))
        out.put(incident="a1")
        send(out)
        assert came(target) == [("opened", "a1")]


GOOD = "01990000-0000-7000-8000-000000000001"
BOOKS: dict[str, str] = {
    "no attempts": json.dumps({"serial": 1, "last": [{"id": GOOD}]}),
    "no delivered_at": json.dumps({"serial": 1, "last": [{"id": GOOD, "attempts": []}]}),
    "attempts of another kind": json.dumps(
        {"last": [{"id": GOOD, "attempts": "x", "spared": [], "held": 1}]}
    ),
    "surrogates": '{"serial": 1, "last": [{"id": "\\ud800"}], "told": {"\\ud800": "\\ud800"}}',
    "numbers": '{"serial": 1%s, "channels": [{"number": true, "sent": []}], "told": {"a1": [1]}}'
    % ("0" * 400),
    "memory": json.dumps({"memory": {"1 webhook http://127.0.0.1/…": {"told_ms": {"CRASHED": 10**30}}}}),
    "lists": '{"last": 1, "told": [], "memory": [], "channels": {}}',
}


@pytest.mark.parametrize("damage", sorted(BOOKS))
def test_a_damaged_book_silences_nobody(out: Outgoing, damage: str) -> None:
    with web() as target:
        out.channels(hook(target.url))
        out.folders.alerts.write_text(BOOKS[damage], "utf-8")
        (out.folders.outbox / f"{out.put(incident='a1')}.json").rename(out.folders.outbox / f"{GOOD}.json")
        send(out)
        assert came(target) == [("opened", "a1")]
    assert (out.waiting, list(out.book["told"])[-1]) == ([], "a1")


@pytest.mark.parametrize(
    "told",
    [
        {"stage": "closed", "outage_ms": 10**400, "outcome": "manual"},
        {"stage": "closed", "outage_ms": float("inf"), "outcome": "manual"},
        {"stage": "waits", "incident": "a" * 400},
        {"stage": "waits", "incident": "a\x00b"},
        {"incident": "\ud800"},
        {"fingerprint": "\ud800", "text": "\ud800"},
    ],
)
def test_a_damaged_alert_silences_no_other(out: Outgoing, told: dict[str, Any]) -> None:
    with web() as target:
        out.channels(hook(target.url))
        out.put(**{"fingerprint": "BAD", "incident": "b1", **told})
        out.put(incident="a1")
        send(out)
        assert ("opened", "a1") in came(target)
    assert out.waiting == []


def test_a_mistake_about_one_alert_gives_up_that_one_with_its_code(
    out: Outgoing, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(notice: Any, *args: Any) -> Any:
        if notice.fingerprint == "BAD":
            raise ZeroDivisionError
        return compose(notice, *args)

    monkeypatch.setattr(sender, "compose", fails)
    with web() as target:
        out.channels(hook(target.url))
        name = out.put(fingerprint="BAD", incident="b1")
        out.put(incident="a1")
        send(out)
        assert came(target) == [("opened", "a1")]
    assert entry(out, name)["attempts"][0]["why"] == "fault"
    assert (out.waiting, list(out.book["untold"])) == ([], ["b1"])


def test_what_is_no_file_is_no_alert(out: Outgoing) -> None:
    os.mkfifo(out.folders.outbox / "0000.json")
    (out.folders.outbox / "0001.json").mkdir()
    (out.folders.outbox / "0002.json").symlink_to("/dev/zero")
    with web() as target:
        out.channels(hook(target.url))
        out.put(incident="a1")
        send(out)
        assert came(target) == [("opened", "a1")]
