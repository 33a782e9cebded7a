from msgspec.structs import replace

from hardcore.model.looks import ProcessSample, ThreadSample
from hardcore.model.recorder import Beats
from hardcore.sentinel.witnesses import processor as witness
from hardcore.sentinel.witnesses.processor import Processor, ProcessorFacts
from tests.unit.sentinel import traces
from tests.unit.sentinel.traces import MS, seen

SILENT = Beats(loop_ns=1, thread_ns=1)
WAITING = ThreadSample("S", 0, "futex_do_wait")


def _sample(
    cpu_ms: int, loop: ThreadSample | None, beat: ThreadSample | None = None, busy: int | None = 0
) -> ProcessSample:
    return ProcessSample("S", cpu_ms * MS, 1, 4, loop=loop, beat=beat, busy=busy)


def _looked(
    *samples: ProcessSample, beats: tuple[Beats, ...] = (), collecting: tuple[int, ...] = ()
) -> ProcessorFacts:
    """What the last of these looks finds, one in 100 ms; `collecting` are the looks that find a collection."""
    processor, found = Processor(), ProcessorFacts()
    for n, sample in enumerate(samples):
        said = beats[n] if beats else SILENT
        found = processor.look(said, sample, seen(1000 + n * 100), collecting=n in collecting)
    return found


def test_what_is_burned_in_a_silence_adds_up() -> None:
    found = _looked(*(_sample(90 * n, traces.running(80 * n)) for n in range(4)))
    assert (found.loop_burned_ns, found.held_burned_ns) == (240 * MS, 270 * MS)


def test_a_beat_of_the_loop_ends_both_silences() -> None:
    beats = (SILENT, SILENT, replace(SILENT, loop_ns=2))
    found = _looked(*(_sample(90 * n, traces.running(80 * n)) for n in range(3)), beats=beats)
    assert (found.loop_all_ns, found.held_all_ns) == (0, 0)


def test_a_beat_of_the_thread_ends_its_silence_alone() -> None:
    beats = (SILENT, SILENT, replace(SILENT, thread_ns=2))
    found = _looked(*(_sample(90 * n, traces.running(80 * n)) for n in range(3)), beats=beats)
    assert (found.loop_all_ns, found.held_all_ns) == (160 * MS, 0)


def test_anything_completed_ends_them_all() -> None:
    beats = (SILENT, SILENT, replace(SILENT, completed=1))
    found = _looked(*(_sample(90 * n, traces.running(80 * n)) for n in range(3)), beats=beats)
    assert (found.loop_all_ns, found.held_all_ns) == (0, 0)


def test_nothing_burns_more_than_the_time_there_was() -> None:
    found = _looked(_sample(0, traces.running(0)), _sample(900, traces.running(900)))
    assert (found.loop_all_ns, found.held_all_ns) == (100 * MS, 100 * MS)


def test_a_collection_is_charged_to_itself() -> None:
    found = _looked(*(_sample(90 * n, traces.running(80 * n)) for n in range(4)), collecting=(1, 2))
    assert (found.loop_burned_ns, found.loop_all_ns) == (80 * MS, 240 * MS)


def test_after_an_amnesty_everything_is_counted_anew() -> None:
    processor = Processor()
    for n in range(3):
        processor.look(SILENT, _sample(90 * n, traces.running(80 * n)), seen(n * 100 + 100), collecting=False)
    anew = seen(400, since_ms=400)
    found = processor.look(SILENT, _sample(270, traces.running(240)), anew, collecting=False)
    assert (found.loop_all_ns, found.held_all_ns) == (0, 0)


def test_who_wakes_up_again_and_again_asks_for_the_interpreter() -> None:
    looks = [_sample(0, traces.NAPPING, traces.asking(100 * n)) for n in range(5)]
    assert _looked(*looks).idle_ns == 400 * MS


def test_a_healthy_thread_that_sleeps_between_two_beats_asks_for_nothing() -> None:
    beating = [ThreadSample("S", n * MS, "futex_do_wait", 0, 4 * n) for n in range(5)]
    assert _looked(*(_sample(0, traces.NAPPING, beat) for beat in beating)).idle_ns == 0


def test_somebody_busy_has_the_interpreter_and_uses_it() -> None:
    looks = [_sample(0, traces.asking(100 * n), traces.asking(100 * n), busy=1) for n in range(5)]
    assert _looked(*looks).idle_ns == 0


def test_a_process_that_computes_is_not_idle() -> None:
    looks = [_sample(50 * n, traces.asking(100 * n), traces.asking(100 * n)) for n in range(5)]
    assert _looked(*looks).idle_ns == 0


def test_who_has_the_interpreter_is_known_if_all_were_looked_at_or_it_is_the_loop() -> None:
    def known(loop: ThreadSample, busy: int | None) -> bool:
        return _looked(*(_sample(0, loop, traces.asking(100 * n), busy) for n in range(3))).idle_known

    assert known(WAITING, 0)
    assert known(traces.NAPPING, None)
    assert not known(WAITING, None)


def test_a_thread_that_was_ready_and_not_let_is_starved() -> None:
    assert _looked(*(_sample(0, traces.unlet(100 * n)) for n in range(4))).starved_ns == 300 * MS


def test_a_thread_that_had_its_share_is_not() -> None:
    assert _looked(*(_sample(0, traces.running(50 * n)) for n in range(4))).starved_ns == 0


def test_without_a_sample_of_the_loop_nothing_is_said_of_it() -> None:
    found = _looked(*(_sample(90 * n, None) for n in range(4)))
    assert (found.loop_all_ns, found.starved_ns, found.idle_ns, found.queued_ns) == (0, 0, 0, 0)


def test_it_speaks_only_of_what_is_long() -> None:
    assert witness.testify(ProcessorFacts(loop_all_ns=299 * MS), 300) is None
    assert witness.testify(ProcessorFacts(loop_all_ns=300 * MS), 300) is not None
    starved = witness.testify(ProcessorFacts(starved_ns=300 * MS), 300)
    assert starved is not None
    assert "not scheduled" in starved.why
