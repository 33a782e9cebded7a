import signal

import pytest

from hardcore.model.looks import DiskFacts
from hardcore.model.observations import Exit
from hardcore.model.recorder import LastWords
from hardcore.model.verdicts import Diagnosis, Grade
from hardcore.sentinel.deaths import SIGNAL_NAMES, describe, judge_death, own_fault

OWN = [
    signal.SIGILL,
    signal.SIGTRAP,
    signal.SIGABRT,
    signal.SIGBUS,
    signal.SIGFPE,
    signal.SIGSEGV,
    signal.SIGSYS,
]
FOREIGN = [signal.SIGKILL, signal.SIGTERM, signal.SIGHUP, signal.SIGINT, signal.SIGQUIT, signal.SIGXCPU]
CODES = {
    65: Diagnosis.STORE_CORRUPT,
    69: Diagnosis.DB_LOCKED,
    73: Diagnosis.DISK_FULL,
    74: Diagnosis.COMMIT_FAILED,
    75: Diagnosis.FENCED,
    78: Diagnosis.CONFIG_INVALID,
}


def _named(how: Exit, *, words: str = "", ready: bool = True, term: bool = False) -> tuple[Diagnosis, Grade]:
    said = LastWords(1, words, "why") if words else None
    death = judge_death(how, said, was_ready=ready, term_sent=term)
    return death.diagnosis, death.grade


@pytest.mark.parametrize("number", OWN)
@pytest.mark.parametrize("ready", [True, False])
@pytest.mark.parametrize("term", [True, False])
def test_a_signal_of_its_own_is_a_crash_whatever_else_is_true(number: int, ready: bool, term: bool) -> None:
    assert _named(Exit(signal=number), ready=ready, term=term) == (Diagnosis.CRASHED, Grade.CERTAIN)


@pytest.mark.parametrize("number", FOREIGN)
def test_a_signal_from_outside_is_no_fault_of_its_own(number: int) -> None:
    assert _named(Exit(signal=number))[0] is Diagnosis.KILLED_FROM_OUTSIDE


def test_only_a_sigkill_is_certainly_from_outside() -> None:
    assert _named(Exit(signal=9))[1] is Grade.CERTAIN
    assert _named(Exit(signal=15))[1] is Grade.LIKELY


@pytest.mark.parametrize(("code", "diagnosis"), CODES.items())
def test_the_codes_of_the_wire_mean_what_it_says(code: int, diagnosis: Diagnosis) -> None:
    assert _named(Exit(code=code), words=diagnosis) == (diagnosis, Grade.CERTAIN)


def test_a_disk_that_may_not_be_written_is_told_from_one_that_is_full() -> None:
    assert _named(Exit(code=73), words="DISK_READ_ONLY") == (Diagnosis.DISK_READ_ONLY, Grade.CERTAIN)
    assert _named(Exit(code=74), words="DISK_READ_ONLY")[0] is Diagnosis.COMMIT_FAILED, "no other code's word"


def test_a_database_that_is_away_is_told_from_a_lock_that_somebody_holds() -> None:
    assert _named(Exit(code=69), words="STORE_AWAY") == (Diagnosis.STORE_AWAY, Grade.CERTAIN)
    assert _named(Exit(code=78), words="STORE_AWAY")[0] is Diagnosis.CONFIG_INVALID, "no other code's word"


@pytest.mark.parametrize(
    ("fault", "diagnosis"),
    [
        ("EROFS", Diagnosis.DISK_READ_ONLY),
        ("EIO", Diagnosis.DISK_READ_ONLY),
        ("ENOSPC", Diagnosis.DISK_FULL),
        ("", Diagnosis.COMMIT_FAILED),
    ],
)
def test_a_commit_that_failed_is_the_disks_doing_where_our_own_write_fails_too(
    fault: str, diagnosis: Diagnosis
) -> None:
    seen = DiskFacts(free_bytes=1 << 30, read_only=False, write_ns=1, fault=fault)
    words = LastWords(1, "COMMIT_FAILED", "why")
    death = judge_death(Exit(code=74), words, was_ready=True, term_sent=False, disk=seen)
    assert (death.diagnosis, death.grade) == (diagnosis, Grade.CERTAIN)
    assert ("disk" in {fact.witness for fact in death.evidence}) == bool(fault)


def test_a_refusing_disk_explains_no_other_end() -> None:
    seen = DiskFacts(free_bytes=1 << 30, read_only=True, write_ns=1, fault="EROFS")
    death = judge_death(Exit(signal=11), None, was_ready=True, term_sent=False, disk=seen)
    assert death.diagnosis is Diagnosis.CRASHED


