"""Messages from frames: whole, and never more in memory than they have bytes."""

from websockets.frames import Frame, Opcode

from hardcore.crisis.burden import Burden
from hardcore.crisis.messages import Message, Messages


def test_a_message_is_put_together_from_its_frames() -> None:
    messages = Messages()
    assert messages.take(4, [Frame(Opcode.TEXT, b"ab", fin=False)]) == []
    assert messages.take(2, [Frame(Opcode.PING, b"")]) == []
    rest = [Frame(Opcode.CONT, b"c"), Frame(Opcode.BINARY, b"d")]
    assert messages.take(6, rest) == [Message(True, b"abc"), Message(False, b"d")]
    assert messages.unfinished_bytes == 0


def test_what_is_kept_of_an_unfinished_message_is_its_bytes_however_many_frames_they_come_in() -> None:
    messages = Messages()
    messages.take(6, [Frame(Opcode.TEXT, b"a", fin=False)])
    empty = Frame(Opcode.CONT, b"", fin=False)
    messages.take(6_000_000, [empty] * 1_000_000)
    assert messages.unfinished_bytes == 1
    messages.take(70, [])  # of a frame that is not whole yet
    assert messages.unfinished_bytes == 71


def test_what_grows_while_there_is_no_room_is_told_so_and_counted_all_the_same() -> None:
    burden = Burden(100)
    first, second = burden.share(), burden.share()
    assert first.weighs(60)
    assert second.weighs(40)
    assert not first.weighs(61)
    assert burden.bytes == 101
    assert first.weighs(60)  # less than before is never too much
    assert first.weighs(0)
    assert second.weighs(90)
    assert burden.bytes == 90
