"""Houses for the tests: one for a whole module where that is honest, or one of a test's own."""

from collections.abc import Callable, Iterator
from typing import Any

import pytest
from psutil import Process

from tests import leftovers, waiting
from tests.integration.house import House

# As everywhere: processes that were told to end are given this long to be gone.
LEAVING_S = 2.0

MakeHouse = Callable[..., House]


@pytest.fixture(autouse=True)
def nothing_is_left_behind(request: pytest.FixtureRequest) -> Iterator[None]:
    """As for all tests, but a house that a module shares stays, whatever its guard has started anew."""
    shared: House | None = (
        request.getfixturevalue("shared_house") if "house" in request.fixturenames else None
    )
    before = leftovers.children()
    folder = request.getfixturevalue("tmp_path") if "tmp_path" in request.fixturenames else None
    yield

    def left() -> set[Process]:
        found = leftovers.children() | (leftovers.at_work_in(folder) if folder else set())
        return found - before - (leftovers.at_work_in(shared.data) if shared else set())

    try:
        waiting.until(lambda: not left(), "everything the test started to end", LEAVING_S)
    except AssertionError:
        told = leftovers.end(left())
        pytest.fail("left running after the test: " + "; ".join(told), pytrace=False)


@pytest.fixture(scope="module")
def shared_house(tmp_path_factory: pytest.TempPathFactory) -> Iterator[House]:
    """The house of a module."""
    house = House(tmp_path_factory.mktemp("house") / "data")
    try:
        house.up()
        house.open_accounts()
        yield house
    finally:
        house.end()


@pytest.fixture
def house(shared_house: House) -> House:
    """The module's house, running and without an open incident, whatever the test before did to it."""
    shared_house.running()
    return shared_house


@pytest.fixture
def new_house(tmp_path_factory: pytest.TempPathFactory) -> Iterator[MakeHouse]:
    """Make houses of the test's own; policy settings are named arguments. They are not started yet."""
    made: list[House] = []

    def make(**policy: Any) -> House:
        made.append(House(tmp_path_factory.mktemp("own") / "data", policy))
        return made[-1]

    yield make
    for house in made:
        house.end()
