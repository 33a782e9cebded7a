"""What a spare asks itself before it is promoted."""

from core.web.app import ROUTES
from core.web.pages_table import PAGES
from core.web.rehearsal import PATHS, UNASKED


def test_every_question_of_the_core_is_rehearsed_but_those_that_take_long() -> None:
    questions = [path for path, methods in {**ROUTES, **PAGES}.items() if "GET" in methods]
    assert len(PATHS) == len(questions) - len(UNASKED)
    assert set(questions) >= UNASKED
    assert not any("{" in path for path in PATHS)
