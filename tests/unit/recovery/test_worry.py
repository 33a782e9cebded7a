from hardcore.model.verdicts import Colour
from hardcore.recovery.budget import NS_PER_MS
from hardcore.recovery.worry import Worry


def _seen(*looks: tuple[int, Colour]) -> Worry:
    worry = Worry(1000, 10_000)
    for at_ms, colour in looks:
        worry.look(colour, at_ms * NS_PER_MS)
    return worry


G, Y, R = Colour.GREEN, Colour.YELLOW, Colour.RED


def test_a_hiccup_is_not_shown() -> None:
    assert not _seen((0, Y), (999, Y)).shown


def test_a_second_of_worry_is_shown() -> None:
    assert _seen((0, Y), (1000, Y)).shown


def test_a_green_look_begins_the_second_anew() -> None:
    assert not _seen((0, Y), (900, G), (1000, Y), (1900, Y)).shown


def test_it_is_shown_until_ten_seconds_were_clean() -> None:
    assert _seen((0, Y), (1000, R), (10_999, G)).shown
    assert not _seen((0, Y), (1000, R), (11_000, G)).shown


def test_a_new_core_begins_without_the_old_ones_worry() -> None:
    worry = _seen((0, Y), (1000, Y))
    worry.forget()
    assert not worry.shown
