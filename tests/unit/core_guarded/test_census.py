"""The census of types: nobody's code is run, nothing is kept alive, and the core is not held up for it."""

import gc
import threading
import weakref
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from types import FunctionType
from typing import Any, NoReturn

import pytest

from core.guarded import census, page
from core.guarded.census import CensusTaker, Pace, count_types, measure_of, name, stride
from core.guarded.recorder import Recorder
from hardcore.host.recorder import PageReader, make_page
from hardcore.model.recorder import Census, Page
from tests.waiting import until

MS = 1_000_000
GIB = 1 << 30
ASKED = (
    "__sizeof__",
    "__repr__",
    "__str__",
    "__len__",
    "__eq__",
    "__hash__",
    "__getattribute__",
    "__iter__",
    "__bool__",
)


@pytest.fixture
def frozen() -> Iterator[None]:
    """Leave what the tests themselves have loaded out of every listing."""
    gc.collect()
    gc.freeze()
    yield
    gc.unfreeze()


def raising(*_: object) -> NoReturn:
    raise AssertionError("somebody's code was run")


class Hostile(type):
    """A metaclass whose classes object to every question that runs code of theirs."""

    __getattribute__ = __hash__ = __eq__ = __instancecheck__ = __subclasscheck__ = raising


class Held:
    """Something to be found."""


def counts(rss_bytes: int = GIB) -> dict[str, tuple[int, int]]:
    return {found: (count, size_bytes) for found, count, size_bytes in count_types(rss_bytes).types}


@pytest.mark.usefixtures("frozen")
def test_what_has_grown_is_counted_and_what_was_there_before_is_not() -> None:
    assert f"{__name__}.Held" not in counts()
    held = [Held() for _ in range(1000)]
    count, size_bytes = counts()[f"{__name__}.Held"[-page.TYPE_NAME_BYTES_MAX :]]
    assert count == len(held)
    assert size_bytes >= 1000 * (object.__sizeof__(held[0]) + census.COLLECTOR_BYTES)


@pytest.mark.usefixtures("frozen")
def test_a_sample_speaks_for_all_of_a_large_heap() -> None:
    held = [(n, [n]) for n in range(2 * census.SAMPLE_MAX)]
    counted = count_types(GIB)
    assert counted.objects >= 2 * len(held)
    assert census.SAMPLE_MAX // 2 <= counted.examined <= census.SAMPLE_MAX
    found = {one: count for one, count, _ in counted.types}
    for kind in ("tuple", "list"):
        assert abs(found[kind] - len(held)) < len(held) // 20


