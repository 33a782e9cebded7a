"""What the dashboard says of what grows: the guard's word, and nothing where it has none."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from tests.unit.postmortem.web_archive import Archive, Visitor

MIB = 1 << 20
STATUS: Mapping[str, Any] = {"state": "OPERATIONAL"}
MEMORY: Mapping[str, Any] = {
    "resource": "memory",
    "limit": 512 * MIB,
    "level": 210 * MIB,
    "per_hour": 3.0 * MIB,
    "per_hour_low": 2.0 * MIB,
    "due": "2026-11-24T09:00:00Z",
    "points": [[-120.0, 208 * MIB, 230 * MIB], [-60.0, 210 * MIB, 231 * MIB]],
}
RUNS_OUT: Mapping[str, Any] = {"resource": "memory", "per_hour": 3.0 * MIB, "due": "2026-11-24T09:00:00Z"}


@pytest.fixture
def visitor(tmp_path: Path) -> Visitor:
    (tmp_path / "incidents").mkdir()
    return Visitor(tmp_path, Archive())


def test_the_curve_is_drawn_with_its_limit_and_a_table_behind_it(visitor: Visitor) -> None:
    visitor.status, visitor.resources = STATUS, [MEMORY]
    page = visitor.get("/admin/").text
    assert 'class="d-curve"' in page
    assert 'class="d-limit"' in page
    assert "2 min ago" in page
    assert "512 MiB" in page


def test_before_there_is_a_curve_the_page_says_so(visitor: Visitor) -> None:
    visitor.status, visitor.resources = STATUS, [{**MEMORY, "points": []}]
    page = visitor.get("/admin/").text
    assert 'class="d-curve"' not in page
    assert "Not enough was seen yet" in page


@pytest.mark.parametrize(
    ("lang", "said"),
    [("en", "Memory: at this pace it reaches its limit at about"), ("ko", "메모리: 이대로 늘면")],
)
def test_what_will_run_out_is_said_with_its_time(visitor: Visitor, lang: str, said: str) -> None:
    visitor.lang = lang
    visitor.status = {**STATUS, "forecasts": [RUNS_OUT]}
    page = visitor.get("/admin/").text
    assert said in page
    assert "3.0 MiB" in page


def test_a_log_that_says_more_than_usual_is_told_without_a_limit(visitor: Visitor) -> None:
    visitor.status = {**STATUS, "forecasts": [{"resource": "errors", "per_hour": 0.0, "due": None}]}
    assert "far more than usual" in visitor.get("/admin/").text


def test_what_a_guard_says_that_nobody_knows_is_left_out(visitor: Visitor) -> None:
    odd = [{"resource": "soul", "per_hour": 3}, {"resource": "memory", "per_hour": "3"}, {}]
    visitor.status, visitor.resources = (
        {**STATUS, "forecasts": odd},
        [{"resource": "memory", "points": [[1]]}],
    )
    assert visitor.get("/admin/").status == 200
    assert visitor.get("/admin/trends").status == 200


def test_the_trends_say_what_grows_and_when_it_ends(visitor: Visitor) -> None:
    visitor.status, visitor.resources = STATUS, [MEMORY, {**MEMORY, "resource": "fds", "due": None}]
    page = visitor.get("/admin/trends").text
    assert "210 MiB" in page
    assert "in more than three months" in page


def test_the_trends_say_that_nothing_grows_or_that_nobody_knows(visitor: Visitor) -> None:
    visitor.status, visitor.resources = STATUS, [{**MEMORY, "per_hour": None}]
    assert "Nothing grows" in visitor.get("/admin/trends").text
    visitor.status = None
    assert "The guard does not answer" in visitor.get("/admin/trends").text
