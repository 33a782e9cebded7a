"""One thing has one word: whoever reads of it in two places must not look for two things."""

from pathlib import Path

import pytest

import frontend
from frontend import (
    catalogue_admin,
    catalogue_admin_letters,
    catalogue_letters,
    catalogue_prevention,
    catalogue_reports,
)

FILES = sorted(Path(frontend.__file__).parent.rglob("*.py"))
#: The rooms that tell of incidents and letters; a text of at least so many characters is a sentence and no word.
ROOMS = {
    "admin": catalogue_admin.TEXTS,
    "admin letters": catalogue_admin_letters.LETTER_TEXTS,
    "letters": {**catalogue_letters.REFUSALS, **catalogue_letters.WORDS},
    "prevention": catalogue_prevention.WORDS,
    "reports": catalogue_reports.WORDS,
}
SENTENCE_CHARACTERS = 18


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.name)
def test_what_has_happened_is_an_event_in_korean_and_no_accident(file: Path) -> None:
    assert "사고" not in file.read_text("utf-8")


def test_the_same_english_sentence_is_the_same_korean_one_in_every_room() -> None:
    said: dict[str, dict[str, str]] = {}
    for room, texts in ROOMS.items():
        for name, text in texts.items():
            if len(text["en"]) >= SENTENCE_CHARACTERS:
                said.setdefault(text["en"], {})[f"{room}: {name}"] = text["ko"]
    torn = {english: where for english, where in said.items() if len(set(where.values())) > 1}
    assert torn == {}
