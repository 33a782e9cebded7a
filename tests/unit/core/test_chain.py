from hashlib import sha256
from typing import Any

import msgspec

from core.journal.attestation import NOTHING
from core.journal.chain import GENESIS, EventRow, check_link, hash_of
from core.journal.proof import (
    ProofKind,
    Proven,
    Tail,
    Walk,
    Witness,
    prove,
)


def row(seq: int, before: bytes, epoch: int = 1, key: str | None = None) -> EventRow:
    made = EventRow(seq, epoch, 1_795_000_000, "account.closed", f"c{seq}", key, b'{"id":"a"}')
    return msgspec.structs.replace(made, hash=hash_of(before, made))


def chain(count: int, *, keyed: bool = False) -> list[EventRow]:
    rows: list[EventRow] = []
    for seq in range(1, count + 1):
        rows.append(row(seq, rows[-1].hash if rows else GENESIS, key=f"k{seq}" if keyed else None))
    return rows


def tail(chained: list[EventRow], first: int = 1, **changes: Any) -> Tail:
    """What is read of a chain when a walk has come to just before its event `first`."""
    head = chained[-1]
    last = chained[first - 2] if first > 1 else None
    made = Tail(
        head_seq=head.seq,
        head_hash=head.hash,
        epoch=2,
        walk=Walk(None if last else NOTHING, last),
        hashes={event.seq: event.hash for event in changes.pop("stored", chained)},
        rows=chained[first - 1 :],
        keys={event.seq: event.key for event in chained[first - 1 :] if event.key is not None},
        moved={},
        balances=[],
    )
    return msgspec.structs.replace(made, **changes)


def seen(event: EventRow) -> Witness:
    return Witness(event.seq, event.epoch, event.hash)


def place(found: object) -> tuple[int | None, str]:
    assert not isinstance(found, Proven), found
    return found.seq, found.sentence  # type: ignore[attr-defined]  # the other type there is


def test_the_hash_is_what_the_description_says() -> None:
    event = EventRow(3, 2, 5, "kind", "cmd", None, b"body")
    data = bytes(range(32))
    data += (3).to_bytes(8, "little") + (2).to_bytes(8, "little") + (5).to_bytes(8, "little")
    data += (4).to_bytes(4, "little") + b"kind" + (3).to_bytes(4, "little") + b"cmd" + b"\xff\xff\xff\xff"
    assert hash_of(bytes(range(32)), event) == sha256(data + b"body").digest()


def test_no_part_of_an_event_can_move_into_its_neighbour() -> None:
    first = EventRow(1, 1, 1, "ab", "c", "k", b"x")
    others = (
        msgspec.structs.replace(first, kind="a", command_id="bc"),
        msgspec.structs.replace(first, key=None, body=b"kx"),
        msgspec.structs.replace(first, key=""),
    )
    assert all(hash_of(GENESIS, first) != hash_of(GENESIS, other) for other in others)


def test_a_whole_chain_links() -> None:
    rows = [None, *chain(5)]
    assert all(check_link(rows[n], rows[n + 1]) is None for n in range(5))  # type: ignore[arg-type]


def test_a_tail_is_proven_from_where_a_walk_has_come_with_a_witness_before_it() -> None:
    rows = chain(10, keyed=True)
    assert prove(tail(rows, 7), [seen(rows[2])]) == Proven(ProofKind.WITNESS, 4, 10, rows[-1].hash)


def test_what_was_hashed_before_in_the_same_life_counts_as_hashed_for_the_proof() -> None:
    rows = chain(10)
    found = tail(rows, 7)
    found.walk.checked = 6
    assert prove(found, ()) == Proven(ProofKind.CHAIN, 10, 10, rows[-1].hash)


def test_a_head_ahead_of_the_witness_is_normal() -> None:
    rows = chain(3)
    assert isinstance(prove(tail(rows, 2), [seen(rows[1])]), Proven)


def test_without_a_witness_the_proof_says_that_it_rests_on_the_chain() -> None:
    rows = chain(10)
    assert prove(tail(rows, 7), ()) == Proven(ProofKind.CHAIN, 4, 10, rows[-1].hash)


def test_an_empty_book_is_whole() -> None:
    empty = Tail(0, GENESIS, 1, Walk(NOTHING, None), {}, [], {}, {}, [])
    assert prove(empty, ()) == Proven(ProofKind.CHAIN, 0, 0, GENESIS)


