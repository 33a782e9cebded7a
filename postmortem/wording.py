"""What people write beside an act, made harmless once before it is kept: a reason, a note, a version, an owner.

Such a text is shown to other people, in terminals and in files, for years. So what can't be seen is written out before
the archive has it, as a letter's texts are. To refuse such texts was not chosen: who pastes a line of a log should not
have to look for the one character in it that nobody sees.
"""

from typing import Final

from postmortem.reports.visible import visible

#: Letters to a machine, blanks to a reader: the fillers of Hangul.
_BLANKS: Final = frozenset("\u115f\u1160\u3164\uffa0")


def cleaned(text: str, characters_max: int) -> str:
    """A text of one line, cut, with everything that does not print written out."""
    return visible(text.strip()[:characters_max])


def cleaned_lines(text: str, characters_max: int) -> str:
    """A text of several lines, cut; line ends and tabs stay, everything else that does not print is written out."""
    lines = text[:characters_max].replace("\r\n", "\n").replace("\t", " ").split("\n")
    return "\n".join(map(visible, lines))


def is_said(text: str) -> bool:
    """Tell whether a text has a letter or a digit in it that a reader can see."""
    return any(one.isalnum() and one not in _BLANKS for one in text)
