"""The rules of the quarantine as the gateway goes by them: what is refused at the door, and who may change nothing.

The guard writes them, and the core goes by all of them; the gateway needs only what can be told of a request that
nobody has read yet: its name, its digest, and who sent it. Reading the commands themselves here was not chosen: two
programs that read one wish differently would be a hole in the fence. What makes no sense is passed over, one rule at
a time, because the others still protect somebody; a file that is none keeps the rules before it.
"""

import datetime as dt
import json
import re
from collections.abc import Iterator, Mapping
from typing import Any, Final

import msgspec

#: Bytes of the file that are looked at; a longer one is none of the guard's.
FILE_BYTES_MAX: Final = 8 << 20
#: Entries of each list that are read.
ENTRIES_MAX: Final = 20_000
_ID: Final = re.compile(r"[0-9A-Za-z_.:-]{1,64}")
_NAME: Final = re.compile(r"[0-9a-f]{32}")
_DIGEST: Final = re.compile(r"[0-9a-f]{64}")
_SOURCE_CHARACTERS_MAX: Final = 200


class Rules(msgspec.Struct, frozen=True):
    """All that is in force. `names` and `digests` lead to the letter they are set aside under; `sources` to the
    wall time (seconds) until which they are stopped.
    """

    serial: int = 0
    names: Mapping[str, str] = msgspec.field(default_factory=dict)
    digests: Mapping[str, str] = msgspec.field(default_factory=dict)
    sources: Mapping[str, float] = msgspec.field(default_factory=dict)


class SetAside(msgspec.Struct, frozen=True):
    """It is refused under this letter; empty if nobody said its number."""

    letter: str


class Stopped(msgspec.Struct, frozen=True):
    """Whoever sends it may change nothing for so many seconds."""

    for_s: int


#: Why a request is refused at the door.
Refusal = SetAside | Stopped


def read_rules(data: bytes) -> Rules | str:
    """The rules in a file's bytes, or why they can't be read."""
    if len(data) > FILE_BYTES_MAX:
        return "it is too long"
    try:
        fields = json.loads(data)
    except (ValueError, RecursionError):
        return "it is no JSON"
    if not isinstance(fields, dict) or fields.get("version") != 1:
        return "it is of no version that is known"
    serial = fields.get("serial")
    if not isinstance(serial, int) or isinstance(serial, bool):
        return "its serial is no number"
    letters = [rule for rule in _objects(fields.get("rules")) if _is_letter(rule)]
    return Rules(
        serial=serial,
        names=_leading(letters, "name", _NAME),
        digests=_leading(letters, "digest", _DIGEST),
        sources=_sources(fields.get("sources")),
    )


def is_rule_id(value: object) -> bool:
    """Whether a rule may be called so."""
    return isinstance(value, str) and _ID.fullmatch(value) is not None


def _is_letter(rule: dict[str, Any]) -> bool:  # Any: as JSON gives it
    return rule.get("type") == "letter" and is_rule_id(rule.get("id"))


def _objects(value: object) -> Iterator[dict[str, Any]]:  # Any: as JSON gives it
    entries = value[:ENTRIES_MAX] if isinstance(value, list) else []
    return (one for one in entries if isinstance(one, dict))


def _leading(letters: list[dict[str, Any]], what: str, shape: re.Pattern[str]) -> dict[str, str]:
    """From what a letter's rule says of its requests to the letter. A digest of none says nothing."""
    found = ((rule.get(what), rule["id"]) for rule in letters)
    return {said: letter for said, letter in found if isinstance(said, str) and shape.fullmatch(said)}


def _sources(value: object) -> dict[str, float]:
    named = ((one.get("source"), _second(one.get("until"))) for one in _objects(value))
    return {
        source: until
        for source, until in named
        if isinstance(source, str) and len(source) <= _SOURCE_CHARACTERS_MAX and until is not None
    }


def _second(value: object) -> float | None:
    """The second of an RFC 3339 time; None if it is none."""
    if not isinstance(value, str):
        return None
    try:
        when = dt.datetime.fromisoformat(value)
        return when.timestamp() if when.tzinfo is not None else None
    except (ValueError, OverflowError):
        return None
