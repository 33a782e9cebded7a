import re
from enum import StrEnum

import pytest

from core.imports.reading.candidates import Refusal, Skip
from core.imports.reading.mapping import FaultKind
from core.imports.reading.table import CELL_CHARACTERS_MAX, COLUMNS_MAX, ROWS_MAX, Note, Why
from frontend.catalogue_imports import MAPPING, NOTES, REASONS, REFUSED, SKIPPED, UNREADABLE


@pytest.mark.parametrize(
    ("texts", "reasons"),
    [(UNREADABLE, Why), (NOTES, Note), (REFUSED, Refusal), (SKIPPED, Skip), (MAPPING, FaultKind)],
)
def test_every_reason_of_reading_has_its_sentence(
    texts: dict[str, dict[str, str]], reasons: type[StrEnum]
) -> None:
    assert {reason.value for reason in reasons} <= set(texts)


@pytest.mark.parametrize("slug", sorted(REASONS))
def test_every_reason_is_said_calmly_in_both_languages(slug: str) -> None:
    assert set(REASONS[slug]) == {"ko", "en"}
    for sentence in REASONS[slug].values():
        assert sentence.endswith(".")
        assert "!" not in sentence
    # A particle behind a value would depend on its sound; no unit or counter is one.
    assert re.findall(r"\}(?:은|는|이|가|을|를|과|와|로)", REASONS[slug]["ko"]) == []


def test_the_limits_that_are_told_are_the_limits_that_hold() -> None:
    assert all(f"{ROWS_MAX:,}" in text for text in UNREADABLE["too-many-rows"].values())
    assert all(str(COLUMNS_MAX) in text for text in UNREADABLE["too-many-columns"].values())
    assert all(f"{CELL_CHARACTERS_MAX:,}" in text for text in NOTES["cell-cut"].values())
