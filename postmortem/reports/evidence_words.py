"""Says a line of evidence in the reader's language, as far as the catalogue knows its sentence.

Facts hold the witnesses' sentences as they were said; a report in Korean says those it knows anew and leaves the
others as they are. A second, Korean text in the facts was not chosen: every witness would have to say everything
twice, and an old incident could never be read in a new language.
"""

import re
from functools import cache

from frontend import catalogue_evidence as texts

_FIELD = re.compile(r"\\\{(\w+)\\\}")


def kind_word(kind: str, language: str) -> str:
    """Return who says a line of evidence."""
    return texts.WITNESSES.get(kind, kind) if language == "ko" else kind


def stage_word(stage: str, language: str) -> str:
    """Return how far a command had come."""
    return texts.STAGES.get(stage, stage) if language == "ko" else stage


def command_word(kind: str, language: str) -> str:
    """Return what a command was."""
    return texts.KINDS.get(kind, kind) if language == "ko" else kind


def told(line: str, language: str) -> str:
    """Return a line of evidence in `language`: behind its witness's name, as a whole, or part by part."""
    if language != "ko":
        return line
    kind, colon, rest = line.partition(": ")
    if colon and kind in texts.WITNESSES:
        return f"{texts.WITNESSES[kind]}: {told(rest, language)}"
    whole = _korean(line)
    if whole is not None:
        return whole
    return "; ".join(_korean(part) or part for part in line.split("; "))


def _korean(sentence: str) -> str | None:
    for pattern, korean in _sentences():
        if (match := pattern.fullmatch(sentence)) is not None:
            return korean.format_map(match.groupdict())
    return None


@cache
def _sentences() -> tuple[tuple[re.Pattern[str], str], ...]:
    return tuple(
        (re.compile(_FIELD.sub(r"(?P<\1>[^;]+?)", re.escape(english))), korean)
        for english, korean in texts.SENTENCES
    )
