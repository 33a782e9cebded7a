"""How much a file may be, and how long and how widely it may be read."""

from typing import Final

import msgspec

MEBIBYTE: Final = 1 << 20
PASSWORD_CHARACTERS_MAX: Final = 255


class ReadingLimits(msgspec.Struct, frozen=True):
    """The limits of one reading. The child gets them in its request and puts them on itself.

    `address_space_bytes_max` is what the kernel allows the child in all; `cpu_s_max` its processor time and
    `wall_ms_max` the wait for it. `unpacked_bytes_max` is what a workbook may say it unpacks to;
    `rows_bytes_max` what is written of it.
    """

    file_bytes_max: int = 20 * MEBIBYTE
    unpacked_bytes_max: int = 256 * MEBIBYTE
    rows_bytes_max: int = 128 * MEBIBYTE
    address_space_bytes_max: int = 512 * MEBIBYTE
    cpu_s_max: int = 30
    wall_ms_max: int = 30_000
