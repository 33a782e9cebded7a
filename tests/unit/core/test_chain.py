from dataclasses import replace
from hashlib import sha256

from core.journal.chain import GENESIS, EventRow, check_link, hash_of
from core.journal.proof import (
    ProofKind,
    Proven,
    Tail,
    Witness,
    prove,
    tail_start,
)


def row(seq: int, before: bytes, epoch: int = 1, key: str | None = None) -> EventRow:
    made = EventRow(seq, epoch, 1_795_000_000, "account.closed", f"c{seq}", key, b'{"id":"a"}')
    return replace(made, hash=hash_of(before, made))


def chain(count: int, *, keyed: bool = False) -> list[EventRow]:
    rows: list[EventRow] = []
    for seq in range(1, count + 1):
        rows.append(row(seq, rows[-1].hash if rows else GENESIS, key=f"k{seq}" if keyed else None))
    return rows


def tail(chained: list[EventRow], first: int = 1, **changes: object) -> Tail:
    head = chained[-1]
    made = Tail(
        head_seq=head.seq,
        head_hash=head.hash,
        epoch=2,
        first_seq=first,
        before=chained[first - 2] if first > 1 else None,
        rows=chained[first - 1 :],
        balances={"KRW": 0},
        keys={event.seq: event.key for event in chained[first - 1 :] if event.key is not None},
    )
    return replace(made, **changes)  # type: ignore[arg-type]  # the names are checked at run time


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
        replace(first, kind="a", command_id="bc"),
        replace(first, key=None, body=b"kx"),
        replace(first, key=""),
    )
    assert all(hash_of(GENESIS, first) != hash_of(GENESIS, other) for other in others)


def test_a_whole_chain_links() -> None:
    rows = [None, *chain(5)]
    assert all(check_link(rows[n], rows[n + 1]) is None for n in range(5))  # type: ignore[arg-type]


def test_a_tail_is_proven_from_its_witness_on() -> None:
    rows = chain(10, keyed=True)
    assert tail_start(10, seen(rows[6]), 1_000) == 7
    assert prove(tail(rows, 7), seen(rows[6])) == Proven(ProofKind.WITNESS, 4, 10, rows[-1].hash)


def test_a_head_ahead_of_the_witness_is_normal() -> None:
    rows = chain(3)
    assert isinstance(prove(tail(rows, 2), seen(rows[1])), Proven)


def test_without_a_witness_the_proof_says_that_it_rests_on_the_chain() -> None:
    rows = chain(10)
    assert tail_start(10, None, 4) == 7
    assert prove(tail(rows, 7), None) == Proven(ProofKind.CHAIN, 4, 10, rows[-1].hash)


def test_an_empty_book_is_whole() -> None:
    empty = Tail(0, GENESIS, 1, 1, None, [], {}, {})
    assert prove(empty, None) == Proven(ProofKind.CHAIN, 0, 0, GENESIS)


def test_a_head_behind_the_witness_is_a_lost_event() -> None:
    rows = chain(5)
    assert place(prove(tail(rows[:3], 3), seen(rows[4])))[0] == 4


def test_another_hash_under_the_witnessed_number_is_found() -> None:
    rows = chain(5)
    witness = replace(seen(rows[2]), hash=bytes(32))
    assert place(prove(tail(rows, 3), witness))[0] == 3


def test_a_witness_told_by_a_later_core_that_committed_nothing_names_the_same_event() -> None:
    rows = chain(5)
    witness = replace(seen(rows[4]), epoch=rows[4].epoch + 1)
    assert isinstance(prove(tail(rows, 5), witness), Proven)


def test_a_flipped_bit_is_found_where_it_is() -> None:
    rows = chain(5)
    rows[3] = replace(rows[3], body=b'{"id":"b"}')
    assert place(prove(tail(rows, 2), None))[0] == 4


def test_a_missing_event_is_found_where_it_was() -> None:
    rows = chain(5)
    assert place(prove(tail(rows, rows=[*rows[:2], *rows[3:]]), None))[0] == 3


def test_an_event_missing_just_before_the_tail_is_found() -> None:
    assert place(prove(tail(chain(5), 4, before=None), None))[0] == 3


def test_a_cut_off_end_is_found() -> None:
    rows = chain(5)
    assert place(prove(tail(rows, rows=rows[:4]), None))[0] == 5


def test_events_past_the_head_are_found() -> None:
    rows = chain(5)
    assert place(prove(tail(rows, head_seq=4, head_hash=rows[3].hash), None))[0] == 5


def test_an_epoch_never_goes_back() -> None:
    first = row(1, GENESIS, epoch=2)
    rows = [first, row(2, first.hash, epoch=1)]
    assert place(prove(tail(rows), None))[0] == 2


def test_an_event_and_its_key_name_each_other() -> None:
    rows = chain(3, keyed=True)
    assert place(prove(tail(rows, keys={1: "k1", 3: "k3"}), None))[0] == 2
    assert place(prove(tail(rows, keys={1: "k1", 2: "other", 3: "k3"}), None))[0] == 2
    assert place(prove(tail(rows, keys={1: "k1", 2: "k2", 3: "k3", 9: "k9"}), None))[0] == 9


def test_accounts_that_do_not_add_up_are_found() -> None:
    seq, sentence = place(prove(tail(chain(2), balances={"KRW": 0, "USD": 3}), None))
    assert seq is None
    assert "USD" in sentence