@pytest.mark.parametrize("objects", [0, 1, 50_000, 50_001, 100_001, 3_000_000, 3_000_000_000])
def test_a_stride_is_one_or_a_prime_and_the_sample_stays_small(objects: int) -> None:
    step = stride(objects)
    assert step == 1 or all(step % factor for factor in range(2, int(step**0.5) + 1))
    assert -(-objects // step) <= census.SAMPLE_MAX


@pytest.mark.usefixtures("frozen")
def test_a_single_large_thing_is_not_scaled() -> None:
    held = [[n] for n in range(3 * census.SAMPLE_MAX)]
    lists = sum(list.__sizeof__(one) + census.COLLECTOR_BYTES for one in held) + list.__sizeof__(held)
    _, size_bytes = counts()["list"]
    assert size_bytes < lists * 1.1


@pytest.mark.usefixtures("frozen")
def test_no_code_of_a_counted_class_is_run() -> None:
    body: dict[str, Any] = dict.fromkeys(ASKED, raising)
    bases: tuple[tuple[type, ...], ...] = ((), (dict,), (list,), (tuple,), (deque,))
    kinds = [Hostile("Hostile" + "".join(b.__name__ for b in base), base, dict(body)) for base in bases]
    made = [[type.__call__(kind) for _ in range(100)] for kind in kinds]
    for kind in kinds:
        type.__setattr__(kind, "__module__", property(raising))
    found = counts()
    assert {"Hostile", "Hostiledict", "Hostilelist", "Hostiletuple", "Hostiledeque"} <= found.keys()
    del made


@pytest.mark.usefixtures("frozen")
def test_nothing_is_kept_alive_by_having_been_counted() -> None:
    held = [Held() for _ in range(100)]
    gone = [weakref.ref(one) for one in held]
    count_types(GIB)
    held.clear()
    assert not any(one() for one in gone)


@pytest.mark.usefixtures("frozen")
def test_the_sample_is_let_go_of_before_the_first_rest() -> None:
    held = [Held() for _ in range(2 * census.SLICE)]
    gone = [weakref.ref(one) for one in held]
    left: list[bool] = []

    def rest() -> None:
        held.clear()
        left.append(any(one() for one in gone))

    counted = count_types(GIB, rest)
    assert {one: count for one, count, _ in counted.types}[name(Held)] == 2 * census.SLICE
    assert not any(left)


@pytest.mark.parametrize(("kind", "base"), [(dict, dict), (deque, deque), (tuple, object), (Held, object)])
def test_a_containers_contents_are_measured_by_its_built_in_base(kind: type, base: type) -> None:
    for one in (kind, type("Sub", (kind,), {})):
        assert measure_of(one).__qualname__ == f"{base.__name__}.__sizeof__"


def test_a_name_keeps_its_end_and_its_whole_words() -> None:
    assert name(dict) == "dict"
    assert name(Held) == f"{__name__}.Held"
    long = type("Last", (), {"__module__": "a" * 30 + "." + "b" * 30})
    assert name(long) == "b" * 30 + ".Last"
    assert name(type("x" * 60, (), {"__module__": "a.b"})) == "x" * 60
    assert name(type("Odd", (), {"__module__": 7})) == "Odd"
    nowhere = FunctionType((lambda: type("Nowhere", (), {})).__code__, {"type": type})
    assert name(nowhere()) == "Nowhere"


def test_a_census_is_due_after_its_time_and_sooner_where_memory_runs_short() -> None:
    pace = Pace(60_000, 1000, last_ns=0)
    assert not pace.is_due(59_999 * MS, 800)
    assert pace.is_due(60_000 * MS, 0)
    assert not pace.is_due(9_999 * MS, 801)
    assert pace.is_due(10_000 * MS, 801)
    assert not Pace(60_000, None, last_ns=0).is_due(59_999 * MS, 1 << 60)
    assert Pace(100, 1000, last_ns=0).is_due(100 * MS, 801)


def test_a_long_listing_is_followed_by_a_long_time_without_one() -> None:
    pace = Pace(60_000, 1000, last_ns=0)
    pace.learn(150 * MS, blocks=15_000_000)
    assert not pace.is_due(29_999 * MS, 801)
    assert pace.is_due(30_000 * MS, 801)


def test_a_listing_that_would_hold_up_the_core_is_made_only_where_memory_runs_short() -> None:
    pace = Pace(60_000, 1000, last_ns=0)
    pace.learn(1 * MS, blocks=1000)
    usual, pressed = census.LISTING_MS_MAX * 1000, census.PRESSED_LISTING_MS_MAX * 1000
    assert pace.is_short(0, usual)
    assert not pace.is_short(0, usual + 1)
    assert pace.is_short(801, pressed)
    assert not pace.is_short(801, pressed + 1)


def taken(tmp_path: Path) -> tuple[Recorder, PageReader]:
    make_page(tmp_path / "page", "nonce-1", "boot")
    recorder = Recorder.open(tmp_path / "page")
    assert isinstance(recorder, Recorder)
    return recorder, PageReader(tmp_path / "page", "nonce-1")


def read(reader: PageReader) -> Page:
    found = reader.read()
    assert isinstance(found, Page)
    return found


@pytest.mark.usefixtures("frozen")
def test_the_page_keeps_the_last_two_censuses_of_a_living_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        census, "LISTING_MS_MAX", 60_000
    )  # what other tests have left is no reason to pass one over
    recorder, reader = taken(tmp_path)
    taker = CensusTaker(recorder, 20, None)
    taker.start()
    try:
        until(lambda: len(read(reader).censuses) == 2, "two censuses")
        first = read(reader).censuses[0].at_ns
        until(lambda: read(reader).censuses[0].at_ns > first, "an older one to give way")
    finally:
        taker.stop()
    assert not [thread for thread in threading.enumerate() if thread.name == "census"]
    for one in read(reader).censuses:
        assert isinstance(one, Census)
        assert 0 < one.examined <= one.objects
        assert one.rss_bytes > 1 << 20
        assert one.took_ns > 0
        assert 0 < len(one.types) <= page.CENSUS_TYPES
        sizes = [each.size_bytes for each in one.types]
        assert sizes == sorted(sizes, reverse=True)
    reader.close()
    recorder.close()


def test_censuses_that_are_passed_over_are_told_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recorder, reader = taken(tmp_path)
    monkeypatch.setattr(census, "LISTING_MS_MAX", -1)
    taker = CensusTaker(recorder, 10, None)
    taker.start()
    try:
        until(lambda: bool(read(reader).events), "the event")
    finally:
        taker.stop()
    page_read = read(reader)
    assert [event.code for event in page_read.events] == ["CENSUS_PASSED_OVER"]
    assert page_read.events[0].text.endswith("ms to list")
    assert page_read.censuses == ()
    reader.close()
    recorder.close()
