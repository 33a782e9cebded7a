"""Lines of a terminal: a text broken between its words, where a terminal is, and how wide letters are.

A terminal breaks a long line in the middle of a word, and Hangul takes two of its columns. Whoever reads through a
pipe gets each line whole: there, somebody looks for words.
"""

import shutil
import sys
import unicodedata

#: Wider lines are hard to follow, narrower ones say nothing.
COLUMNS_MAX, COLUMNS_MIN = 100, 40


def cells(words: str) -> int:
    """Return how many columns of a terminal a text takes."""
    return sum(2 if unicodedata.east_asian_width(c) in "WF" else 1 for c in words)


def wrapped(words: str, before: int = 0) -> str:
    """Break a text for this terminal. `before`: the columns that are taken on its left, on each of its lines."""
    told = shutil.get_terminal_size((0, 0)).columns if sys.stdout.isatty() else 0
    if not told:
        return words
    return broken(words, min(max(told, COLUMNS_MIN), COLUMNS_MAX), before)


def broken(words: str, columns: int, before: int = 0) -> str:
    """Break a text into lines of at most so many columns. A line's own indent is that of its continuation."""
    lines: list[str] = []
    for line in words.split("\n"):
        own = len(line) - len(line.lstrip(" "))
        lines += _one_broken(line.split(), columns - before - own, own)
    return f"\n{' ' * before}".join(lines)


def _one_broken(words: list[str], room: int, indent: int) -> list[str]:
    lines: list[str] = []
    for word in words:
        if lines and cells(lines[-1]) + 1 + cells(word) <= room:
            lines[-1] += f" {word}"
        else:
            lines.append(word)
    return [" " * indent + line for line in lines or [""]]
