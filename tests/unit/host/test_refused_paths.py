"""Which paths are refused: those that two gateways died over within ten minutes, and for ten minutes."""

import json
from pathlib import Path

import pytest

from hardcore.host import refused_paths
from hardcore.host.refused_paths import DEATHS_MAX, PATHS_MAX, REFUSED_MAX, WINDOW_S, Deaths

POISON, BESIDE, OTHER = "0123456789abcdef", "00000000000000aa", "00000000000000bb"
NOW = 1_800_000_000.0


def test_one_death_refuses_nobody_and_the_second_only_what_was_there_in_both() -> None:
    once = Deaths().after(frozenset({POISON, BESIDE}), NOW)
    assert once.in_force(NOW) == ()
    twice = once.after(frozenset({POISON, OTHER}), NOW + 60)
    assert twice.in_force(NOW + 60) == (POISON,)


def test_a_death_of_long_ago_is_no_death_any_more() -> None:
    once = Deaths().after(frozenset({POISON}), NOW)
    assert once.after(frozenset({POISON}), NOW + WINDOW_S + 1).in_force(NOW + WINDOW_S + 1) == ()


def test_a_refusal_ends_by_itself() -> None:
    twice = Deaths().after(frozenset({POISON}), NOW).after(frozenset({POISON}), NOW + 1)
    assert twice.in_force(NOW + WINDOW_S) == (POISON,)
    assert twice.in_force(NOW + WINDOW_S + 1) == ()


def test_a_clock_that_was_set_back_does_not_refuse_for_years() -> None:
    twice = Deaths().after(frozenset({POISON}), NOW).after(frozenset({POISON}), NOW + 1)
    assert twice.in_force(NOW - 86_400) == ()


def test_what_is_known_survives_its_file(tmp_path: Path) -> None:
    known = Deaths().after(frozenset({POISON, BESIDE}), NOW).after(frozenset({POISON}), NOW + 1)
    refused_paths.write(tmp_path / "refused", known)
    assert refused_paths.read(tmp_path / "refused") == known


def test_the_file_stays_small_whatever_happens() -> None:
    known = Deaths()
    for death in range(200):
        names = frozenset(f"{death // 2 * 1000 + number:016x}" for number in range(1000))
        known = known.after(names, NOW + death)
    assert len(known.refused) <= REFUSED_MAX
    assert len(known.deaths) <= DEATHS_MAX
    assert all(len(names) <= PATHS_MAX for _, names in known.deaths)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "no json",
        "[]",
        '{"refused": 3, "deaths": {}}',
        json.dumps({"refused": [{"hash": "../../etc", "until": "x"}], "deaths": [{"at": 1, "parsing": "a"}]}),
        json.dumps({"refused": [{"hash": POISON, "until": "99999-01-01"}], "deaths": [3]}),
    ],
)
def test_what_makes_no_sense_refuses_nobody(tmp_path: Path, text: str) -> None:
    path = tmp_path / "refused"
    path.write_text(text)
    assert refused_paths.read(path) == Deaths()
