"""Witnesses that are never part of a red verdict's reason: conduct, memory, resources; and collections."""

from hardcore.model.looks import Conduct, ProcessSample
from hardcore.model.observations import Surveyed
from hardcore.model.recorder import Beats
from hardcore.model.verdicts import Colour, Verdict
from hardcore.sentinel.lasting import Lasting
from hardcore.sentinel.verdict import Bench
from hardcore.sentinel.witnesses import collection, resources
from hardcore.sentinel.witnesses.collection import Collection, CollectionFacts
from hardcore.sentinel.witnesses.conduct import ConductWatch
from hardcore.sentinel.witnesses.memory import TOLD_NS, MemoryKills
from hardcore.sentinel.witnesses.own_stall import OFTEN_WITHIN_NS, OwnStall
from tests.unit.sentinel.traces import BEGAN_MS, MS, PATIENCE, seen, well

STRANGE = Conduct(
    children=("1: sh", "2: sh", "3: sh", "4: sh"), code=("core/main.py",), ports=("0.0.0.0:80",)
)


def _judged(fact: Surveyed) -> list[Verdict]:
    bench = Bench(PATIENCE)
    bench.hear(fact)
    return [bench.judge(look.sampled()) for look in well(20_000)]


def test_strange_conduct_is_told_and_never_more() -> None:
    verdicts = _judged(Surveyed(BEGAN_MS * MS, 1, conduct=STRANGE))
    assert {verdict.colour for verdict in verdicts} == {Colour.YELLOW}
    assert {verdict.diagnosis for verdict in verdicts} == {None}


def test_each_kind_of_conduct_is_told_by_a_few_facts() -> None:
    watch = ConductWatch()
    assert watch.testify() == ()
    watch.hear(Surveyed(1, 1, conduct=STRANGE))
    watch.hear(Surveyed(2, 1))
    assert [testimony.why for testimony in watch.testify()] == [
        "children: 1: sh; 2: sh; 3: sh; and 1 more",
        "code: core/main.py",
        "ports: 0.0.0.0:80",
    ]
    watch.hear(Surveyed(3, 1, conduct=Conduct()))
    assert watch.testify() == ()


def test_a_kill_for_memory_beside_a_living_core_is_told_for_a_while() -> None:
    kills = MemoryKills()
    kills.hear(Surveyed(1 * MS, 1, oom_kills=0))
    assert kills.testify(1 * MS) is None
    kills.hear(Surveyed(2 * MS, 1, oom_kills=1))
    kills.hear(Surveyed(3 * MS, 1))
    assert kills.testify(3 * MS) is not None
    assert kills.testify(3 * MS + TOLD_NS) is None
    assert {v.colour for v in _judged(Surveyed(BEGAN_MS * MS, 1, oom_kills=2))} == {Colour.YELLOW}


def test_more_memory_than_allowed_is_told() -> None:
    sample = ProcessSample("S", 0, 600 << 20, 4)
    assert resources.testify(sample, 0) is None
    assert resources.testify(sample, 600 << 20) is None
    told = resources.testify(sample, 512 << 20)
    assert told is not None
    assert told.why == "the core holds 600 MiB of memory; 512 MiB are allowed"


def test_a_collection_touches_the_interval_it_ended_in() -> None:
    witness = Collection()
    found = [witness.look(Beats(gc_since_ns=since), at) for at, since in ((1, 0), (20, 15), (30, 0), (40, 0))]
    assert [facts.touched for facts in found] == [False, True, True, False]
    assert found[1] == CollectionFacts(touched=True, running=True, for_ns=5)
    assert collection.testify(found[0]) is None
    assert collection.testify(found[1]) is not None


def test_what_lasts_must_hold_in_every_look() -> None:
    lasting = Lasting()
    assert lasting.look(True, seen(200)) == 100 * MS
    assert lasting.look(True, seen(300)) == 200 * MS
    assert lasting.look(False, seen(400)) == 0
    assert lasting.look(True, seen(500)) == 100 * MS
    assert lasting.look(True, seen(600, since_ms=550)) == 50 * MS


def test_a_look_that_was_not_made_confirms_nothing() -> None:
    lasting = Lasting()
    assert lasting.look(True, seen(200)) == 100 * MS
    assert lasting.look(True, seen(500)) == 100 * MS


def test_three_late_ticks_within_a_few_seconds_are_often() -> None:
    stall = OwnStall(100 * MS)
    for at_ms in (0, 300, 600):
        stall.look(at_ms * MS)
    assert not stall.often(600 * MS)
    stall.look(900 * MS)
    assert stall.often(900 * MS)
    assert not stall.often(901 * MS + OFTEN_WITHIN_NS)
