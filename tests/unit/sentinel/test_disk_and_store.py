from hardcore.model.looks import DiskFacts, LockHolder
from hardcore.model.observations import StoreFault, StoreLooked, StoreTold, Surveyed
from hardcore.model.recorder import Witness
from hardcore.sentinel.seen_time import SeenTime
from hardcore.sentinel.witnesses import disk as disk_witness
from hardcore.sentinel.witnesses import store as store_witness
from hardcore.sentinel.witnesses.disk import Disk, DiskFindings
from hardcore.sentinel.witnesses.store import Store, StoreFindings
from tests.unit.sentinel.traces import MS, seen

ROOM = 1 << 30
FULL = DiskFacts(1 << 20, read_only=False, write_ns=5)
WELL = DiskFacts(ROOM, read_only=False, write_ns=5)


def _surveyed(*facts: DiskFacts | None, at_ms: int = 0, survey_ms: int = 1000) -> DiskFindings:
    disk = Disk(16 << 20, 2000, survey_ms)
    for n, fact in enumerate(facts):
        disk.hear(Surveyed((1000 + 1000 * n) * MS, 1, fact))
    return disk.find(seen(at_ms or 1000 * len(facts)))


def test_a_disk_is_full_when_two_surveys_say_so_since_the_first() -> None:
    assert _surveyed(FULL).full_since_ns == 0
    assert _surveyed(FULL, FULL).full_since_ns == 1000 * MS
    assert _surveyed(FULL, WELL, FULL).full_since_ns == 0


def test_a_survey_that_did_not_look_changes_nothing() -> None:
    assert _surveyed(FULL, None, FULL).full_since_ns == 1000 * MS


def test_a_read_only_file_system_is_not_called_full() -> None:
    found = _surveyed(*(DiskFacts(0, read_only=True, write_ns=None),) * 2)
    assert (found.full_since_ns, found.read_only_since_ns) == (0, 1000 * MS)


def test_a_survey_of_long_ago_says_nothing() -> None:
    assert _surveyed(FULL, FULL, at_ms=60_000) == DiskFindings()


def _pending(for_ms: int) -> DiskFacts:
    return DiskFacts(ROOM, read_only=False, write_ns=None, pending_ns=for_ms * MS)


def test_a_write_is_as_slow_as_it_was_when_somebody_looked() -> None:
    assert _surveyed(_pending(1500), at_ms=9000).slow_since_ns == 0
    found = _surveyed(WELL, WELL, WELL, _pending(2200), at_ms=4300)
    assert (found.slow_ns, found.slow_since_ns) == (2200 * MS, 1800 * MS)


def test_a_machine_that_was_away_is_no_slow_disk() -> None:
    disk, away = Disk(16 << 20, 2000, 1000), SeenTime(100 * MS)
    away.look(1000 * MS, late=False)
    away.look(11_000 * MS, late=True)
    disk.hear(Surveyed(11_000 * MS, 1, _pending(10_000)))
    assert disk.find(away).slow_since_ns == 0


def test_who_surveys_rarely_still_knows_of_a_full_disk_between_two_surveys() -> None:
    assert _surveyed(FULL, FULL, at_ms=60_000, survey_ms=60_000).full_since_ns == 1000 * MS
    assert _surveyed(_pending(9000), at_ms=60_000, survey_ms=60_000).slow_since_ns == 0


def test_a_write_that_took_long_is_slow() -> None:
    assert _surveyed(DiskFacts(ROOM, read_only=False, write_ns=2000 * MS)).slow_ns == 2000 * MS
    assert _surveyed(WELL).slow_since_ns == 0


def test_a_well_disk_says_nothing() -> None:
    assert disk_witness.testify(_surveyed(WELL, WELL)) is None
    told = disk_witness.testify(_surveyed(FULL, FULL))
    assert told is not None
    assert told.why == "1 MiB are free"


def _looked(*pids: int, at_ms: int = 0) -> StoreFindings:
    store = Store()
    for n, pid in enumerate(pids):
        holders = (LockHolder(1, "core", ours=True), LockHolder(pid, "sqlite3")) if pid else ()
        store.hear(StoreLooked((1000 + 500 * n) * MS, 1, holders))
    return store.find(None, seen(at_ms or 500 + 500 * len(pids)))


def test_the_same_stranger_is_counted_from_the_first_look() -> None:
    found = _looked(77, 77, 77)
    assert found.holder is not None
    assert (found.holder.pid, found.looks, found.held_since_ns) == (77, 3, 1000 * MS)


def test_another_stranger_begins_anew() -> None:
    found = _looked(77, 77, 78)
    assert (found.looks, found.held_since_ns) == (1, 2000 * MS)


def test_a_look_without_one_ends_it() -> None:
    assert _looked(77, 77, 0).holder is None
    assert _looked(77, 0, 77).looks == 1


def test_a_look_of_long_ago_says_nothing_about_now() -> None:
    assert _looked(77, 77, at_ms=9000) == StoreFindings()


def test_the_cores_word_stands_until_it_takes_it_back() -> None:
    store = Store()
    store.hear(StoreTold(1000 * MS, 1, StoreFault.FULL))
    store.hear(StoreTold(2000 * MS, 1, StoreFault.FULL))
    assert (store.find(None, seen(3000)).told, store.find(None, seen(3000)).told_ns) == (
        StoreFault.FULL,
        1000 * MS,
    )
    store.hear(StoreTold(4000 * MS, 1, StoreFault.OK))
    assert store.find(None, seen(5000)).told is StoreFault.OK


def test_a_commit_since_overtakes_the_cores_word() -> None:
    store = Store()
    store.hear(StoreTold(1000 * MS, 1, StoreFault.FULL))
    assert store.find(Witness(5, 4, "ab", 900 * MS), seen(1100)).told is StoreFault.FULL
    assert store.find(Witness(6, 4, "ab", 1050 * MS), seen(1100)).told is StoreFault.OK


def test_a_store_that_is_well_says_nothing() -> None:
    assert store_witness.testify(StoreFindings()) is None
    told = store_witness.testify(StoreFindings(StoreFault.READ_ONLY, 1))
    assert told is not None
    assert told.why == "the core says that its store takes no writes"
    held = store_witness.testify(_looked(77, 77))
    assert held is not None
    assert held.why == "process 77 (sqlite3) has held the store's write lock for 500 ms"
    assert store_witness.testify(_looked(77)) is None
