import asyncio
from typing import Any

from core import frames
from core.frames import MISSED_EVENTS_MAX, catch_up, frame_of, tell_committed
from core.hub import SEATS_MAX, WAITING_FRAMES_MAX, Frame, Hub, Seat
from core.journal.writer import BATCH_MAX
from core.ledger.decider import EVENTS_PER_COMMAND_MAX
from core.ledger.views import CommittedEvent


def booked(seq: int) -> CommittedEvent:
    return CommittedEvent(seq, "transaction.posted", f"t{seq}", "2026-11-22", "rent", ("a", "b"))


def told(*seqs: int) -> list[Frame]:
    return [Frame(f"frame {seq}", seq) for seq in seqs]


def taken(seat: Seat) -> list[int | None]:
    return [frame.seq for frame in asyncio.run(asyncio.wait_for(seat.take(), 1))]


def test_everyone_hears_everything_in_order() -> None:
    hub = Hub()
    one, other = hub.sit(), hub.sit()
    assert one is not None
    assert other is not None
    hub.tell(told(1, 2))
    hub.tell(told(3))
    assert taken(one) == [1, 2, 3]
    assert taken(other) == [1, 2, 3]


def test_who_takes_nothing_loses_the_seat_and_nobody_else_waits() -> None:
    hub = Hub()
    slow, quick = hub.sit(), hub.sit()
    assert slow is not None
    assert quick is not None
    for seq in range(WAITING_FRAMES_MAX + 1):
        hub.tell(told(seq))
        assert taken(quick) == [seq]
    asyncio.run(asyncio.wait_for(slow.lost(), 1))
    assert hub.listeners == 1


def test_there_are_only_so_many_seats_and_one_given_back_is_taken_again() -> None:
    hub = Hub()
    seats = [hub.sit() for _ in range(SEATS_MAX)]
    assert hub.sit() is None
    assert seats[0] is not None
    hub.leave(seats[0])
    assert hub.sit() is not None


def test_a_whole_batch_that_books_as_much_as_it_can_fits_a_line() -> None:
    seat = Hub().sit()
    assert seat is not None
    a_pause = WAITING_FRAMES_MAX - BATCH_MAX * EVENTS_PER_COMMAND_MAX
    assert a_pause > 0
    assert seat.give(told(*range(a_pause)))
    assert seat.give(told(*range(BATCH_MAX * EVENTS_PER_COMMAND_MAX)))


def test_nothing_is_encoded_while_nobody_listens() -> None:
    events: list[Any] = [None]  # whoever looked at it would fail
    tell_committed(Hub(), events)


def test_a_frame_names_what_happened_and_no_amount() -> None:
    assert frame_of(booked(7)) == Frame(
        '{"v":1,"type":"ledger.transaction","seq":7,"id":"t7","date":"2026-11-22","description":"rent",'
        '"accounts":["a","b"]}',
        7,
    )
    opened = CommittedEvent(8, "account.opened", "a", None, "", ("a",))
    assert frame_of(opened) == Frame('{"v":1,"type":"ledger.account","seq":8,"id":"a"}', 8)


def test_what_was_missed_is_told_up_to_the_head_and_no_further() -> None:
    assert [frame.seq for frame in catch_up(2, 4, [booked(3), booked(4), booked(5)])] == [3, 4]


def test_nothing_was_missed_by_who_asks_for_nothing_or_saw_it_all() -> None:
    assert catch_up(None, 4, []) == []
    assert catch_up(4, 4, []) == []


def test_who_missed_too_much_or_saw_another_book_is_told_to_read_anew() -> None:
    many = [booked(seq) for seq in range(1, MISSED_EVENTS_MAX + 2)]
    assert catch_up(0, 10_000, many) == [frames.resync(10_000)]
    assert len(catch_up(0, MISSED_EVENTS_MAX, many[:-1])) == MISSED_EVENTS_MAX
    assert catch_up(5, 4, []) == [frames.resync(4)]
