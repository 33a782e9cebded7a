"""Houses as fixtures, for the tests that ask over HTTP and for those that look with a browser."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from tests.integration.house import House

MakeHouse = Callable[..., House]


@contextmanager
def house_of_a_module(tmp_path_factory: pytest.TempPathFactory) -> Iterator[House]:
    """A house that runs; gone afterwards."""
    house = House(tmp_path_factory.mktemp("house") / "data")
    try:
        yield house.up()
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
