"""Names that the server gives: UUIDv7, from a time and randomness that are handed in.

Version 7 sorts by time, so an index on it grows at one end. The caller brings both ingredients; this room
asks no clock and no dice, and a test can say what the id will be.
"""

from typing import Final

ENTROPY_BYTES: Final = 10


def uuid7(unix_ms: int, entropy: bytes) -> str:
    """Return a UUIDv7 for a wall time in milliseconds and ten random bytes (74 bits of them are used)."""
    assert 0 <= unix_ms < 2**48
    assert len(entropy) == ENTROPY_BYTES
    random_a = int.from_bytes(entropy[:2], "big") & 0x0FFF
    random_b = int.from_bytes(entropy[2:], "big") & (2**62 - 1)
    number = unix_ms << 80 | 0x7 << 76 | random_a << 64 | 0b10 << 62 | random_b
    text = f"{number:032x}"
    return f"{text[:8]}-{text[8:12]}-{text[12:16]}-{text[16:20]}-{text[20:]}"
