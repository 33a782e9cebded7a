"""Houses for the tests: one for a whole module where that is honest, or one of a test's own."""

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pytest
from psutil import Process

from tests import leftovers, stores, waiting
from tests.integration import houses
from tests.integration.house import House

# As everywhere: processes that were told to end are given this long to be gone.
LEAVING_S = 2.0

#: Houses of modules: their guards start processes at any time, also while a test looks elsewhere. Each is ended with its
#: module, and nothing of it is left then.
SHARED: Final[set[Path]] = set()

MakeHouse = houses.MakeHouse

house = houses.house
new_house = houses.new_house


@pytest.fixture(scope="session", autouse=True)
def _served() -> Iterator[None]:
    """The server of all ledgers, where they are not to lie in files."""
    if not stores.WANTED:
        yield
        return
    with stores.served() as folder:
        SHARED.add(folder)  # its sessions come and go with the cores
        yield


@pytest.fixture(scope="module")
def over_a_server() -> Iterator[None]:
    """The same for one module."""
    with stores.served() as folder:
        SHARED.add(folder)
        yield


@pytest.fixture(autouse=True)
def _in_a_file(request: pytest.FixtureRequest) -> None:
    if stores.in_server() and request.node.get_closest_marker("in_a_file") is not None:
        pytest.skip("it is about a ledger in a file")


@pytest.fixture(autouse=True)
def nothing_is_left_behind(request: pytest.FixtureRequest) -> Iterator[None]:
    """As for all tests, but a house that a module shares stays, whatever its guard has started anew."""
    if "house" in request.fixturenames:
        SHARED.add(request.getfixturevalue("shared_house").data)
    before = leftovers.children()
    folder = request.getfixturevalue("tmp_path") if "tmp_path" in request.fixturenames else None
    yield

    def left() -> set[Process]:
        found = leftovers.children() | (leftovers.at_work_in(folder) if folder else set())
        return found.difference(before, *map(leftovers.at_work_in, SHARED))

    try:
        waiting.until(lambda: not left(), "everything the test started to end", LEAVING_S)
    except AssertionError:
        told = leftovers.end(left())
        pytest.fail("left running after the test: " + "; ".join(told), pytrace=False)


@pytest.fixture(scope="module")
def shared_house(tmp_path_factory: pytest.TempPathFactory) -> Iterator[House]:
    """The house of a module."""
    with houses.house_of_a_module(tmp_path_factory) as house:
        house.open_accounts()
        yield house
