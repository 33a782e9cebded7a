"""What a client was told of is asked of every core that comes after, and is never served without."""

from typing import TypeVar

from hardcore.model import actions as orders
from hardcore.model import observations as seen
from hardcore.model.phases import Phase
from hardcore.model.recorder import Witness
from hardcore.model.verdicts import Diagnosis
from tests.unit.recovery.play import Play, a_page, kinds, proven, raised

T = TypeVar("T")


def _spared() -> Play:
    return Play().begin().running(4).spared()


def _last(play: Play, kind: type[T]) -> T:
    return [order for order in play.ordered if isinstance(order, kind)][-1]


def _told(play: Play, seq: int, epoch: int) -> list[orders.Action]:
    return play.tell(seen.GatewayWitnessed(play.now_ns, Witness(seq, epoch, f"h{seq}")))


def test_what_a_client_was_told_is_a_witness_of_its_own() -> None:
    play = _spared()
    _told(play, 11, 4)
    play.die(page=a_page(4, seq=9))
    assert {w.seq for w in _last(play, orders.Promote).witnesses} == {9, 11}


def test_a_ledger_that_lacks_what_a_client_was_told_is_never_served() -> None:
    play = _spared()
    play.die(page=a_page(4, seq=9))
    raised(play, 5)
    _told(play, 11, 4)
    assert "Release" not in kinds(proven(play, 5, 9))
    assert play.phase is Phase.SNAPSHOT_LIVE
    play.tell(seen.EvidenceTaken(play.now_ns, play.life, complete=True, page=None))
    play.die()
    assert play.spawned().safe is Diagnosis.STORE_CORRUPT


def test_what_is_heard_of_later_has_the_core_read_only() -> None:
    play = _spared()
    play.die(page=a_page(4, seq=9))
    raised(play, 5)
    proven(play, 5, 9)
    given = _told(play, 11, 4)
    assert orders.SetSafe(play.life, True, Diagnosis.STORE_CORRUPT) in given


def test_a_late_word_of_what_the_ledger_has_is_no_news() -> None:
    play = _spared()
    play.die(page=a_page(4, seq=9))
    raised(play, 5)
    proven(play, 5, 9)
    assert _told(play, 9, 4) == []


def test_without_any_page_the_gateways_word_is_the_only_witness() -> None:
    play = Play().begin()
    play.tell(seen.GatewayWitnessed(play.now_ns, Witness(11, 4, "h11")))
    raised(play, 5)
    assert "Release" not in kinds(proven(play, 5, 9))


def test_who_accepts_the_ledger_hears_no_more_of_the_one_before() -> None:
    play = _spared()
    play.die(page=a_page(4, seq=9))
    play.die(seen.Exit(code=65), a_page(0, words="STORE_CORRUPT"))
    play.tell(seen.CoreReady(play.now_ns, play.life, 4, seen.Proof("none", 0, 9, "")))
    play.ring()
    play.tell(seen.OperatorAsked(play.now_ns, seen.Verb.RESUME, accept_ledger=True))
    _told(play, 11, 4)
    play.die(seen.Exit(code=0))
    assert play.spawned().witnesses == ()


def test_who_accepts_the_ledger_forgets_both_witnesses() -> None:
    play = _spared()
    _told(play, 11, 4)
    play.die(page=a_page(4, seq=9))
    play.die(seen.Exit(code=65), a_page(0, words="STORE_CORRUPT"))
    play.tell(seen.CoreReady(play.now_ns, play.life, 4, seen.Proof("none", 0, 9, "")))
    play.ring()
    play.tell(seen.OperatorAsked(play.now_ns, seen.Verb.RESUME, accept_ledger=True))
    play.die(seen.Exit(code=0))
    assert play.spawned() == orders.Spawn(play.life, None, ())


def _found(served: int) -> Play:
    """A guard that begins finds the page of a core that has served under this epoch, and starts another."""
    play = Play()
    play.tell(seen.SentinelBegan(play.now_ns, leftovers=True, page=a_page(served, seq=9)))
    play.tell(seen.CoreExited(play.now_ns, 0, seen.Exit(signal=9), None))
    return play


def test_the_gateways_word_of_a_core_without_a_page_counts_when_it_came_between() -> None:
    play = _found(4)
    _told(play, 11, 5)
    raised(play, 6)
    assert "Release" not in kinds(proven(play, 6, 9))
    assert play.phase is Phase.SNAPSHOT_LIVE


def test_it_counts_also_when_the_core_says_its_epoch_with_its_proof_only() -> None:
    play = _found(4)
    _told(play, 11, 5)
    assert "Release" not in kinds(proven(play, 6, 9))


def test_the_gateways_word_of_another_ledger_asks_nothing_of_one_that_was_put_back() -> None:
    play = _found(4)
    _told(play, 11, 7)
    raised(play, 5)
    assert "Release" in kinds(proven(play, 5, 9))
