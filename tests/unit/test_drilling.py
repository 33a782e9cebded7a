"""What a drill says is for somebody who has not read the table of diagnoses."""

import re
from pathlib import Path

import pytest

from frontend.catalogue_drills import LANGUAGES, TOLD, done_words, promised_words
from hardcore.asked import Asked
from hardcore.control.protocol import DRILLS, PEACEFUL
from hardcore.drilling import PROMISES, noticed, way_back

CODE_WORD = re.compile(r"[A-Z]{2,}_|\b[A-Z]{4,}\b|safe_mode|manual")


def test_every_drill_has_a_promise_and_words_for_it() -> None:
    assert set(TOLD) == {*DRILLS, "restore"}
    assert set(PROMISES) == set(DRILLS) - PEACEFUL


@pytest.mark.parametrize("fault", DRILLS)
@pytest.mark.parametrize("lang", LANGUAGES)
def test_a_promise_is_made_in_plain_words(fault: str, lang: str) -> None:
    for words in (done_words(fault, lang), promised_words(fault, lang)):
        assert words.endswith(".")
        assert not CODE_WORD.search(words)


def test_what_the_core_says_itself_was_noticed_at_once() -> None:
    asked = Asked(Path("var"), json=False, lang="en")
    assert [noticed(asked, ms) for ms in (0.0, 12.34, None)] == [
        "at once",
        "after 12.3 ms",
        "at a time that is not on record",
    ]


@pytest.mark.parametrize(
    ("steps", "said"),
    [
        (("fault", "promoted", "ready"), "back_by_spare"),
        (("fault", "spawned", "ready"), "back_by_start"),
        (("fault", "promoted", "spawned", "ready"), "back_by_start"),
        (("fault", "closed"), "back_by_itself"),
    ],
)
def test_who_drills_is_told_whether_the_spare_took_over(steps: tuple[str, ...], said: str) -> None:
    assert way_back({"timeline": [{"step": step} for step in steps]}) == said
