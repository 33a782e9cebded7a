"""What a single field of a wish may hold: days, names and texts, each with its limit.

Commands of accounts, of transactions and of the household's entries share these rules, so a name that may be
opened by hand may also be made on first use. Texts are kept as they came: markup, emoji and marks of writing
direction are text, and whoever shows them escapes them. Only control characters are refused, because they have
no look at all. Cleaning texts silently was not chosen: the event would then hold what nobody wrote.
"""

import datetime as dt
import re
import unicodedata
from collections.abc import Iterator
from typing import Final

from core.ledger.accounts import is_account_id
from core.ledger.reasons import Fault, Reason

TAGS_MAX: Final = 50
TAG_CHARACTERS_MAX: Final = 64
NAME_CHARACTERS_MAX: Final = 200
DESCRIPTION_CHARACTERS_MAX: Final = 2_000

_DATE: Final = re.compile(r"[0-9]{4}-[0-9]{2}-[0-9]{2}")
_CONTROL: Final = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029]")
_CONTROL_BUT_LINES: Final = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")


def is_date(text: str) -> bool:
    """Whether `text` is a day of the calendar, written YYYY-MM-DD."""
    if _DATE.fullmatch(text) is None:
        return False
    try:
        dt.date.fromisoformat(text)
    except ValueError:
        return False
    return True


def folded(name: str) -> str:
    """Return the form in which two spellings of one name are equal: composed, without case and outer spaces."""
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", name).casefold()).strip()


def date_faults(pointer: str, text: str) -> Iterator[Fault]:
    """Say what is wrong with a day."""
    if not is_date(text):
        yield Fault(pointer, Reason.MALFORMED)


def id_faults(pointer: str, text: str) -> Iterator[Fault]:
    """Say what is wrong with the id of an account."""
    if not is_account_id(text):
        yield Fault(pointer, Reason.MALFORMED)


def text_faults(pointer: str, text: str, characters_max: int) -> Iterator[Fault]:
    """Say what is wrong with a text of one line."""
    if len(text) > characters_max:
        yield Fault(pointer, Reason.TOO_LONG)
    if _CONTROL.search(text):
        yield Fault(pointer, Reason.CONTROL_CHARACTER)


def description_faults(pointer: str, text: str) -> Iterator[Fault]:
    """Say what is wrong with a description, which may have several lines."""
    if len(text) > DESCRIPTION_CHARACTERS_MAX:
        yield Fault(pointer, Reason.TOO_LONG)
    if _CONTROL_BUT_LINES.search(text):
        yield Fault(pointer, Reason.CONTROL_CHARACTER)


def tag_faults(pointer: str, tags: list[str]) -> Iterator[Fault]:
    """Say what is wrong with the tags."""
    if len(tags) > TAGS_MAX:
        yield Fault(pointer, Reason.TOO_MANY)
    for index, tag in enumerate(tags[:TAGS_MAX]):
        yield from text_faults(f"{pointer}/{index}", tag, TAG_CHARACTERS_MAX)
