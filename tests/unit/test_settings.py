import dataclasses
from dataclasses import dataclass

import pytest

from hardcore.settings import Fault, Limits, read, setting


@dataclass(frozen=True, slots=True)
class Sample:
    wait_ms: int = setting(100, "how long", low=10, high=1000)
    loud: bool = setting(False, "whether it speaks")
    mood: str = setting("calm", "how it speaks", words=("calm", "short"))
    plain: int = 3


def test_nothing_given_means_the_defaults() -> None:
    assert read(Sample, {}) == Sample()


def test_both_bounds_are_inside() -> None:
    assert read(Sample, {"wait_ms": 10}) == Sample(wait_ms=10)
    assert read(Sample, {"wait_ms": 1000}) == Sample(wait_ms=1000)


@pytest.mark.parametrize("value", [9, 1001, -1, 10**30, True, 10.0, float("nan"), "100", None, [], {}])
def test_a_number_outside_its_bounds_or_of_another_kind_is_refused(value: object) -> None:
    faults = read(Sample, {"wait_ms": value})
    assert isinstance(faults, list)
    assert [fault.name for fault in faults] == ["wait_ms"]


@pytest.mark.parametrize("value", [0, 1, "true", None])
def test_a_switch_takes_true_and_false_alone(value: object) -> None:
    assert isinstance(read(Sample, {"loud": value}), list)


@pytest.mark.parametrize("value", ["loud", "", None, ["calm"], 1])
def test_a_word_is_one_of_the_listed(value: object) -> None:
    faults = read(Sample, {"mood": value})
    assert isinstance(faults, list)
    assert "calm, short" in faults[0].reason


def test_every_fault_is_told_at_once() -> None:
    faults = read(Sample, {"wait_ms": 0, "loud": 1, "mood": "x", "unknown": 1})
    assert isinstance(faults, list)
    assert {fault.name for fault in faults} == {"wait_ms", "loud", "mood", "unknown"}


def test_a_field_that_is_no_setting_cannot_be_set() -> None:
    assert read(Sample, {"plain": 4}) == [Fault("plain", "is not a setting of this version")]


def test_the_limits_of_the_gateway_pass_their_own_bounds() -> None:
    assert read(Limits, dataclasses.asdict(Limits())) == Limits()


def test_every_limit_says_what_it_is() -> None:
    assert all(field.metadata["text"] for field in dataclasses.fields(Limits))