def test_a_head_behind_the_witness_is_a_lost_event() -> None:
    rows = chain(5)
    assert place(prove(tail(rows[:3], 3), [seen(rows[4])]))[0] == 4


def test_another_hash_under_the_witnessed_number_is_found() -> None:
    rows = chain(5)
    witness = msgspec.structs.replace(seen(rows[2]), hash=bytes(32))
    assert place(prove(tail(rows, 3), [witness]))[0] == 3


def test_a_witness_told_by_a_later_core_that_committed_nothing_names_the_same_event() -> None:
    rows = chain(5)
    witness = msgspec.structs.replace(seen(rows[4]), epoch=rows[4].epoch + 1)
    assert isinstance(prove(tail(rows, 5), [witness]), Proven)


def test_a_flipped_bit_is_found_where_it_is() -> None:
    rows = chain(5)
    rows[3] = msgspec.structs.replace(rows[3], body=b'{"id":"b"}')
    assert place(prove(tail(rows, 2), ()))[0] == 4


def test_a_missing_event_is_found_where_it_was() -> None:
    rows = chain(5)
    assert place(prove(tail(rows, rows=[*rows[:2], *rows[3:]]), ()))[0] == 3


def test_an_event_missing_just_before_the_tail_is_found() -> None:
    rows = chain(5)
    assert place(prove(tail(rows, 4, stored=[*rows[:2], *rows[3:]]), ()))[0] == 3


def test_an_event_that_changed_after_a_walk_has_met_it_is_found() -> None:
    rows = chain(5)
    changed = [*rows[:2], msgspec.structs.replace(rows[2], hash=bytes(32)), *rows[3:]]
    assert place(prove(tail(rows, 4, stored=changed), ()))[0] == 3


def test_a_cut_off_end_is_found() -> None:
    rows = chain(5)
    assert place(prove(tail(rows, rows=rows[:4]), ()))[0] == 5


def test_events_past_the_head_are_found() -> None:
    rows = chain(5)
    assert place(prove(tail(rows, head_seq=4, head_hash=rows[3].hash), ()))[0] == 5


def test_an_epoch_never_goes_back() -> None:
    first = row(1, GENESIS, epoch=2)
    rows = [first, row(2, first.hash, epoch=1)]
    assert place(prove(tail(rows), ()))[0] == 2


def test_an_event_and_its_key_name_each_other() -> None:
    rows = chain(3, keyed=True)
    assert place(prove(tail(rows, keys={1: "k1", 3: "k3"}), ()))[0] == 2
    assert place(prove(tail(rows, keys={1: "k1", 2: "other", 3: "k3"}), ()))[0] == 2
    assert place(prove(tail(rows, keys={1: "k1", 2: "k2", 3: "k3", 9: "k9"}), ()))[0] == 9


def test_accounts_that_do_not_add_up_are_found() -> None:
    seq, sentence = place(prove(tail(chain(2), balances=[("a", "KRW", 0), ("b", "USD", 3)]), ()))
    assert seq is None
    assert "USD" in sentence


def test_balances_that_what_was_posted_does_not_lead_to_are_found() -> None:
    whole = [("a", "KRW", 5), ("b", "KRW", -5)]
    assert isinstance(prove(tail(chain(2), balances=whole, moved={"a": 5, "b": -5}), ()), Proven)
    for moved in ({"a": 4, "b": -4}, {}, {"a": 5, "b": -5, "c": 1}):
        seq, sentence = place(prove(tail(chain(2), balances=whole, moved=moved), ()))
        assert seq is None
        assert "posted" in sentence


def test_every_witness_is_asked_and_the_one_that_objects_is_named() -> None:
    rows = chain(5)
    good, other = seen(rows[4]), msgspec.structs.replace(seen(rows[1]), epoch=7, hash=bytes(32))
    assert isinstance(prove(tail(rows, 3), [good, seen(rows[0])]), Proven)
    seq, sentence = place(prove(tail(rows, 3), [good, other]))
    assert seq == 2
    assert "witness 2 of 2, of epoch 7" in sentence
    seq, sentence = place(prove(tail(rows[:4], 3), [other, good]))
    assert (seq, "witness 1 of 2" in sentence) == (2, True)
