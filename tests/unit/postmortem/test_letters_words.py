import re
from pathlib import Path
from string import Formatter

import pytest
from msgspec.structs import asdict, replace

from frontend.catalogue_letters import REFUSALS, WORDS, refusal, told
from hardcore.investigator_line import Interrupted, Line
from hardcore.letter_words import total_of
from postmortem.dead_letters.as_terminal import print_list
from postmortem.dead_letters.ordeals import answered, read_dry_run, was_refused, went_well
from postmortem.reports.as_terminal import Look, cells
from postmortem.views import DryRun

TEXTS = {**REFUSALS, **{f"word_{code}": text for code, text in WORDS.items()}}
_PARTICLE = re.compile(r"\}(은|는|이|가|을|를|과|와|로|으로)(?![가-힣])")


@pytest.mark.parametrize("code", sorted(TEXTS))
def test_each_text_says_the_same_values_in_both_languages_and_calmly(code: str) -> None:
    ko, en = TEXTS[code]["ko"], TEXTS[code]["en"]
    assert _values(ko) == _values(en)
    assert not _PARTICLE.search(ko)
    assert "!" not in ko + en


def _values(text: str) -> set[str]:
    return {name for _, name, _, _ in Formatter().parse(text) if name}


def test_what_is_newer_than_the_catalogue_is_told_as_it_is() -> None:
    assert refusal("brand_new", "ko", {}) == "brand_new"
    assert told("reason", "BRAND_NEW", "en") == "BRAND_NEW"
    assert "?" in refusal("guard_refused", "en", {})


def test_amounts_of_many_letters_are_added_up_by_currency() -> None:
    assert total_of([{"sums": ["1000 KRW", "2.50 USD"]}, {"sums": ["500 KRW", "x"]}]) == [
        "1,500 KRW",
        "2.50 USD",
    ]


def test_an_investigator_that_went_away_is_told_as_that_and_not_as_one_that_did_not_start(
    tmp_path: Path,
) -> None:
    with pytest.raises(Interrupted):
        Line(tmp_path / "gone", "en").get("letters")


def test_a_dry_run_that_the_ledger_refused_did_not_go_well() -> None:
    refused = DryRun("2026-11-22", "survived", 404, 82, {"title": "Not found", "detail": "No account."}, "")
    assert (was_refused(refused), went_well(refused), answered(refused)) == (True, False, "404: No account.")
    booked = replace(refused, status=201, answer={"id": "t"})
    assert (was_refused(booked), went_well(booked), answered(booked)) == (False, True, "201")
    assert not went_well(replace(refused, ordeal="died", status=None))
    assert read_dry_run(asdict(refused)) == refused


@pytest.mark.parametrize("width", [56, 80, 110])
def test_no_letter_moves_the_cursor_or_leaves_the_window(width: int) -> None:
    said: list[str] = []
    hostile = "\x1b[2J\u202e가" * 99
    item = {
        "id": hostile,
        "state": "QUARANTINED",
        "quarantined_at": "2026-11-22T14:00:00Z",
        "kind": hostile,
        "method": "POST",
        "accounts": [hostile],
        "reason": hostile,
    }
    print_list([item | {"id": "0199aaaa-1"}], 1, "ko", said.append, Look(width))
    assert "\x1b" not in "".join(said)
    assert all(cells(line) <= width for line in "".join(said).splitlines())
