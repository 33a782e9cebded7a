from hardcore.model.observations import (
    DiskFacts,
    LockHolder,
    StoreFault,
    StoreLooked,
    StoreTold,
    Surveyed,
)
from hardcore.model.recorder import Witness
from hardcore.sentinel.witnesses import disk as disk_witness
from hardcore.sentinel.witnesses import store as store_witness
from hardcore.sentinel.witnesses.disk import Disk, DiskFindings
from hardcore.sentinel.witnesses.store import Store, StoreFindings
from tests.unit.sentinel.traces import MS

ROOM = 1 << 30
FULL = DiskFacts(1 << 20, read_only=False, write_ns=5)
WELL = DiskFacts(ROOM, read_only=False, write_ns=5)


def _surveyed(*facts: DiskFacts | None, at_ms: int = 0) -> DiskFindings:
    disk = Disk(16 << 20, 2000)
    for n, fact in enumerate(facts):
        disk.hear(Surveyed((1000 + 1000 * n) * MS, 1, fact))
    return disk.find((at_ms or 1000 * len(facts)) * MS)


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


def test_a_write_that_does_not_come_back_gets_slower_by_itself() -> None:
    pending = DiskFacts(ROOM, read_only=False, write_ns=None, pending_ns=1500 * MS)
    assert _surveyed(pending).slow_since_ns == 0
    found = _surveyed(pending, at_ms=1700)
    assert found.slow_ns == 2200 * MS


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
    return store.find(None, (at_ms or 500 + 500 * len(pids)) * MS)


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
    assert (store.find(None, 3000 * MS).told, store.find(None, 3000 * MS).told_ns) == (
        StoreFault.FULL,
        1000 * MS,
    )
    store.hear(StoreTold(4000 * MS, 1, StoreFault.OK))
    assert store.find(None, 5000 * MS).told is StoreFault.OK


def test_a_commit_since_overtakes_the_cores_word() -> None:
    store = Store()
    store.hear(StoreTold(1000 * MS, 1, StoreFault.FULL))
    assert store.find(Witness(5, 4, "ab", 900 * MS), 1100 * MS).told is StoreFault.FULL
    assert store.find(Witness(6, 4, "ab", 1050 * MS), 1100 * MS).told is StoreFault.OK


def test_a_store_that_is_well_says_nothing() -> None:
    assert store_witness.testify(StoreFindings(), 0) is None
    told = store_witness.testify(StoreFindings(StoreFault.READ_ONLY, 1), 0)
    assert told is not None
    assert told.why == "the core says that its store takes no writes"
    held = store_witness.testify(_looked(77, 77), 1500 * MS)
    assert held is not None
    assert held.why == "process 77 (sqlite3) has held the store's write lock for 500 ms"
    assert store_witness.testify(_looked(77), 1000 * MS) is None
