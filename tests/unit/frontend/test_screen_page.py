"""The page about the screen's states stays in step: every state of the catalogues, and only tests that are there."""

import re
from pathlib import Path
from typing import Final

from frontend.catalogue_crisis import CRISIS
from frontend.catalogue_receipts import RECEIPTS

ROOT: Final = Path(__file__).parents[3]
PAGE: Final = (ROOT / "docs" / "screen.md").read_text("utf-8")


def test_every_state_of_the_catalogues_has_its_row() -> None:
    codes = {code.partition(".")[0] for code in (*CRISIS, *RECEIPTS)}
    states = {code for code in codes if re.fullmatch(r"R\d+[a-z]?|OFF", code)}
    assert {code for code in states if not re.search(rf"\b{code}\b", PAGE)} == set()


def test_every_test_it_names_is_there() -> None:
    tests = "\n".join(path.read_text("utf-8") for path in (ROOT / "tests" / "browser").glob("test_*.py"))
    named = set(re.findall(r"`(test_\w+)`", PAGE))
    assert named
    assert {name for name in named if f"def {name}(" not in tests} == set()
