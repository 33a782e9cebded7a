"""One thing has one word: whoever reads of it in two places must not look for two things."""

from pathlib import Path

import pytest

import frontend

FILES = sorted(Path(frontend.__file__).parent.rglob("*.py"))


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.name)
def test_what_has_happened_is_an_event_in_korean_and_no_accident(file: Path) -> None:
    assert "사고" not in file.read_text("utf-8")
