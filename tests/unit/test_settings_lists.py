from dataclasses import dataclass

import pytest

from hardcore.settings import Fault, read, setting


@dataclass(frozen=True, slots=True)
class Sample:
    moods: tuple[str, ...] = setting(("calm",), "what it may be", words=("calm", "loud"))


def test_a_list_of_words_is_read_as_it_stands() -> None:
    assert read(Sample, {}) == Sample(("calm",))
    assert read(Sample, {"moods": ["loud", "calm"]}) == Sample(("loud", "calm"))


@pytest.mark.parametrize("value", [[], "calm", ["strange"], ["calm", 1], None, {"calm": 1}])
def test_a_list_holds_listed_words_and_at_least_one(value: object) -> None:
    faults = read(Sample, {"moods": value})
    assert isinstance(faults, list)
    assert isinstance(faults[0], Fault)
