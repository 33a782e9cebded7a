"""The gateway's log is for programs: each record is one object, whatever was told in it."""

import json
import logging
import sys

from hardcore.crisis.log_lines import TEXT_CHARACTERS_MAX, JsonLines


def record(text: str, exc_info: object = None) -> logging.LogRecord:
    told = exc_info if isinstance(exc_info, tuple) else None
    return logging.LogRecord("hardcore.crisis.client", logging.WARNING, "", 0, text, (), told)


def test_a_record_is_one_line_with_its_time_its_level_and_who_says_it() -> None:
    line = JsonLines("%(message)s").format(record("one\ntwo \x1b[0m"))
    assert "\n" not in line
    told = json.loads(line)
    assert (told["level"], told["logger"], told["text"]) == (
        "WARNING",
        "hardcore.crisis.client",
        "one\ntwo \x1b[0m",
    )
    assert told["at"].endswith("Z")


def test_a_traceback_stands_in_the_text_and_a_text_has_a_bound() -> None:
    try:
        int("no")
    except ValueError:
        line = JsonLines("%(message)s").format(record("broke", sys.exc_info()))
        assert "ValueError: invalid" in json.loads(line)["text"]
    long = json.loads(JsonLines("%(message)s").format(record("x" * 99_999)))
    assert len(long["text"]) == TEXT_CHARACTERS_MAX
