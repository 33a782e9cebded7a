"""Which versions of SQLite have the fault of the log's reset."""

import pytest

from core.journal.stores.sqlite import has_reset_race


@pytest.mark.parametrize(
    ("version", "has"),
    [
        ((3, 6, 23), False),
        ((3, 7, 0), True),
        ((3, 40, 1), True),
        ((3, 44, 5), True),
        ((3, 44, 6), False),
        ((3, 45, 0), True),
        ((3, 50, 6), True),
        ((3, 50, 7), False),
        ((3, 51, 2), True),
        ((3, 51, 3), False),
        ((3, 53, 0), False),
        ((4, 0, 0), False),
    ],
)
def test_a_version_is_known_by_where_it_was_mended(version: tuple[int, ...], has: bool) -> None:
    assert has_reset_race(version) is has
