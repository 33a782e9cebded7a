"""Lines of a terminal are broken between words, and never wider than it."""

import pytest

from hardcore.lines import broken, cells, wrapped


@pytest.mark.parametrize(
    "words",
    ["a calm and rather long sentence for a narrow terminal", "차분하고 꽤 긴 문장을 좁은 화면에 적어요"],
)
@pytest.mark.parametrize("before", [0, 6])
def test_no_line_is_wider_than_the_terminal_and_no_word_is_lost(words: str, before: int) -> None:
    lines = broken(words, 24, before).split("\n")
    assert len(lines) > 1
    assert all(cells(line.strip()) + before <= 24 for line in lines)
    assert " ".join(line.strip() for line in lines) == words


def test_a_word_wider_than_the_terminal_stays_whole() -> None:
    assert broken("see 0123456789012345678901234567890", 20) == "see\n0123456789012345678901234567890"


def test_a_line_keeps_its_indent_where_it_goes_on() -> None:
    assert broken("head\n  one two three", 9) == "head\n  one two\n  three"


def test_whoever_reads_through_a_pipe_gets_lines_whole() -> None:
    assert wrapped("word " * 100) == "word " * 100
