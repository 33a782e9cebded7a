"""Passwords: what is kept of one, and whether one is right. Argon2id, by the reference library.

Costs memory and time on purpose (a guesser pays it for each guess), so it is nothing for a loop: whoever asks does so on a
thread, and bounds how many do so at once. The numbers stand above the least that OWASP names for Argon2id (19 MiB, two
passes) and fit a small machine at home.
"""

import unicodedata
from functools import cache
from typing import Final

from argon2 import PasswordHasher
from argon2.exceptions import InvalidHashError, VerificationError

CHARACTERS_MIN: Final = 8
BYTES_MAX: Final = 1_024
_PASSES: Final = 3
_MEMORY_KIB: Final = 32 << 10
_LANES: Final = 1

_HASHER: Final = PasswordHasher(time_cost=_PASSES, memory_cost=_MEMORY_KIB, parallelism=_LANES)


def is_usable(password: str) -> bool:
    """Whether it is long enough to be one, and no longer than anybody types."""
    try:
        size = len(_spelled(password).encode())
    except UnicodeEncodeError:  # bytes that are no text: no browser could send them again
        return False
    return len(password) >= CHARACTERS_MIN and size <= BYTES_MAX


def kept(password: str) -> str:
    """What it takes to recognise a password."""
    return _HASHER.hash(_spelled(password))


def is_right(password: str, secret: str | None) -> bool:
    """Whether this is the password. Without one to compare with it takes as long: names can't be told by the time."""
    try:
        _HASHER.verify(secret if secret is not None else _nobodys(), _spelled(password))
    except (VerificationError, InvalidHashError):
        return False
    return secret is not None


def _spelled(password: str) -> str:
    """One spelling for what looks alike: some keyboards send a syllable of Hangul whole, others its letters."""
    return unicodedata.normalize("NFC", password)


@cache
def _nobodys() -> str:
    return kept("nobody has this one")
