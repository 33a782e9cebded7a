"""Ids of the guard's own making: UUIDv7 (RFC 9562, section 5.7), so that names sort by time."""

import os
import time
import uuid


def new_id() -> str:
    """Return a new id: 48 bits of wall time in ms, then random bits."""
    value = (time.time_ns() // 1_000_000 & (1 << 48) - 1) << 80
    value |= int.from_bytes(os.urandom(10))
    value = value & ~(0xF << 76) | 0x7 << 76
    value = value & ~(0x3 << 62) | 0x2 << 62
    return str(uuid.UUID(int=value))
