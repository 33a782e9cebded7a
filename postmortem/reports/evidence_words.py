"""Says a line of evidence in the reader's language, as far as the catalogue knows its sentence.

Facts hold the witnesses' sentences as they were said; a report in Korean says those it knows anew and leaves the
others as they are. A second, Korean text in the facts was not chosen: every witness would have to say everything
twice, and an old incident could never be read in a new language.
"""

from frontend import catalogue_evidence as texts


def kind_word(kind: str, language: str) -> str:
    """Return who says a line of evidence."""
    return texts.WITNESSES.get(kind, kind) if language == "ko" else kind


def stage_word(stage: str, language: str) -> str:
    """Return how far a command had come."""
    known = texts.STAGES.get(stage)
    return known[language] if known is not None else stage


def command_word(kind: str, language: str) -> str:
    """Return what a command was."""
    return texts.KINDS.get(kind, kind) if language == "ko" else kind


def ordeal_word(ordeal: str, language: str) -> str:
    """Return what became of a suspect in its trial; a word unknown here as it is."""
    known = texts.ORDEALS.get(ordeal)
    return known[language] if known is not None else ordeal


def told(line: str, language: str) -> str:
    """Return a line of evidence in `language`: behind its witness's name, as a whole, or part by part."""
    if language != "ko":
        return line
    kind, colon, rest = line.partition(": ")
    if colon and kind in texts.WITNESSES:
        return f"{texts.WITNESSES[kind]}: {told(rest, language)}"
    return texts.in_korean(line)