@pytest.mark.parametrize("code", CODES)
def test_a_code_without_last_words_is_only_likely(code: int) -> None:
    assert _named(Exit(code=code))[1] is Grade.LIKELY


@pytest.mark.parametrize("code", [0, 1, 2, 66, 127, 137, 255])
def test_any_other_unasked_end_of_a_core_that_served_is_an_exit(code: int) -> None:
    assert _named(Exit(code=code)) == (Diagnosis.EXITED, Grade.CERTAIN)


@pytest.mark.parametrize("code", [0, 1, 137])
def test_an_end_before_it_served_is_a_failed_start(code: int) -> None:
    assert _named(Exit(code=code), ready=False) == (Diagnosis.STARTUP_FAILED, Grade.CERTAIN)


def test_leaving_because_a_stranger_said_so_is_from_outside() -> None:
    assert _named(Exit(code=0), term=True) == (Diagnosis.KILLED_FROM_OUTSIDE, Grade.CERTAIN)


def test_failing_after_a_strangers_term_is_still_its_own_exit() -> None:
    assert _named(Exit(code=1), term=True)[0] is Diagnosis.EXITED


def test_an_end_that_nobody_could_read_is_told_as_unknown() -> None:
    assert _named(Exit()) == (Diagnosis.EXITED, Grade.UNKNOWN)


def test_137_alone_is_no_proof_of_anything() -> None:
    assert _named(Exit(code=137))[0] is not Diagnosis.OUT_OF_MEMORY


def test_a_sigkill_that_the_kernel_counted_for_memory_is_a_lack_of_memory() -> None:
    death = judge_death(Exit(signal=9), None, was_ready=True, term_sent=False, oom_kills=1)
    assert (death.diagnosis, death.grade) == (Diagnosis.OUT_OF_MEMORY, Grade.CERTAIN)
    assert "memory" in {fact.witness for fact in death.evidence}


@pytest.mark.parametrize(
    ("how", "kills"),
    [
        (Exit(signal=9), 0),
        (Exit(signal=9), None),
        (Exit(code=137), 1),
        (Exit(signal=11), 1),
        (Exit(code=1), 1),
    ],
)
def test_without_the_kernels_count_and_its_signal_nothing_is_a_lack_of_memory(
    how: Exit, kills: int | None
) -> None:
    death = judge_death(how, None, was_ready=True, term_sent=False, oom_kills=kills)
    assert death.diagnosis is not Diagnosis.OUT_OF_MEMORY


def test_the_facts_behind_a_death_are_told() -> None:
    death = judge_death(Exit(code=74), LastWords(1, "COMMIT_FAILED", "fsync"), was_ready=True, term_sent=True)
    assert [fact.witness for fact in death.evidence] == ["pidfd", "last words", "core"]
    assert death.evidence[0].why == "the core exited with code 74"


def test_a_way_to_end_is_told_in_words() -> None:
    assert describe(Exit(signal=11)) == "ended by SIGSEGV"
    assert describe(Exit(signal=63)) == "ended by signal 63"
    assert describe(Exit(code=0)) == "exited with code 0"
    assert describe(Exit()) == "is gone; nobody could read its exit status"


@pytest.mark.parametrize(("number", "name"), SIGNAL_NAMES.items())
def test_the_names_of_signals_are_linuxs(number: int, name: str) -> None:
    assert signal.Signals[name].value == number


@pytest.mark.parametrize("number", OWN)
def test_a_crash_while_it_was_leaving_is_still_a_crash(number: int) -> None:
    assert own_fault(Exit(signal=number)) is Diagnosis.CRASHED


@pytest.mark.parametrize("how", [Exit(code=0), Exit(signal=9), Exit(signal=15), Exit(), Exit(code=75)])
def test_leaving_when_asked_is_no_fault(how: Exit) -> None:
    assert own_fault(how) is None


def test_failing_instead_of_leaving_is_a_fault() -> None:
    assert own_fault(Exit(code=1)) is Diagnosis.EXITED


def test_an_end_that_nobody_could_read_is_named_by_what_the_core_said() -> None:
    assert _named(Exit(), words="STORE_CORRUPT") == (Diagnosis.STORE_CORRUPT, Grade.LIKELY)
    assert _named(Exit(), words="BUG") == (Diagnosis.EXITED, Grade.LIKELY)
