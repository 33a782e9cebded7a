"""The page of alerts: who would be told, what came of it, and that nobody would be is said in so many words."""

import json
from pathlib import Path
from typing import Any

import pytest

from tests.unit.postmortem.web_archive import Archive, Visitor, line

HERE = "/admin/alerts"
HOSTILE = "<script>alert(1)</script>\u202egnp.exe\x1b[2J"
CHANNEL = {
    "number": 1, "kind": "webhook", "name": "집", "place": "https://hooks.example/…",
    "min_interval_s": 1800, "lang": ["ko", "en"], "quiet_hours": "22:00-07:00", "secret": True,
}  # fmt: skip
ARRIVED = {"ok": True, "results": [{"channel": 1, "ok": True}]}
IN_VAIN = {"ok": True, "results": [{"channel": 1, "ok": True}, {"channel": 2, "ok": False}]}


@pytest.fixture
def visitor(tmp_path: Path) -> Visitor:
    (tmp_path / "incidents").mkdir()
    (tmp_path / "state").mkdir()
    return Visitor(tmp_path, Archive(), status={"state": "OPERATIONAL"})


def keep(visitor: Visitor, **book: Any) -> None:
    (visitor.folder / "state" / "alerts.json").write_text(json.dumps({"version": 1, **book}), "utf-8")


@pytest.mark.parametrize("lang", ["ko", "en"])
def test_the_page_stands_without_a_guard_and_without_a_book(visitor: Visitor, lang: str) -> None:
    visitor.status, visitor.lang = None, lang
    answer = visitor.get(HERE)
    assert answer.status == 200
    assert "[복구됨]" in answer.text
    assert "[Recovered] Server was down 4.1 s" in answer.text


def test_that_nobody_would_be_told_is_a_warning(visitor: Visitor) -> None:
    visitor.answers["policy"] = {"ok": True, "policy": {}, "alerts": []}
    page = visitor.get(HERE).text
    assert "No channel: you would not be told." in page
    assert "No alert is on record yet." in page
    visitor.archive.lines.append(line())
    page = visitor.get(HERE).text
    assert "Incidents on record: 1. Nobody was told of any, as there was no channel." in page
    visitor.answers["policy"] = {"ok": True, "policy": {}, "alerts": [CHANNEL]}
    page = visitor.get(HERE).text
    assert "you would not be told" not in page
    assert "22:00-07:00" in page
    assert "nothing was sent yet" in page


def test_what_came_of_each_message_is_said_and_nothing_hostile_gets_through(visitor: Visitor) -> None:
    last = {"at": "2026-11-22T05:28:49Z", "stage": "opened", "diagnosis": "CRASHED", "incident": HOSTILE}
    tried = {"channel": 1, "ok": False, "why": "tls"}
    keep(
        visitor,
        channels=[{"number": 1, "name": HOSTILE, "ok": False, "at": HOSTILE, "why": "tls", "failed": 3}],
        last=[
            {**last, "delivered_at": "2026-11-22T05:28:50Z"},
            {**last, "held": "floor"},
            {**last, "attempts": [tried]},
            {**last, "attempts": [{**tried, "ok": None}]},
            {"stage": HOSTILE, "diagnosis": 7, "attempts": "x"},
            HOSTILE,
        ],
    )
    page = visitor.get(HERE).text
    assert "<script>alert" not in page
    for words in (
        ">sent</td>",
        ">not sent: the same was told a short while ago</td>",
        ">did not arrive</td>",
    ):
        assert words in page
    assert ">on its way</td>" in page
    assert "0 sent, 3 failed" in page


@pytest.mark.parametrize(
    ("answer", "code", "outcome"),
    [
        (ARRIVED, "alerts_tested", "arrived"),
        (IN_VAIN, "refused_alerts_test", "did not arrive"),
        ({"ok": False, "code": "no-sender"}, "refused_alerts_test", "did not arrive"),
        (None, "alerts_trying", "asked for"),
    ],
)
def test_a_try_says_what_came_of_it(visitor: Visitor, answer: Any, code: str, outcome: str) -> None:
    visitor.answers["alerts-test"] = answer
    told = visitor.post(f"{HERE}/test")
    assert told.headers["location"] == f"{HERE}?said={code}"
    assert visitor.written == [("alerts test", "", "", outcome)]


def test_alerts_are_muted_for_one_of_the_offered_times_only(visitor: Visitor) -> None:
    assert visitor.post(f"{HERE}/mute", seconds="28800").headers["location"].endswith("alerts_muted")
    assert visitor.post(f"{HERE}/mute", seconds="999999999").headers["location"].endswith("alerts_unmuted")
    muted = [one["seconds"] for one in visitor.asked if one["verb"] == "alerts-mute"]
    assert muted == [28_800, 0]
    visitor.answers["alerts-mute"] = None
    assert visitor.post(f"{HERE}/mute").headers["location"].endswith("guard_away")


def test_a_silence_is_shown_until_it_is_over(visitor: Visitor) -> None:
    path = visitor.folder / "state" / "alerts_muted.json"
    path.write_text('{"until": "2999-01-01T00:00:00Z"}', "utf-8")
    assert "Alerts are muted until" in visitor.get(HERE).text
    for over in ('{"until": "2001-01-01T00:00:00Z"}', '{"until": "2999-01-01"}', '{"until": 7}', "{"):
        path.write_text(over, "utf-8")
        assert "Alerts are muted until" not in visitor.get(HERE).text


def test_the_first_page_says_it_too(visitor: Visitor) -> None:
    visitor.answers["policy"] = {"ok": True, "policy": {}, "alerts": []}
    assert "No channel: you would not be told." in visitor.get("/admin/").text
    visitor.answers["policy"] = {"ok": True, "policy": {}, "alerts": [CHANNEL]}
    assert "you would not be told" not in visitor.get("/admin/").text
