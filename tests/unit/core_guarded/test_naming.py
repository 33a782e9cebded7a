"""Ids in a frame: whole ones, each once, and no more than a reader of stacks shows."""

from hypothesis import given
from hypothesis import strategies as st

from core.guarded.naming import SHOWN_CHARACTERS_MAX, ids_shown


def test_each_id_is_shown_once_and_in_order() -> None:
    assert ids_shown(["food", "cash", "food"]) == "food,cash"
    assert ids_shown(["", "food", ""]) == "food"
    assert ids_shown([]) == ""


@given(st.lists(st.text("ab-:", max_size=80), max_size=20))
def test_only_whole_ids_are_shown_and_the_text_is_short(ids: list[str]) -> None:
    text = ids_shown(ids)
    assert len(text) <= SHOWN_CHARACTERS_MAX
    assert set(filter(None, text.split(","))) <= set(ids)
