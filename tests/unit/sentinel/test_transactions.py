from msgspec.structs import replace

from hardcore.model.looks import ThreadSample
from hardcore.model.recorder import CommandNote
from hardcore.sentinel.seen_time import SeenTime
from hardcore.sentinel.witnesses import transactions as witness
from hardcore.sentinel.witnesses.transactions import Deciding, Transactions
from tests.unit.sentinel import traces
from tests.unit.sentinel.traces import BEGAN_MS, DECIDER, MS, deciding_since, queued


class Watch:
    def __init__(self, limit_ms: int = 0) -> None:
        self.transactions = Transactions()
        self.seen = SeenTime(100 * MS)
        self.seen.look(BEGAN_MS * MS, late=False)
        self.limit_ms = limit_ms

    def look(
        self,
        at_ms: int,
        notes: tuple[CommandNote, ...] | None,
        sample: ThreadSample | None = None,
        *,
        late: bool = False,
    ) -> tuple[Deciding, ...]:
        threads = ((DECIDER, sample),) if sample else ()
        self.seen.look((BEGAN_MS + at_ms) * MS, late=late)
        return self.transactions.look(notes, threads, self.limit_ms, self.seen)


def _one(found: tuple[Deciding, ...]) -> Deciding:
    assert len(found) == 1
    return found[0]


def test_the_time_runs_from_when_it_was_taken_up() -> None:
    found = _one(Watch().look(500, deciding_since(100)))
    assert (found.counted_ns, found.overdue) == (400 * MS, False)
    assert _one(Watch().look(1100, deciding_since(100))).overdue


def test_progress_later_than_that_begins_it_anew() -> None:
    assert _one(Watch().look(500, deciding_since(100, progress_ms=300))).counted_ns == 200 * MS


def test_what_only_waits_or_is_torn_is_not_looked_at() -> None:
    torn = tuple(replace(note, torn=True) for note in deciding_since(100))
    assert Watch().look(500, (*queued(0), *torn)) == ()
    assert Watch().look(500, None) == ()


def test_a_limit_of_the_page_comes_before_the_policys() -> None:
    assert _one(Watch(300).look(500, deciding_since(100))).limit_ns == 1000 * MS
    assert _one(Watch(300).look(500, deciding_since(100, limit_ms=0))).overdue
    assert not _one(Watch(0).look(9999, deciding_since(100, limit_ms=0))).overdue


def test_time_in_which_its_thread_was_not_let_is_excused() -> None:
    watch = Watch()
    watch.look(200, deciding_since(100), ThreadSample("R", 5, "", 0))
    found = _one(watch.look(300, deciding_since(100), ThreadSample("R", 5, "", 80 * MS)))
    assert found.counted_ns == 120 * MS


def test_time_in_which_it_waits_for_a_disk_is_excused() -> None:
    watch = Watch()
    watch.look(200, deciding_since(100), traces.ON_DISK)
    found = _one(watch.look(300, deciding_since(100), traces.ON_DISK))
    assert (found.counted_ns, found.in_disk) == (100 * MS, True)


def test_time_that_nobody_was_there_to_see_is_never_charged_to_a_command() -> None:
    watch = Watch()
    watch.look(200, deciding_since(100))
    assert _one(watch.look(9000, deciding_since(100), late=True)).counted_ns == 200 * MS


def test_it_is_not_charged_either_when_the_late_look_did_not_read_the_commands() -> None:
    watch = Watch()
    watch.look(200, deciding_since(100))
    watch.look(9000, None, late=True)
    assert _one(watch.look(9100, deciding_since(100))).counted_ns == 300 * MS


def test_nor_to_a_command_that_was_first_read_after_it() -> None:
    watch = Watch()
    watch.look(200, None)
    watch.look(9000, None, late=True)
    assert _one(watch.look(9100, deciding_since(150))).counted_ns == 250 * MS


def test_a_wait_for_a_disk_is_excused_once_though_we_came_late() -> None:
    watch = Watch()
    watch.look(200, deciding_since(100), traces.ON_DISK)
    watch.look(9000, deciding_since(100), traces.ON_DISK, late=True)
    assert _one(watch.look(9100, deciding_since(100), traces.ON_DISK)).counted_ns == 100 * MS


def test_an_excuse_ends_with_its_command() -> None:
    watch = Watch()
    watch.look(200, deciding_since(100), traces.ON_DISK)
    watch.look(300, deciding_since(100), traces.ON_DISK)
    assert _one(watch.look(400, deciding_since(350), traces.NAPPING)).counted_ns == 50 * MS
    assert watch.look(500, ()) == ()


def test_how_long_it_was_watched_is_told() -> None:
    watch = Watch()
    assert _one(watch.look(200, deciding_since(100))).watched_ns == 0
    assert _one(watch.look(350, deciding_since(100))).watched_ns == 150 * MS


def test_who_sleeps_on_a_lock_is_known() -> None:
    assert _one(Watch().look(200, deciding_since(100), traces.LOCKED)).in_lock
    assert not _one(Watch().look(200, deciding_since(100), traces.NAPPING)).in_lock


def test_what_is_over_its_time_is_named() -> None:
    assert witness.testify(Watch().look(500, deciding_since(100))) is None
    told = witness.testify(Watch().look(1500, deciding_since(100)))
    assert told is not None
    assert told.why == "transaction t1 has been decided for 1400 ms; it may take 1000 ms"
