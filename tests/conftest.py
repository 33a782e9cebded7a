"""The one thing every test shares: it leaves no process behind, also when it fails."""

from collections.abc import Iterator

import pytest
from psutil import Process

from tests import leftovers, waiting

# Processes that were told to end are given this long to be gone; more means that nobody told them.
LEAVING_S = 2.0


@pytest.fixture(autouse=True)
def nothing_is_left_behind(request: pytest.FixtureRequest) -> Iterator[None]:
    """End what the test has left running, and fail it for that."""
    before = leftovers.children()
    folder = request.getfixturevalue("tmp_path") if "tmp_path" in request.fixturenames else None
    yield

    def left() -> set[Process]:
        return (leftovers.children() | (leftovers.at_work_in(folder) if folder else set())) - before

    try:
        waiting.until(lambda: not left(), "everything the test started to end", LEAVING_S)
    except AssertionError:
        told = leftovers.end(left())
        pytest.fail("left running after the test: " + "; ".join(told), pytrace=False)
